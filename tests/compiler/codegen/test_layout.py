"""The layout plan: steps and offsets of small messages, and sizes against a brute-force count."""

from __future__ import annotations

import struct

import pytest
from compiler_worlds import texts
from hypothesis import given, settings
from hypothesis import strategies as st
from scale import examples

from rosidl_py_gen.compiler.codegen.plan import (
    Block,
    Call,
    Count,
    Dummy,
    Enter,
    Loop,
    Nul,
    Numbers,
    Plan,
    Run,
    Scalar,
    Step,
    Strings,
    Text,
)
from rosidl_py_gen.compiler.codegen.sources import Layouts
from rosidl_py_gen.compiler.spec.model import MessageDef
from rosidl_py_gen.compiler.spec.resolve import Library

WORLD = {
    "a_msgs/msg/Point": "float64 x\nfloat64 y",
    "a_msgs/msg/Mixed": "uint8 a\nuint32 b",
    "a_msgs/msg/Named": "string name\nuint8 a",
    "a_msgs/msg/Empty": "",
    "a_msgs/msg/Big": "\n".join(f"uint8 f{i}" for i in range(60)),
}


def plan(text: str) -> Plan:
    library = texts({"a_msgs/msg/Sample": text, **WORLD})
    return Layouts(library.message).plan("a_msgs/msg/Sample")


def show(steps: tuple[Step, ...]) -> list[str]:
    return [_show(step) for step in steps]


def _show(step: Step) -> str:
    match step:
        case Run(items, pack, unpack, size, align, nul, _):
            inside = " ".join(_item(item) for item in items)
            extra = f" align{align}" * (align > 1) + " nul" * nul
            return f"run {pack} {unpack} {size}{extra}: {inside}"
        case Enter(ref, kind, _, empty):
            return f"enter {ref.path} {kind}" + " empty" * empty
        case Text(ref, kind, _):
            return f"text {ref.path}"
        case Nul():
            return "nul"
        case Numbers(ref, kind, code, _, pad, align, _):
            return f"numbers {ref.path} {code} pad{pad} align{align}"
        case Strings(ref, _, pad, align, _):
            return f"strings {ref.path} pad{pad} align{align}"
        case Loop(ref, _, _, mode, body, stride, _, pad, align, _):
            return f"loop {ref.path} {mode.value} stride{stride} pad{pad} align{align} [{'; '.join(show(body))}]"
        case Call(ref, kind, _):
            return f"call {ref.path} {kind}"


def _item(item: object) -> str:
    match item:
        case Scalar(ref, _, offset):
            return f"{ref.path}@{offset}"
        case Block(ref, _, count, offset):
            return f"{ref.path}[{count}]@{offset}"
        case Count(ref, offset):
            return f"#{ref.path}@{offset}"
        case Dummy(offset):
            return f"dummy@{offset}"
    raise AssertionError(item)


PLANS = [
    ("", ["run x x 1: dummy@0"], 1, 1),
    ("uint8 x", ["run B B 1: x@0"], 1, 1),
    ("uint8 x\nuint32 y", ["run BxxxI BxxxI 8: x@0 y@4"], 8, 8),
    ("uint8 x\nfloat64 y\nuint8 z", ["run B7xdB B7xdB 17: x@0 y@8 z@16"], 17, 17),
    ("uint8[3] x\nuint16 y", ["run 3sxH 4xH 6: x[3]@0 y@4"], 6, 6),
    ("Mixed m\nuint8 x", ["enter m a_msgs/msg/Mixed", "run B3xIB B3xIB 9: m.a@0 m.b@4 x@8"], 9, 9),
    ("string x", ["run I I 4: #x@0", "text x", "nul"], None, None),
    ("string x\nuint8 y", ["run I I 4: #x@0", "text x", "run B B 1 nul: y@0"], None, None),
    ("string x\nuint32 y", ["run I I 4: #x@0", "text x", "run I I 4 align4 nul: y@0"], None, None),
    ("wstring x\nuint32 y", ["run I I 4: #x@0", "text x", "run I I 4: y@0"], None, None),
    ("uint8[] x", ["run I I 4: #x@0", "numbers x B pad0 align1"], None, None),
    ("float64[] x", ["run I I 4: #x@0", "numbers x d pad4 align1"], None, None),
    ("float64[<=2] x", ["run I I 4: #x@0", "numbers x d pad4 align1"], None, 24),
    ("string<=3 x", ["run I I 4: #x@0", "text x", "nul"], None, 17),
    ("wstring<=3 x", ["run I I 4: #x@0", "text x"], None, 28),
    ("Empty e\nuint8 x", ["enter e a_msgs/msg/Empty empty", "run xB xB 2: dummy@0 x@1"], 2, 2),
    ("Big b\nuint8 x", ["call b a_msgs/msg/Big", "run B B 1: x@0"], 61, 61),
    ("float64[1000] x", ["numbers x d pad0 align1"], 8000, 8000),
    ("uint8[200000000] x", ["numbers x B pad0 align1"], 200_000_000, 200_000_000),
]


@pytest.mark.parametrize(("text", "steps", "fixed", "largest"), PLANS)
def test_a_message_is_planned_like_this(text: str, steps: list[str], fixed: int | None, largest: int | None) -> None:
    found = plan(text)
    assert [one.replace("xxx", "3x") for one in show(found.steps)] == [one.replace("xxx", "3x") for one in steps]
    assert (found.fixed_size, found.max_size) == (fixed, largest)


def test_sequences_of_fixed_messages_are_packed_at_a_stride() -> None:
    (_, loop) = plan("Point[] points").steps
    assert isinstance(loop, Loop)
    assert (loop.mode.value, loop.stride, loop.pad, loop.align) == ("packed", 16, 4, 1)


def test_sequences_of_varying_messages_are_written_in_line() -> None:
    (_, loop) = plan("Named[] names").steps
    assert isinstance(loop, Loop)
    assert (loop.mode.value, loop.stride) == ("inline", 0)


def test_struct_codes_have_the_size_the_plan_says() -> None:
    for text, *_ in PLANS:
        for step in plan(text).steps:
            if isinstance(step, Run):
                assert struct.calcsize("<" + step.pack) == struct.calcsize("<" + step.unpack) == step.size


# --- sizes by brute force ---------------------------------------------------------------------------------------------

SIZES = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}


def largest(library: Library, definition: MessageDef, position: int) -> int | None:
    """The end of the largest message, every bounded thing full of its largest elements.

    Source: docs/internals/protocol.md 2.
    """
    if not definition.fields:
        return position + 1
    for item in definition.fields:
        kind = item.type
        count = 1
        if kind.arity.name == "UNBOUNDED":
            return None
        if kind.arity.name == "BOUNDED":
            position += -position % 4 + 4
        if kind.arity.name != "SCALAR":
            count = kind.capacity
        for _ in range(count):
            if kind.primitive:
                size = SIZES[kind.base]
                position += -position % size + size
            elif kind.is_string:
                if not kind.string_bound:
                    return None
                wide = kind.base == "wstring"
                position += -position % 4 + 4 + (8 * kind.string_bound if wide else 4 * kind.string_bound + 1)
            else:
                inner = library.message(kind.base)
                assert inner is not None
                end = largest(library, inner, position)
                if end is None:
                    return None
                position = end
    return position


def fixed(library: Library, definition: MessageDef) -> bool:
    return all(
        item.type.arity.name in ("SCALAR", "ARRAY")
        and not item.type.is_string
        and (not item.type.is_message or fixed(library, library.message(item.type.base) or definition))
        for item in definition.fields
    )


_PRIMITIVE = st.sampled_from(sorted(SIZES))
_TYPE = st.one_of(
    st.builds(lambda base, size: base + size, _PRIMITIVE, st.sampled_from(["", "", "[3]", "[<=5]", "[200]"])),
    st.sampled_from(["string<=3", "wstring<=2", "string<=2[2]", "wstring<=3[<=3]"]),
    st.sampled_from(["Inner", "Inner[3]", "Inner[<=9]", "Inner[17]", "Empty", "Empty[2]"]),
    st.sampled_from(["string", "uint8[]"]),
)
_FLAT = st.lists(st.one_of(_PRIMITIVE, st.sampled_from(["string<=1", "uint8[3]", "float64[<=1]"])), max_size=4)


@settings(max_examples=examples(200), deadline=None)
@given(inner=_FLAT, outer=st.lists(_TYPE, min_size=1, max_size=5))
def test_sizes_are_those_of_a_brute_force_count(inner: list[str], outer: list[str]) -> None:
    def lines(kinds: list[str]) -> str:
        return "\n".join(f"{kind} f{i}" for i, kind in enumerate(kinds))

    library = texts({"a_msgs/msg/Inner": lines(inner), "a_msgs/msg/Empty": "", "a_msgs/msg/Outer": lines(outer)})
    definition = library.message("a_msgs/msg/Outer")
    assert definition is not None
    found = Layouts(library.message).plan("a_msgs/msg/Outer")
    wanted = largest(library, definition, 0)
    assert found.max_size == wanted
    assert found.fixed_size == (wanted if fixed(library, definition) else None)


def test_the_size_of_a_huge_array_is_found_without_walking_it() -> None:
    library = texts({"a_msgs/msg/A": "Inner[500000] x", "a_msgs/msg/Inner": "float64 x\nuint8 y"})
    assert Layouts(library.message).plan("a_msgs/msg/A").max_size == 16 * 500_000 - 7
