"""Compare two sets of definitions, and say whether the change breaks something."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean, split_ros_name
from rosidl_py_gen.compiler.compatibility.compare import ChangeKind, compare, select_names
from rosidl_py_gen.compiler.frontend.registry import split_filter
from rosidl_py_gen.errors import printable
from rosidl_py_gen.generator_cli import diagnostics_output, diff_output
from rosidl_py_gen.generator_cli.diff_sources import SourceError, opened, parse_source

if TYPE_CHECKING:
    from collections.abc import Sequence

_DEFAULT = ("data", "code")


def run(
    old: str,
    new: str,
    paths: tuple[str, ...],
    selection: str,
    fail_on: Sequence[str],
    timeout_s: float,
    as_json: bool,
) -> int:
    """Returns the exit code: 1 when what changed is of a sort that it shall fail on."""
    one, other = parse_source(old), parse_source(new)
    with opened(one, other, paths, timeout_s) as (then, now):
        # What a part of something uses may be defined outside of the folders that it is compared with.
        if not one.is_whole:
            now = now.with_types(then.facts.interfaces)
        if not other.is_whole:
            then = then.with_types(now.facts.interfaces)
        found = compare(then.facts, now.facts, old_is_whole=one.is_whole, new_is_whole=other.is_whole)
    if wanted := split_filter(selection):
        known = {*then.facts.interfaces, *now.facts.interfaces}
        full = [str(split_ros_name(name, "msg")) if "/" in name else name for name in wanted]
        for name in full:
            if name not in known and all(name != type_name.partition("/")[0] for type_name in known):
                raise SourceError(f"--filter {name}: neither {old} nor {new} has it{did_you_mean(name, known)}")
        found = select_names(found, full)
    sorts = found.sorts()
    breaking = sorted(sort.value for sort in sorts if sort in _failing(fail_on or _DEFAULT))
    notes = [*then.notes, *now.notes]
    if as_json:
        diagnostics_output.print_json(diff_output.document(old, new, found, breaking, notes))
    else:
        for note in notes:
            diagnostics_output.print_line(f"note: {printable(note)}", "yellow")
        diff_output.show(found, breaking)
    return 1 if breaking else 0


def _failing(chosen: Sequence[str]) -> frozenset[ChangeKind]:
    if "nothing" in chosen:
        return frozenset()
    return frozenset(ChangeKind if "any" in chosen else map(ChangeKind, chosen))
