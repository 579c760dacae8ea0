"""Messages with very many fields, whose classes are made from a table."""

from __future__ import annotations

import dataclasses
import gc
import itertools
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each_case import each_case
from support.bundled_interfaces import library, reference, vectors_by_type
from support.rclpy_messages import hooked, rclpy_class
from support.reference_cdr import same

from rosidl_py_gen import (
    DecodeError,
    DefinitionError,
    EncodeError,
    compile_definition,
    decode,
    encode,
    from_json,
    to_json,
)
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.table_coded import TableCodedMessage
from rosidl_py_gen.cdr.type_queries import constants, type_description
from rosidl_py_gen.compiler.codegen import layout_planner, template_model
from rosidl_py_gen.compiler.frontend import idl_parser
from rosidl_py_gen.type_loading import class_lookup

BY_TYPE = vectors_by_type()
LINE = "=" * 80
COUNT = 100
PARTS = {"Point": "float64 x\nfloat32 y\n", "Named": "string name\n", "Nothing": ""}
NESTED = "".join(f"{LINE}\nMSG: wide_msgs/{name}\n{body}" for name, body in PARTS.items())
FIELDS = (
    *("bool a{}", "string b{} 'it is'", "int64 c{} -3", "wstring<=5 d{}", "float32[3] e{} [1, 2, 3]", "Point f{}"),
    *("Point[] g{}", "Named[<=2] h{}", "string<=4[] i{} ['a']", "int16[] j{}"),
    *("Nothing k{}", "byte l{}", "Named[2] m{}"),
)
CONSTANTS = "byte A{0}=7\nstring B{0}=x\nfloat64 C{0}=1.5\n"
TEXT = (
    "".join(f"{line.format(i)}\n" for i in range(COUNT) for line in FIELDS)
    + "".join(CONSTANTS.format(i) for i in range(COUNT))
    + NESTED
)


@pytest.fixture(autouse=True)
def forget_new_classes() -> Iterator[None]:
    """Forget the classes of a test, so that later tests do not find them."""
    loaded = {name: list(found) for name, found in class_lookup._loaded.items()}
    yield
    class_lookup._loaded.clear()
    class_lookup._loaded.update(loaded)


def filled(cls: Any, parts: Any) -> Any:
    point, named, none = parts
    values: dict[str, Any] = {}
    for i in range(COUNT):
        values |= {f"a{i}": i % 2 == 0, f"b{i}": "x" * (i % 5), f"d{i}": "ü😀"[: i % 3], f"f{i}": point(x=i, y=0.5)}
        values |= {f"g{i}": [point(x=n) for n in range(i % 3)], f"h{i}": [named(name="n")] * (i % 3), f"k{i}": none()}
        values |= {f"j{i}": np.arange(i % 4, dtype=np.int16)}
    return cls(**values)


def parts_of(cls: Any) -> list[Any]:
    found = {field.cls._TYPE.name: field.cls for field in cls._TYPE.fields if field.cls is not None}
    return [found[f"wide_msgs/msg/{name}"] for name in ("Point", "Named", "Nothing")]


@each_case("name", sorted(BY_TYPE))
def test_table_coded_classes_decode_and_encode_recorded_values(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(layout_planner, "MAX_CODEC_LEAVES", 0)
    monkeypatch.setattr(template_model, "MAX_EMITTED", 0)
    monkeypatch.setattr(class_lookup, "find_class", lambda *_, **__: None)
    oracle = reference()
    cls: Any = class_lookup.class_of_registry(library(), split_ros_name(name))
    assert issubclass(cls, TableCodedMessage)
    for vector in BY_TYPE[name]:
        data = vector.cdr
        assert encode(oracle.build(cls, vector.value)) == data
        assert same(oracle.plain(decode(cls, memoryview(data))), oracle.decode(name, data))
        assert encode(decode(cls, data, arrays=True)) == data
        big = oracle.encode(name, vector.value, big_endian=True)
        assert encode(decode(cls, big)) == data
    for size in range(len(BY_TYPE[name][0].cdr)):
        with pytest.raises(DecodeError, match=name):
            decode(cls, BY_TYPE[name][0].cdr[:size])


def test_table_coded_class_behaves_like_a_generated_class() -> None:
    cls = compile_definition("wide_msgs/msg/Wide", TEXT)
    narrow = compile_definition("wide_msgs/msg/Narrow", "\n".join(line.format(1) for line in FIELDS) + "\n" + NESTED)
    assert issubclass(cls, TableCodedMessage) and not issubclass(narrow, TableCodedMessage)
    new, other = cls(), narrow()
    for field in narrow._TYPE.fields:
        left, right = getattr(new, field.py_name), getattr(other, field.py_name)
        assert repr(left) == repr(right) and type(left) is type(right), field
    fields = {one["name"]: one for one in type_description(cls)["type_description"]["fields"]}
    for one in type_description(narrow)["type_description"]["fields"]:
        assert fields[one["name"]] == one
    assert [item.name for item in dataclasses.fields(cls)] == [field.ros_name for field in cls._TYPE.fields]
    assert len(constants(cls)) == 3 * COUNT and (cls.A0, cls.B1, cls.C2) == (7, "x", 1.5)
    assert compile_definition("wide_msgs/msg/Wide", TEXT) is cls, (
        "the one that says the same, constants and defaults too"
    )
    message = filled(cls, parts_of(cls))
    assert cls.decode(message.encode()) == message == from_json(cls, to_json(message))
    with pytest.raises(TypeError, match="unexpected keyword argument 'nothing'"):
        cls(nothing=1)


def test_invalid_values_of_a_table_coded_message_are_reported_with_field() -> None:
    cls = compile_definition("wide_msgs/msg/Wide", TEXT)
    point, named, _ = parts_of(cls)
    for name, value, reason in (
        ("c7", 2**63, "c7: expected int64"),
        ("d7", "123456", "d7: expected at most 5 characters, found 6"),
        ("e7", [1.0], "e7: expected exactly 3 elements, found 1"),
        ("g7", [point(), None], r"g7\[1\]: expected wide_msgs/msg/Point"),
        ("h7", [named()] * 3, "h7: expected at most 2 elements, found 3"),
        ("m7", [named()], "m7: expected exactly 2 elements, found 1"),
    ):
        message = cls()
        setattr(message, name, value)
        with pytest.raises(EncodeError, match=f"wide_msgs/msg/Wide.{reason}"):
            message.encode()
    strided = cls(j3=np.arange(6, dtype=np.int16)[::2])
    assert cls.decode(strided.encode()).j3.tolist() == [0, 2, 4]
    data = cls().encode()
    for size in (5, len(data) // 2, len(data) - 1):
        with pytest.raises(DecodeError, match=r"wide_msgs/msg/Wide\.\w+"):
            cls.decode(data[:size])


def test_table_coded_message_nested_in_a_generated_message_round_trips() -> None:
    text = f"uint8 before\nWide one\nWide[] many\nuint8[] after\n{LINE}\nMSG: wide_msgs/Wide\n{TEXT}"
    outer: Any = compile_definition("wide_msgs/msg/Outer", text)
    assert not issubclass(outer, TableCodedMessage)
    wide = next(field.cls for field in outer._TYPE.fields if field.ros_name == "one")
    message = outer(before=1, one=filled(wide, parts_of(wide)), many=[wide(c1=n) for n in range(3)], after=[1, 2])
    assert outer.decode(message.encode()) == message
    assert encode(outer.decode(memoryview(message.encode()), arrays=True)) == message.encode()
    assert isinstance(outer.decode(message.encode(), arrays=True).one.g2, np.ndarray)
    with pytest.raises(DecodeError, match=r"Outer\.many\[2\]\.\w+"):
        outer.decode(message.encode()[:-20])


def test_table_coded_messages_with_rclpy_api_have_value_types_of_rclpy(tmp_path: Path) -> None:
    for name, body in {"Wide": TEXT.split(LINE)[0], **PARTS}.items():
        path = tmp_path / "wide_msgs" / "msg" / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(body)
    (tmp_path / "wide_msgs" / "package.xml").write_text("<package><name>wide_msgs</name></package>")
    ours = compile_definition("wide_msgs/msg/Wide", TEXT)
    with hooked(message_api="rclpy", path=str(tmp_path)):
        cls = rclpy_class("wide_msgs/msg/Wide")
        assert issubclass(cls, TableCodedMessage)
        new = cls(b0="given")
        assert (new.l0, new.b0, new.b1, new.c1, cls.A0, cls.B0) == (b"\0", "given", "it is", -3, b"\7", "x")
        assert (
            type(new.j0).__name__ == "array" and new.e0.tolist() == [1, 2, 3] and cls.E0__DEFAULT.tolist() == [1, 2, 3]
        )
        assert new.encode() == ours(b0="given").encode() and cls.decode(new.encode()) == new
        with pytest.raises(AttributeError):
            cls.A0 = b"\1"


SIZE = 20_000
NUMBERS = itertools.count()
TEXTS = {
    "fields": lambda i: f"string a{i}\n",
    "sequences": lambda i: f"bool[] a{i}\n",
    "bounded": lambda i: f"string<=5[<=3] a{i}\n",
    "constants": lambda i: f"int8 A{i}=1\n",
    "defaults": lambda i: f"string a{i} 'abc'\n",
    "array defaults": lambda i: f"int8[] a{i} [1,2,3,4,5,6,7,8,9]\n",
    "comments": lambda i: f"int8 a{i} # x [m]\n",
    "types": lambda i: f"{'' if i else 'T0 a'}\n{LINE}\nMSG: memory_msgs/T{i}\n" + f"string a{i}\n" * (i < 400),
    "idl": lambda i: f"string a{i};",
    "idl declarators": lambda i: f"{'' if i else 'short b'},a{i}",
    "idl annotations": lambda i: f"@unit(value='m') @a short a{i};".replace("'", '"'),
}


OTHERS = "strings of an array", "a long default", "half a service", "a comment of idl"


def text_of(case: str, name: str) -> str:
    """Return a definition of the type ``memory_msgs/<kind>/<name>``."""
    match case:
        case "strings of an array":
            return "string[] a ['a'" + ",'a'" * (SIZE // 4) + "]\n"
        case "a long default":
            return "string a '" + "\\'x" * (SIZE // 3) + "'\n"
        case "half a service":
            return "".join(f"string a{i}\n" for i in range(SIZE // 12)) + "---\nbool ok\n"
        case "a comment of idl":
            comment = f"/*{'x ' * 10 * SIZE}*/"
            return f"module memory_msgs {{ module msg {{ {comment} struct {name} {{ short a; }}; }}; }};"
    pieces, size = list[str](), 0
    while size <= SIZE:
        pieces.append(TEXTS[case](len(pieces)))
        size += len(pieces[-1])
    text = "".join(pieces)
    if case.startswith("idl"):
        end = "" if text.endswith(";") else ";"
        return f"module memory_msgs {{ module msg {{ struct {name} {{ {text}{end} }}; }}; }};"
    return text


@pytest.mark.parametrize("case", [*TEXTS, *OTHERS])
def test_compiling_uses_memory_in_proportion_to_the_definition_size(case: str) -> None:
    """At most 50 MB and 100 times the size of a text; measured without what imports take, so with 10 MB.

    Two definitions are measured: CPython doubles its table of interned strings from time to time, which takes 7.7 MB at
    330 000 strings, whichever string is the next one. That falls into one of them at most.
    """
    kind = "srv" if case == "half a service" else "msg"
    compile_definition("memory_msgs/msg/First", "string a\n")
    peaks = []
    for name in (f"Q{next(NUMBERS)}", f"Q{next(NUMBERS)}"):
        text = text_of(case, name)
        gc.collect()
        tracemalloc.start()
        try:
            compile_definition(f"memory_msgs/{kind}/{name}", text)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert min(peaks) < 10e6 + 100 * len(text), f"{peaks} bytes for {len(text) >> 10} KiB"


def test_definitions_beyond_the_parser_limits_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(idl_parser, "MAX_TOKENS", 30_000)
    frame = "module q_msgs {{ module msg {{ struct Q {{ {} a; }}; }}; }};"
    for text, reason in (
        (frame.format("@a " * 16_000 + "short"), "more than 30000 words and signs"),
        (frame.format("sequence<" * 5000 + "short" + ">" * 5000), "sequences of sequences or arrays are not supported"),
        (frame.format("short") + "module a {" * 5000 + "};" * 5000, "nested too deeply"),
    ):
        with pytest.raises(DefinitionError, match=reason):
            compile_definition("q_msgs/msg/Q", text)
