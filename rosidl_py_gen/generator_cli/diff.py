"""The command `diff`: compare two sets of definitions, and report breaking changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean, split_ros_name
from rosidl_py_gen.compiler.compatibility.compare import ChangeKind, compare, select_names
from rosidl_py_gen.compiler.frontend.registry import split_filter
from rosidl_py_gen.errors import printable
from rosidl_py_gen.generator_cli import diff_output
from rosidl_py_gen.generator_cli.diagnostics_output import print_json, print_line
from rosidl_py_gen.generator_cli.diff_sources import SourceError, load_sources, parse_source

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
    """Run the command and return its exit code: 1 for changes of a kind in `fail_on`."""
    old_source, new_source = parse_source(old), parse_source(new)
    with load_sources(old_source, new_source, paths, timeout_s) as (before, after):
        # A bag or node may use types that are defined outside of the folders with which it is compared.
        if not old_source.is_whole:
            after = after.with_types(before.facts.interfaces)
        if not new_source.is_whole:
            before = before.with_types(after.facts.interfaces)
        comparison = compare(
            before.facts, after.facts, old_is_whole=old_source.is_whole, new_is_whole=new_source.is_whole
        )
    if wanted := split_filter(selection):
        known = {*before.facts.interfaces, *after.facts.interfaces}
        names = [str(split_ros_name(name, "msg")) if "/" in name else name for name in wanted]
        for name in names:
            if name not in known and all(name != type_name.partition("/")[0] for type_name in known):
                raise SourceError(f"--filter {name}: neither {old} nor {new} has it{did_you_mean(name, known)}")
        comparison = select_names(comparison, names)
    breaking = sorted(one.value for one in comparison.consequences() & _failing(fail_on or _DEFAULT))
    notes = [*before.notes, *after.notes]
    if as_json:
        print_json(diff_output.document(old, new, comparison, breaking, notes))
    else:
        for note in notes:
            print_line(f"note: {printable(note)}", "yellow")
        diff_output.show(comparison, breaking)
    return 1 if breaking else 0


def _failing(chosen: Sequence[str]) -> frozenset[ChangeKind]:
    if "nothing" in chosen:
        return frozenset()
    return frozenset(ChangeKind if "any" in chosen else map(ChangeKind, chosen))
