"""Structured arrays in place of lists of fixed-size messages: dtypes, views, conversions, errors."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from support.inner_state import type_fields

from rosidl_py_gen import (
    DecodeError,
    EncodeError,
    TypeNotFoundError,
    compile_definition,
    decode,
    dtype,
    encode,
    from_dict,
    get_message,
    messages,
    records,
    to_dict,
    type_name,
    validate,
)

Point: Any = get_message("geometry_msgs/msg/Point")
Pose: Any = get_message("geometry_msgs/msg/Pose")
PoseArray: Any = get_message("geometry_msgs/msg/PoseArray")
PoseStamped: Any = get_message("geometry_msgs/msg/PoseStamped")

LINE = "=" * 80
PARTS = {
    "Tail": "float64 x\nuint8 y",
    "Head": "uint8 a\nfloat64 b",
    "Odd": "uint8 a\nuint16 b\nuint8 c",
    "Flags": "bool on\nbool[2] more\nuint8 n",
    "Empty": "",
    "Keyword": "int32 from",
    "Grid": "float32[3] row\nPoint[2] corners",
    "Point": "float64 x\nfloat64 y\nfloat64 z",
    "Nested": "uint8 k\nOdd[3] odds\nOdd[1] one",
    "Ends": "Tail[2] tails\nuint8 z",
    "Wide": "float64[4] w\nFlags flags",
    "Heavy": "\n".join(f"uint8 b{n}" for n in range(60)),
    "Stamped": "Stamp stamp\nuint8[2] id\nStamp other",
    "Stamp": "int32 sec\nuint32 nanosec",
}


def compiled(name: str, text: str) -> Any:
    more = [f"{LINE}\nMSG: rows/{part}\n{body}" for part, body in PARTS.items()]
    return compile_definition(f"rows/msg/{name}", "\n".join([text, *more]))


def part(name: str) -> Any:
    return type_fields(compiled(f"Of{name}", f"{name}[] v"))[0].cls


def box(kind: str, before: str = "") -> Any:
    """Return a message class with the field `v` of a type, after the fields of `before`."""
    name = f"Box{kind.encode().hex()}{before.encode().hex()}"
    return compiled(name, f"{before}\n{kind} v")


def offsets(kind: np.dtype[Any]) -> dict[str, int]:
    assert kind.fields is not None
    return {name: field[1] for name, field in kind.fields.items()}


# --- dtypes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "places", "itemsize"),
    [
        ("Point", {"x": 0, "y": 8, "z": 16}, 24),
        ("Tail", {"x": 0, "y": 8}, 16),
        ("Head", {"a": 0, "b": 8}, 16),
        ("Odd", {"a": 0, "b": 1, "c": 3}, 4),  # every element after the first begins at an odd offset
        ("Flags", {"on": 0, "more": 1, "n": 3}, 4),
        ("Keyword", {"from": 0}, 4),
        ("Grid", {"row": 0, "corners": 16}, 64),
        ("Stamped", {"stamp": 0, "id": 8, "other": 12}, 20),
        ("Wide", {"w": 0, "flags": 32}, 40),
        ("Nested", {"k": 0, "odds": 1, "one": 13}, 17),  # odds[0] and odds[1] have different layouts: no such dtype
        ("Ends", {"tails": 0, "z": 32}, 33),  # z is stored in the padding of tails[1]
    ],
)
def test_dtype_has_the_field_offsets_of_cdr(name: str, places: dict[str, int], itemsize: int) -> None:
    found = dtype(part(name))
    assert (offsets(found), found.itemsize) == (places, itemsize)


def test_dtype_of_an_empty_message_is_one_byte_of_padding() -> None:
    assert (dtype(part("Empty")).names, dtype(part("Empty")).itemsize) == ((), 1)
    cls = box("Empty[]")
    data = encode(cls(v=[part("Empty")()] * 3))
    held = decode(cls, data, arrays=True)
    assert len(held.v) == 3 and encode(held) == data and held == decode(cls, data)
    assert encode(cls(v=np.frombuffer(b"\7\7\7", dtype(part("Empty"))))) == data


def test_nested_messages_and_arrays_become_nested_dtypes_and_shapes() -> None:
    found = dtype(part("Grid"))
    assert found["row"].shape == (3,) and found["corners"].shape == (2,)
    assert found["corners"].base == dtype(part("Point"))
    assert found["corners"].base["x"] == np.float64


def test_message_of_variable_size_has_no_dtype_and_the_error_states_the_field() -> None:
    with pytest.raises(TypeError, match=r"PoseStamped is not of fixed size, because of its field header\.frame_id \(s"):
        dtype(PoseStamped)
    with pytest.raises(TypeError, match=r"field poses \(geometry_msgs/msg/Pose\[\]\)"):
        dtype(compile_definition("rows/msg/Only", f"geometry_msgs/Pose[] poses\n{LINE}\nMSG: rows/Point\nfloat64 x"))
    with pytest.raises(TypeNotFoundError):
        dtype(int)  # type: ignore[arg-type]


def test_message_too_large_for_numpy_has_no_dtype_and_its_sequences_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "rosidl_py_gen.compiler.frontend.size_limits.MAX_BYTES", 1 << 40
    )  # as when its module was generated
    huge = compiled("Huge", "float64[400000000] big")
    with pytest.raises(TypeError, match="Huge is too large for a numpy dtype"):
        dtype(huge)
    cls = compile_definition("rows/msg/HasHuge", f"Huge[] v\n{LINE}\nMSG: rows/Huge\nfloat64[400000000] big")
    for count in (0, 1):
        with pytest.raises(DecodeError, match=r"HasHuge\.v: at byte 8: .* too large"):
            decode(cls, b"\0\1\0\0" + bytes([count, 0, 0, 0]) + bytes(100), arrays=True)


# --- reading --------------------------------------------------------------------------------------------------------


def shares(array: np.ndarray[Any, Any], data: bytes) -> bool:
    return np.shares_memory(array.view(np.uint8), np.frombuffer(data, np.uint8))


def test_structured_arrays_are_read_only_views_with_usual_numpy_indexing() -> None:
    data = encode(PoseArray(poses=[Pose(position=Point(x=float(n))) for n in range(10)]))
    poses = decode(PoseArray, data, arrays=True).poses
    assert shares(poses, data) and not poses.flags.writeable
    assert poses["position"]["x"].sum() == 45
    assert poses[3:5]["position"]["x"].tolist() == [3, 4]
    assert poses.view(np.float64).reshape(-1, 7)[:, 0].max() == 9
    assert (poses["position"]["x"] * [[1], [2]]).shape == (2, 10)
    assert poses[poses["position"]["x"] > 7].shape == (2,)
    own = PoseArray.decode(data, arrays=True, copy=True).poses
    own["position"]["x"] += 1
    assert own["position"]["x"].sum() == 55 and not shares(own, data)


@pytest.mark.parametrize(
    ("kind", "before", "view"),
    [
        ("Point[]", "", True),
        ("Point[]", "string s", True),
        ("Head[]", "", False),  # the first begins at 4 modulo 8
        ("Head[]", "float32 s", True),
        ("Odd[]", "", False),
        ("Tail[]", "", False),  # the bytes end before the padding of the last element
        ("Nested[]", "", False),
        ("Stamped[]", "", True),
        ("Grid[2]", "float32 s", False),
        ("Grid[]", "float32 s", True),
        ("Heavy[]", "", True),
    ],
)
def test_structured_arrays_are_views_if_wire_layout_equals_dtype_layout(kind: str, before: str, view: bool) -> None:
    cls = box(kind, before)
    inner = part(kind.split("[")[0])
    data = encode(cls(v=[inner() for _ in range(2)]))
    held = decode(cls, data, arrays=True)
    assert held.v.dtype == dtype(inner)
    assert shares(held.v, data) == view
    assert not held.v.flags.writeable
    assert encode(held) == data
    if kind == "Tail[]":
        assert shares(decode(cls, data + bytes(7), arrays=True).v, data + bytes(7)) is False
        behind = data + bytes(7)
        assert shares(decode(cls, behind, arrays=True).v, behind)


def test_bool_bytes_above_one_in_structured_arrays_are_true() -> None:
    cls = box("Flags[]")
    data = b"\0\1\0\0\2\0\0\0" + bytes([1, 0, 1, 9]) + bytes([2, 0xFF, 0, 7])
    for wire in (data, b"\0\0\0\0\0\0\0\2" + data[8:]):
        for own in (False, True):
            held = decode(cls, wire, arrays=True, copy=own).v
            assert held["on"].view(np.uint8).tolist() == [1, 1]
            assert held["more"].view(np.uint8).tolist() == [[0, 1], [1, 0]]
            assert held["n"].tolist() == [9, 7]
            assert held.flags.writeable == own
    assert data[12] == 2


# --- wrong bytes ----------------------------------------------------------------------------------------------------

COUNT = "00010000 ffffffff"


@pytest.mark.parametrize(
    ("kind", "wire", "offset", "text"),
    [
        ("Point[]", COUNT + "00" * 30, 12, "expected 103079215080 bytes of 4294967295 rows/msg/Point, found 26"),
        ("Point[]", "00000000 ffffffff" + "00" * 30, 12, "expected 103079215080 bytes of 4294967295 rows/msg/Point, f"),
        ("Point[]", "00010000 01000000 00000000" + "00" * 23, 12, "expected 24 bytes of 1 rows/msg/Point, found 23"),
        ("Tail[]", "00010000 02000000 00000000" + "00" * 24, 12, "expected 25 bytes of 2 rows/msg/Tail, found 24"),
        ("Head[]", "00010000 02000000" + "00" * 27, 8, "expected 28 bytes of 2 rows/msg/Head, found 27"),
        ("Empty[]", COUNT + "0000", 8, "expected 4294967295 bytes of 4294967295 rows/msg/Empty, found 2"),
        ("Heavy[]", COUNT + "0000", 8, "expected 257698037700 bytes of 4294967295 rows/msg/Heavy, found 2"),
        ("Point[<=2]", "00010000 03000000 00000000" + "00" * 72, 4, "expected at most 2 elements, found 3"),
        ("Point[2]", "00010000" + "00" * 47, 4, "expected 48 bytes of 2 rows/msg/Point, found 47"),
    ],
)
def test_wrong_count_is_reported_with_field_and_offset_without_allocating_memory(
    kind: str, wire: str, offset: int, text: str
) -> None:
    cls = box(kind)
    tracemalloc.start()
    with pytest.raises(DecodeError) as caught:
        decode(cls, bytes.fromhex(wire), arrays=True)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
    error = caught.value
    assert (error.path, error.offset_bytes) == (f"{type_name(cls)}.v", offset)
    assert error.reason.startswith(text)


# --- writing --------------------------------------------------------------------------------------------------------


def xyz(*rows: tuple[float, float, float]) -> np.ndarray[Any, Any]:
    return np.array(list(rows), dtype(part("Point")))


def test_floats_of_structured_arrays_are_rounded_to_the_field_as_in_lists() -> None:
    polygon: Any = get_message("geometry_msgs/msg/Polygon")
    point: Any = get_message("geometry_msgs/msg/Point32")
    rows = [(0.1, 1 / 3, 16_777_217.0), (1e-46, -0.0, float("inf"))]
    wide = np.array(rows, [("x", "f8"), ("y", "f8"), ("z", "f8")])
    assert polygon(points=wide).encode() == polygon(points=[point(*row) for row in rows]).encode()
    wide["y"][1] = 1e300
    with pytest.raises(EncodeError, match=r"points\[1\]: field y: expected float32, found 1e\+300"):
        polygon(points=wide).encode()


def test_structured_array_fields_are_matched_by_name_not_by_order() -> None:
    cls = box("Point[]")
    values = np.array([(3, 1, 2)], [("z", "f4"), ("x", "i2"), ("y", ">f8")])
    message = cls(v=values)
    validate(message)
    assert encode(message) == encode(cls(v=xyz((1, 2, 3))))
    assert message == cls(v=xyz((1, 2, 3)))
    assert encode(cls(v=values.view(np.recarray))) == encode(message)
    assert encode(cls(v=xyz((1, 2, 3)).view(np.recarray))) == encode(message)


XY, YZ = [("x", "f8"), ("y", "f8")], [("y", "f8"), ("z", "f8")]


def flags(*more: bool) -> np.ndarray[Any, Any]:
    return np.array([(True, more, 1)], [("on", "?"), ("more", "?", (len(more),)), ("n", "u1")])


@pytest.mark.parametrize(
    ("kind", "values", "where", "text"),
    [
        ("Point[]", np.zeros(1, XY), "", "with the fields x, y, z, found the field z missing"),
        ("Point[]", np.zeros(1, [*XY, ("w", "f8")]), "", "found the field z missing and the field w unknown"),
        ("Point[]", np.zeros((4, 3)), "", "expected one dimension, found shape (4, 3); use .ravel()"),
        ("Point[]", np.zeros(3), "", "expected a structured array with the fields x, y, z, found one of float64"),
        ("Point[]", np.zeros((2, 2), dtype(part("Point"))), "", "expected one dimension, found shape (2, 2)"),
        ("Point[]", np.zeros((), dtype(part("Point"))), "", "expected one dimension, found shape ()"),
        ("Point[]", np.zeros(1, [("x", "c16"), *YZ]), "", "field x: expected an array of float64"),
        ("Point[]", np.zeros(1, [("x", "O"), *YZ]), "", "field x: expected an array of float64"),
        ("Point[]", np.zeros(2, [("x", "f8", 2), *YZ]), "", "field x: expected shape (), found (2"),
        ("Point[<=2]", np.zeros(3, dtype(part("Point"))), "", "expected at most 2 elements, found 3"),
        ("Point[2]", np.zeros(3, dtype(part("Point"))), "", "expected exactly 2 elements, found 3"),
        ("Keyword[]", np.array([(1,), (2**31,)], [("from", "i8")]), "[1]", "field from: expected int32 in -2147483648"),
        ("Keyword[]", np.zeros(1, [("from", "f8")]), "", "expected an array of int32, found one of float64"),
        ("Flags[]", flags(True), "", "field more: expected shape (2,), found (1,)"),
        ("Grid[]", np.zeros(1, [("row", "f4", 3), ("corners", "f8", 2)]), "", "field corners: expected a structured"),
        ("string[]", np.zeros(1, [("x", "f8")]), "", "expected a list of string, found array"),
    ],
)
def test_wrong_structured_array_is_an_encode_error_with_field_and_reason(
    kind: str, values: Any, where: str, text: str
) -> None:
    cls = box(kind)
    message = cls(v=values)
    for function in (encode, validate):
        with pytest.raises(EncodeError) as caught:
            function(message)
        assert caught.value.path == f"{type_name(cls)}.v{where}"
        assert text in caught.value.reason
    if "expected at most" not in text and "expected exactly" not in text and kind != "string[]":  # as for lists
        with pytest.raises(EncodeError):
            to_dict(message)
    with pytest.raises(EncodeError):
        from_dict(cls, {"v": values})
    assert repr(message).startswith(cls.__name__)
    assert message != cls()


def test_structured_array_cannot_replace_messages_of_variable_size() -> None:
    path = get_message("nav_msgs/msg/Path")
    message = path(poses=np.zeros(2, [("header", "i4")]))
    with pytest.raises(
        EncodeError, match=r"Path\.poses: expected a list of geometry_msgs/msg/PoseStamped, found array"
    ):
        encode(message)
    assert message != path() and "poses=" in repr(message)


# --- between the forms ----------------------------------------------------------------------------------------------


def test_functions_records_and_messages_are_inverse() -> None:
    listed = [Point(float(n), 2.0, -0.0) for n in range(5)]
    array = records(listed)
    assert array.dtype == dtype(Point) and array["x"].tolist() == [0, 1, 2, 3, 4]
    assert array.flags.writeable
    assert messages(Point, array) == listed
    assert records(array) is array and messages(Point, listed) == listed
    assert records(array[["z", "y", "x"]], Point).dtype == dtype(Point)
    assert messages(Point, array[["z", "y", "x"]]) == listed


def test_messages_from_records_have_copies_of_the_arrays() -> None:
    wide = part("Wide")
    array = records([wide(w=[1, 2, 3, 4])])
    one = messages(wide, array)[0]
    one.w[0] = 7
    assert array["w"].tolist() == [[1, 2, 3, 4]]


def test_records_of_an_empty_list_require_a_message_class() -> None:
    with pytest.raises(TypeError, match="class of an empty sequence is not known"):
        records([])
    assert records([], Point).dtype == dtype(Point) and len(records((), Point)) == 0
    assert messages(Point, records([], Point)) == []


def test_wrong_element_given_to_records_or_messages_is_reported() -> None:
    with pytest.raises(EncodeError, match=r"^geometry_msgs/msg/Point\[1\]\.x: expected float"):
        records([Point(), Point(x="1")])
    with pytest.raises(EncodeError, match=r"^geometry_msgs/msg/Point\[1\]: expected geometry_msgs/msg/Point, found 7"):
        records([Point(), 7])
    with pytest.raises(EncodeError, match="the field z missing"):
        messages(Point, np.zeros(1, [("x", "f8"), ("y", "f8")]))
    with pytest.raises(EncodeError, match=r"^geometry_msgs/msg/Point: .* found one of float64"):
        records(np.zeros(3), Point)
    with pytest.raises(TypeError, match="not of fixed size"):
        records([PoseStamped()])
    with pytest.raises(TypeNotFoundError):
        records([1])  # type: ignore[list-item]


def test_messages_with_lists_and_with_structured_arrays_compare_by_value() -> None:
    cls = box("Point[]")
    listed = cls(v=[part("Point")(1.0, 2.0, 3.0)])
    held = cls(v=xyz((1, 2, 3)))
    assert (
        listed == held
        and held == listed
        and held == cls(v=xyz((1, 2, 3)).astype([("x", "f4"), ("y", "i8"), ("z", "f8")]))
    )
    assert held != cls(v=xyz((1, 2, 4))) and listed != cls(v=xyz((1, 2, 4))) and held != cls(v=xyz())
    assert held != cls(v=np.zeros(1)) and held != cls(v=None) and cls(v=None) != held
    assert cls(v=[]) == cls(v=xyz())
