"""One interface file or text -> one MessageDef, ServiceDef or ActionDef.

Splits .srv and .action at their separators and picks the parser by format. Collects problems instead of raising, so
that a run over many files shows them all.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import is_interface_name
from rosidl_py_gen.compiler.frontend import derived_interfaces
from rosidl_py_gen.compiler.frontend.model import Diagnostics, Interface, Location, MessageDef, SourceText
from rosidl_py_gen.compiler.frontend.msg_parser import parse_section
from rosidl_py_gen.errors import Diagnostic

if TYPE_CHECKING:
    from pathlib import Path

    from rosidl_py_gen.base.names import RosName

_ALMOST_SEPARATOR = re.compile(r"\s*(?:[-\u2010-\u2015\u2212_=*~]\s*){2,}(?:#.*)?")
"""A line that is meant to separate sections: too short or long, with blanks, a comment or other dashes."""
_SECTIONS: dict[str, tuple[str, ...]] = {
    "msg": ("",),
    "srv": ("Request", "Response"),
    "action": ("Goal", "Result", "Feedback"),
}


def read_source(path: Path, shown: str, findings: Diagnostics) -> SourceText | None:
    """The text of a file; None, with a finding, when it cannot be read as UTF-8."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        findings.problems.append(Diagnostic(shown, 0, 0, f"cannot be read: {error.strerror or error}"))
        return None
    try:
        text = raw.decode()
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - (before.rfind(b"\n") + 1) + 1
        findings.problems.append(
            Diagnostic(shown, line, column, f"expected UTF-8, found the byte {raw[error.start]:#04x}")
        )
        return None
    return SourceText(shown, text.replace("\r\n", "\n").replace("\r", "\n"), path.suffix[1:])


def parse_interface(name: RosName, source: SourceText, findings: Diagnostics) -> Interface | None:
    """Read one interface.

    Args:
        name: what the file's place says it is called.
        source: its text; `format` picks the grammar.
        findings: receives every problem.

    Returns:
        None when nothing usable came out; then `findings` says why.
    """
    if source.text.startswith("\ufeff"):
        findings.add(Location(source, 1, 1), "found a byte order mark; save the file as UTF-8 without one")
        source = source._replace(text=source.text[1:])
    if source.format == "idl":
        from rosidl_py_gen.compiler.frontend.idl_lowering import (
            parse_idl_interface,  # with lark, half as much again as all else here
        )

        return parse_idl_interface(name, source, findings)
    sections = _split(source.format, source, findings)
    if sections is None:
        return None
    messages: list[MessageDef] = []
    for suffix, (first_line, lines) in zip(_SECTIONS[source.format], sections, strict=True):
        own = derived_interfaces.derived_name(name, suffix) if suffix else name
        messages.append(parse_section(own, lines, first_line, source, findings))
    return derived_interfaces.assemble(name, messages, source)


def may_be_file(name: RosName) -> bool:
    """Whether a file may carry this name: with a service or action its halves have to have good names, too."""
    stems = [f"{name.name}_{suffix}" if suffix else name.name for suffix in _SECTIONS[name.kind]]
    return all(map(is_interface_name, stems))


def separators(text: str) -> int:
    """How many lines separate sections."""
    return sum(line == "---" for line in text.splitlines())


def _split(kind: str, source: SourceText, findings: Diagnostics) -> list[tuple[int, list[str]]] | None:
    lines = source.text.splitlines()
    cuts = [i for i, line in enumerate(lines) if line == "---"] if kind != "msg" else []
    wanted = len(_SECTIONS[kind]) - 1
    if len(cuts) != wanted:
        place = cuts[wanted] + 1 if len(cuts) > wanted else max(1, len(lines))
        near = next((i for i, line in enumerate(lines) if line != "---" and _ALMOST_SEPARATOR.fullmatch(line)), -1)
        noun = 'line "---"' if wanted == 1 else 'lines "---"'
        text = f"expected {wanted} {noun} in a .{kind} file, found {len(cuts)}"
        if near >= 0 and len(cuts) < wanted:
            place, text = (
                near + 1,
                f'expected the separator "---" alone in its line, found "{lines[near][:40]}"; {text}',
            )
        findings.add(Location(source, place, 1), text)
        return None
    bounds = [-1, *cuts, len(lines)]
    return [(start + 2, lines[start + 1 : end]) for start, end in pairwise(bounds)]
