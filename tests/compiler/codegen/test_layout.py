"""The layout plan: steps and offsets of small messages."""

from __future__ import annotations

import struct

import pytest
from support.interface_packages import texts

from rosidl_py_gen.compiler.codegen import layout_ir as ir
from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner

WORLD = {
    "a_msgs/msg/Point": "float64 x\nfloat64 y",
    "a_msgs/msg/Mixed": "uint8 a\nuint32 b",
    "a_msgs/msg/Named": "string name\nuint8 a",
    "a_msgs/msg/Empty": "",
    "a_msgs/msg/Big": "\n".join(f"uint8 f{i}" for i in range(60)),
}


def plan(text: str) -> ir.LayoutPlan:
    library = texts({"a_msgs/msg/Sample": text, **WORLD})
    return LayoutPlanner(library.message).plan("a_msgs/msg/Sample")


def show(steps: tuple[ir.LayoutStep, ...]) -> list[str]:
    return [_show(step) for step in steps]


def _show(step: ir.LayoutStep) -> str:
    match step:
        case ir.PackedRun(items, pack, unpack, size, align, nul, _):
            inside = " ".join(_item(item) for item in items)
            extra = f" align{align}" * (align > 1) + " nul" * nul
            return f"run {pack} {unpack} {size}{extra}: {inside}"
        case ir.InlineMessage(ref, kind, _, empty):
            return f"enter {ref.path} {kind}" + " empty" * empty
        case ir.StringContent(ref, kind, _):
            return f"text {ref.path}"
        case ir.StringTerminator():
            return "nul"
        case ir.NumberArray(ref, kind, code, _, pad, align, _):
            return f"numbers {ref.path} {code} pad{pad} align{align}"
        case ir.StringArray(ref, _, pad, align, _):
            return f"strings {ref.path} pad{pad} align{align}"
        case ir.Loop(ref, _, _, mode, body, stride, _, pad, align, _):
            return f"loop {ref.path} {mode.value} stride{stride} pad{pad} align{align} [{'; '.join(show(body))}]"
        case ir.NestedCall(ref, kind, _):
            return f"call {ref.path} {kind}"


def _item(item: object) -> str:
    match item:
        case ir.Scalar(ref, _, offset):
            return f"{ref.path}@{offset}"
        case ir.FixedNumberArray(ref, _, count, offset):
            return f"{ref.path}[{count}]@{offset}"
        case ir.LengthPrefix(ref, offset):
            return f"#{ref.path}@{offset}"
        case ir.EmptyMessageByte(offset):
            return f"dummy@{offset}"
    raise AssertionError(item)


PLANS = [
    ("", ["run x x 1: dummy@0"]),
    ("uint8 x", ["run B B 1: x@0"]),
    ("uint8 x\nuint32 y", ["run BxxxI BxxxI 8: x@0 y@4"]),
    ("uint8 x\nfloat64 y\nuint8 z", ["run B7xdB B7xdB 17: x@0 y@8 z@16"]),
    ("uint8[3] x\nuint16 y", ["run 3sxH 4xH 6: x[3]@0 y@4"]),
    ("Mixed m\nuint8 x", ["enter m a_msgs/msg/Mixed", "run B3xIB B3xIB 9: m.a@0 m.b@4 x@8"]),
    ("string x", ["run I I 4: #x@0", "text x", "nul"]),
    ("string x\nuint8 y", ["run I I 4: #x@0", "text x", "run B B 1 nul: y@0"]),
    ("string x\nuint32 y", ["run I I 4: #x@0", "text x", "run I I 4 align4 nul: y@0"]),
    ("wstring x\nuint32 y", ["run I I 4: #x@0", "text x", "run I I 4: y@0"]),
    ("uint8[] x", ["run I I 4: #x@0", "numbers x B pad0 align1"]),
    ("float64[] x", ["run I I 4: #x@0", "numbers x d pad4 align1"]),
    ("float64[<=2] x", ["run I I 4: #x@0", "numbers x d pad4 align1"]),
    ("string<=3 x", ["run I I 4: #x@0", "text x", "nul"]),
    ("wstring<=3 x", ["run I I 4: #x@0", "text x"]),
    ("Empty e\nuint8 x", ["enter e a_msgs/msg/Empty empty", "run xB xB 2: dummy@0 x@1"]),
    ("Big b\nuint8 x", ["call b a_msgs/msg/Big", "run B B 1: x@0"]),
    ("float64[1000] x", ["numbers x d pad0 align1"]),
    ("uint8[200000000] x", ["numbers x B pad0 align1"]),
]


@pytest.mark.parametrize(("text", "steps"), PLANS)
def test_a_message_is_planned_like_this(text: str, steps: list[str]) -> None:
    found = show(plan(text).steps)
    assert [one.replace("xxx", "3x") for one in found] == [one.replace("xxx", "3x") for one in steps]


def test_sequences_of_fixed_messages_are_packed_at_a_stride() -> None:
    (_, loop) = plan("Point[] points").steps
    assert isinstance(loop, ir.Loop)
    assert (loop.mode.value, loop.stride, loop.pad, loop.align) == ("packed", 16, 4, 1)


def test_sequences_of_varying_messages_are_written_in_line() -> None:
    (_, loop) = plan("Named[] names").steps
    assert isinstance(loop, ir.Loop)
    assert (loop.mode.value, loop.stride) == ("inline", 0)


def test_struct_codes_have_the_size_the_plan_says() -> None:
    for text, _ in PLANS:
        for step in plan(text).steps:
            if isinstance(step, ir.PackedRun):
                assert struct.calcsize("<" + step.pack) == struct.calcsize("<" + step.unpack) == step.size
