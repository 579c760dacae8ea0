"""Write the table of the definitions that ROS 2 distributions do not share into `docs/reference/compatibility.md`.

Run it as ``python tools/record_distribution_changes.py``; `tests/core/docs/test_compatibility_matrix.py` compares. Rows
are what ``rosidl-py-gen diff --distro OLD --distro NEW`` finds for each distribution and the one before it.
"""

from __future__ import annotations

import re
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.generator_cli.compare import compare
from rosidl_py_gen.generator_cli.diff import DiffSource, load_sources

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from rosidl_py_gen.generator_cli.compare import TypeChange

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "compatibility.md"
_TABLE = re.compile(r"(?<=\| Since \| Definition \| Change \|\n\|---\|---\|---\|\n)(?:\|.*\n)+")


def rows() -> Iterator[str]:
    """The rows of the table."""
    for old, new in pairwise(Distribution.BUNDLED):
        with load_sources(DiffSource("distro", old), DiffSource("distro", new), (), 0) as (before, after):
            found = compare(before.facts, after.facts)
        since = new.capitalize()
        for change in found.changed:
            text = _change(change)
            if text:
                yield f"| {since} | `{_short(change.name)}` | {text} |\n"
        for word, names, others in (
            ("new", found.added, before.facts.interfaces),
            ("removed", found.removed, after.facts.interfaces),
        ):
            for shown in _grouped(names, others):
                yield f"| {since} | {shown} | {word} |\n"


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _grouped(names: Iterable[str], others: Mapping[str, object]) -> Iterator[str]:
    """The names of one package together; a package that the other side lacks by its name."""
    for package, group in groupby(sorted(names), lambda name: name.partition("/")[0]):
        if any(name.startswith(f"{package}/") for name in others):
            yield ", ".join(f"`{_short(name)}`" for name in group)
        else:
            yield f"package `{package}`"


def _change(change: TypeChange) -> str:
    """Return the changes of the text itself; empty for types that only contain a changed one."""
    parts = []
    for message in change.messages:
        for field in message.fields:
            match field.what:
                case "added":
                    parts.append(f"`{field.name}` added")
                case "removed":
                    parts.append(f"`{field.name}` removed")
                case "unit":
                    continue
                case "default":
                    parts.append(f"default of `{field.name}`")
                case _:
                    parts.append(f"`{field.name}`: `{field.before}`, then `{field.after}`")
        constants = [one.name for one in message.constants]
        if constants:
            parts.append(f"constants {', '.join(f'`{one}`' for one in constants)}")
    text = "; ".join(parts)
    return f"{text}; **other bytes**" if text and change.old_hash != change.new_hash else text


def page(text: str) -> str:
    """The text of the page with the present rows."""
    assert _TABLE.search(text), f"{PAGE} has no table with the header | Since | Definition | Change |"
    return _TABLE.sub(lambda _: "".join(rows()), text)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
