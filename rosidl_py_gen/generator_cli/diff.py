"""The command `diff`: compare two sets of definitions, report breaking changes, and print them as text or JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import did_you_mean, split_ros_name
from rosidl_py_gen.compiler.compatibility.compare import ChangeKind, compare, select_names
from rosidl_py_gen.compiler.frontend.registry import split_filter
from rosidl_py_gen.errors import printable
from rosidl_py_gen.generator_cli.diagnostics_output import echo, print_json, print_line
from rosidl_py_gen.generator_cli.diff_sources import SourceError, load_sources, parse_source

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.compatibility.compare import Comparison, ElementChange, MessageChange, TypeChange

_DEFAULT = ("data", "code")
_SIGNS = {"added": "+", "removed": "-"}
_COLOURS = {"+": "green", "-": "red", "~": "yellow"}


def diff(
    old: str, new: str, paths: tuple[str, ...], selection: str, fail_on: Sequence[str], timeout_s: float, as_json: bool
) -> int:
    """Compare two sources and print the changes; return 1 if a change is of a kind in `fail_on` (empty: default)."""
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
        print_json(_document(old, new, comparison, breaking, notes))
    else:
        for note in notes:
            print_line(f"note: {printable(note)}", "yellow")
        _show(comparison, breaking)
    return 1 if breaking else 0


def _failing(chosen: Sequence[str]) -> frozenset[ChangeKind]:
    if "nothing" in chosen:
        return frozenset()
    return frozenset(ChangeKind if "any" in chosen else map(ChangeKind, chosen))


def _show(found: Comparison, breaking: Sequence[str]) -> None:
    for name in found.removed:
        _line(f"- {name}", "red")
    for name in found.added:
        _line(f"+ {name}", "green")
    for one in found.changed:
        _line(f"~ {one.name}", "yellow")
        for text, colour in _details(one):
            _line(f"    {text}", colour)
    if found.not_compared:
        names = ", ".join(found.not_compared)
        _line(f"not compared, as only one side has them: {names}")
    counts = (
        f"{len(found.changed)} changed, {len(found.added)} added, {len(found.removed)} removed, "
        f"{len(found.same)} unchanged"
    )
    consequences = ", ".join(sorted(one.value for one in found.consequences()))
    parts = [counts, *([f"changes of {consequences}"] if consequences else [])]
    _line("; ".join([*parts, f"breaking: {', '.join(breaking)}" if breaking else "not breaking"]))


def _line(text: str, colour: str = "") -> None:
    echo((printable(text), colour))


def _details(change: TypeChange) -> Iterator[tuple[str, str]]:
    is_one = [one.name for one in change.messages] == [change.name]
    if not is_one:
        yield from _hashes(change)
    for message in change.messages:
        indent = "" if is_one else "  "
        if not is_one:
            yield message.name.removeprefix(f"{change.name}_"), "yellow"
        for text, colour in _message_lines(message):
            yield indent + text, colour
    if change.used_by:
        yield f"changes with it: {', '.join(change.used_by)}", ""


def _hashes(change: TypeChange | MessageChange) -> Iterator[tuple[str, str]]:
    if change.old_hash == change.new_hash:
        yield f"hash      {change.old_hash}, as before", ""
    else:
        yield f"hash      {change.old_hash}", ""
        yield f"       -> {change.new_hash}", ""


def _message_lines(change: MessageChange) -> Iterator[tuple[str, str]]:
    yield from _hashes(change)
    for kind, changes in (("field   ", change.fields), ("constant", change.constants)):
        for one in changes:
            sign, text = _sign_and_text(one)
            yield f"{kind}  {sign} {text}{f'  ({one.place})' if one.place else ''}", _COLOURS[sign]
    if change.through:
        yield f"contains  ~ {', '.join(change.through)}", ""
    yield ("old data  read as before", "") if change.reads_old_data else ("old data  not read as before", "red")


def _sign_and_text(one: ElementChange) -> tuple[str, str]:
    match one.what:
        case "added" | "removed":
            return _SIGNS[one.what], f"{one.name}: {one.after or one.before}"
        case "renamed":
            return "~", f"{one.after}: was {one.before}, probably"
        case "moved":
            return "~", f"{one.name}: moved from place {one.before} to {one.after}"
        case "type" | "changed":
            return "~", f"{one.name}: {one.before} -> {one.after}"
        case _:
            return "~", f"{one.name}: {one.what} {one.before or 'none'} -> {one.after or 'none'}"


def _document(old: str, new: str, found: Comparison, breaking: Sequence[str], notes: Sequence[str]) -> dict[str, Any]:
    return {
        "old": old,
        "new": new,
        "added": list(found.added),
        "removed": list(found.removed),
        "changed": [
            {
                "name": one.name,
                "old_hash": one.old_hash,
                "new_hash": one.new_hash,
                "sorts": sorted(consequence.value for consequence in one.consequences()),
                "used_by": list(one.used_by),
                "messages": [_message(message) for message in one.messages],
            }
            for one in found.changed
        ],
        "not_compared": list(found.not_compared),
        "unchanged": len(found.same),
        "sorts": sorted(consequence.value for consequence in found.consequences()),
        "breaking": list(breaking),
        "notes": list(notes),
    }


def _message(change: MessageChange) -> dict[str, Any]:
    return {
        "name": change.name,
        "old_hash": change.old_hash,
        "new_hash": change.new_hash,
        "fields": [_entry(one) for one in change.fields],
        "constants": [_entry(one) for one in change.constants],
        "contains": list(change.through),
        "reads_old_data": change.reads_old_data,
    }


def _entry(one: ElementChange) -> dict[str, Any]:
    entry = one._asdict()
    entry["sort"] = entry.pop("consequence").value
    return entry
