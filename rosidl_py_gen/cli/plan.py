"""Print the layout plan of a message."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cli import reports
from rosidl_py_gen.compiler.codegen.layout import Layouts
from rosidl_py_gen.compiler.codegen.plan import (
    Block,
    Call,
    Count,
    Dummy,
    Enter,
    Item,
    Loop,
    Nul,
    Numbers,
    Plan,
    Run,
    Scalar,
    Start,
    Step,
    Strings,
    Text,
    assert_never,
)
from rosidl_py_gen.compiler.generate import load
from rosidl_py_gen.compiler.spec.find import search_path
from rosidl_py_gen.compiler.spec.model import messages_of
from rosidl_py_gen.compiler.spec.resolve import Library
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.types.generated import generated_library

Row = tuple[int, str, str, str, str]  # depth, offset, size in bytes, what, contents


def run(name: str, paths: tuple[str, ...], as_json: bool) -> int:
    """Returns the exit code."""
    top = split_ros_name(name, "msg")
    search = search_path(paths)
    owner = Library(search).owner(top) or top
    generated = generated_library(str(top)) if search.file(owner) is None else None
    library = generated[0] if generated is not None else load(search, [str(owner)])[0]
    if library.message(str(top)) is None:
        interface = library.interface(owner)
        parts = ", ".join(str(message.name) for message in messages_of(interface)) if interface else "none"
        raise TypeNotFoundError(f"{top} is not a message; the messages of {owner} are {parts}")
    plan = Layouts(library.message).plan(str(top))
    rows = list(_rows(plan.steps, 0))
    columns = ("depth", "offset", "bytes", "step", "contents")
    if as_json:
        steps = [dict(zip(columns, row, strict=True)) for row in rows]
        reports.print_json(
            {"name": plan.name, "fixed_size": plan.fixed_size, "max_size": plan.max_size, "steps": steps}
        )
        return 0
    _print(plan, rows)
    return 0


def _print(plan: Plan, rows: list[Row]) -> None:
    reports.echo((plan.name, "bold"))
    if plan.fixed_size is not None:
        reports.echo(f"fixed size: {plan.fixed_size} bytes behind the 4-byte header")
    else:
        most = "unbounded" if plan.max_size is None else f"at most {plan.max_size} bytes behind the 4-byte header"
        reports.echo(f"variable size: {most}")
    if plan.heavy:
        reports.echo(f"{plan.weight} leaves: others call it instead of writing it in line")
    reports.echo(f"{'offset':>10}  {'bytes':>10}  step")
    for depth, offset, size, what, contents in rows:
        reports.echo(f"{offset:>10}  {size:>10}  {'    ' * depth}", (what, "cyan"), f" {contents}")


def _rows(steps: Iterable[Step], depth: int) -> Iterator[Row]:
    for step in steps:
        match step:
            case Enter():
                yield depth, "", "", "enter", f"{step.ref.path}: {step.type}"
            case Run():
                items = ", ".join(_item(item) for item in step.items)
                nul = "NUL, " if step.nul else ""
                yield depth, _at(step.start, step.align), str(step.size), "run", f"{nul}{items}"
            case Text():
                yield depth, _at(step.start, 1), "length", "text", f"{step.ref.path}: {step.type}"
            case Nul():
                yield depth, _at(step.start, 1), "1", "NUL", ""
            case Numbers():
                size = f"{step.item_size} each"
                yield depth, _at(step.start, step.align, step.pad), size, "numbers", f"{step.ref.path}: {step.type}"
            case Strings():
                yield depth, _at(step.start, step.align, step.pad), "", "strings", f"{step.ref.path}: {step.type}"
            case Loop():
                size = f"{step.stride} each" if step.stride else ""
                yield (
                    depth,
                    _at(step.start, step.align, step.pad),
                    size,
                    "loop",
                    (f"{step.ref.path}: {step.type} ({step.mode.value})"),
                )
                yield from _rows(step.body, depth + 1)
            case Call():
                yield depth, _at(step.start, 1), "", "call", f"{step.ref.path}: {step.type}"
            case _:
                assert_never(step)


def _at(start: Start, align: int, pad: int = 0) -> str:
    """``12`` exact, ``?`` unknown, ``?%4`` a multiple of 4, ``?>8`` aligned to 8 before the step."""
    if start.static is not None:
        return str(start.static + pad)
    if align > 1:
        return f"?>{align}"
    if start.modulus > 1:
        return f"?%{start.modulus}" + (f"+{start.remainder}" if start.remainder else "")
    return "?"


def _item(item: Item) -> str:
    match item:
        case Scalar(ref, code, offset):
            return f"{ref.path} {code}@{offset}"
        case Block(ref, code, count, offset):
            return f"{ref.path} {count}{code}@{offset}"
        case Count(ref, offset):
            return f"count of {ref.path}@{offset}"
        case Dummy(offset):
            return f"empty message@{offset}"
        case _:
            assert_never(item)
