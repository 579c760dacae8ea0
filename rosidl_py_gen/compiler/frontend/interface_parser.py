"""Parser of one interface file or text, which returns a MessageDef, ServiceDef or ActionDef.

The parser splits .srv and .action files at their separators and selects the language by format. Diagnostics are
collected, not raised, so that a run over many files reports all of them.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import is_interface_name
from rosidl_py_gen.compiler.frontend.model import (
    SECTIONS,
    Diagnostics,
    Interface,
    Location,
    SourceText,
    assemble,
    section_names,
)
from rosidl_py_gen.compiler.frontend.msg_parser import parse_section
from rosidl_py_gen.errors import Diagnostic

if TYPE_CHECKING:
    from pathlib import Path

    from rosidl_py_gen.base.names import RosName

_ALMOST_SEPARATOR = re.compile(r"\s*(?:[-\u2010-\u2015\u2212_=*~]\s*){2,}(?:#.*)?")
"""Pattern of a line that was probably meant as the separator ``---``: too short or too long, with blanks, with a
comment, or with other dashes."""


def read_source(path: Path, display: str, diagnostics: Diagnostics) -> SourceText | None:
    """Return the text of a definition file; None, after a diagnostic, if the file cannot be read as UTF-8."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        diagnostics.items.append(Diagnostic(display, 0, 0, f"cannot be read: {error.strerror or error}"))
        return None
    try:
        text = raw.decode()
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - (before.rfind(b"\n") + 1) + 1
        diagnostics.items.append(
            Diagnostic(display, line, column, f"expected UTF-8, found the byte {raw[error.start]:#04x}")
        )
        return None
    return SourceText(display, text.replace("\r\n", "\n").replace("\r", "\n"), path.suffix[1:])


def parse_interface(name: RosName, source: SourceText, diagnostics: Diagnostics) -> Interface | None:
    """Return the interface that a definition text defines; None, after a diagnostic, if the text cannot be used."""
    if source.text.startswith("\ufeff"):
        diagnostics.add(Location(source, 1, 1), "found a byte order mark; save the file as UTF-8 without one")
        source = source._replace(text=source.text[1:])
    if source.format == "idl":
        # The import of lark takes half as much time as all other imports of the compiler.
        from rosidl_py_gen.compiler.frontend.idl_lowering import parse_idl_interface

        return parse_idl_interface(name, source, diagnostics)
    sections = _split(source.format, source, diagnostics)
    if sections is None:
        return None
    messages = [
        parse_section(own, lines, first_line, source, diagnostics)
        for own, (first_line, lines) in zip(section_names(name, source.format), sections, strict=True)
    ]
    return assemble(name, messages, source)


def may_be_file(name: RosName) -> bool:
    """Return True if a file may define an interface of this name: all messages in the file must have valid names."""
    return all(is_interface_name(section.name) for section in section_names(name, name.kind))


def separators(text: str) -> int:
    """Return the number of separator lines (``---``) in a .srv or .action text."""
    return sum(line == "---" for line in text.splitlines())


def _split(kind: str, source: SourceText, diagnostics: Diagnostics) -> list[tuple[int, list[str]]] | None:
    lines = source.text.splitlines()
    cuts = [i for i, line in enumerate(lines) if line == "---"] if kind != "msg" else []
    wanted = len(SECTIONS[kind]) - 1
    if len(cuts) != wanted:
        place = cuts[wanted] + 1 if len(cuts) > wanted else max(1, len(lines))
        near = next((i for i, line in enumerate(lines) if line != "---" and _ALMOST_SEPARATOR.fullmatch(line)), -1)
        noun = 'line "---"' if wanted == 1 else 'lines "---"'
        text = f"expected {wanted} {noun} in a .{kind} file, found {len(cuts)}"
        if near >= 0 and len(cuts) < wanted:
            place = near + 1
            text = f'expected the separator "---" alone in its line, found "{lines[near][:40]}"; {text}'
        diagnostics.add(Location(source, place, 1), text)
        return None
    bounds = [-1, *cuts, len(lines)]
    return [(start + 2, lines[start + 1 : end]) for start, end in pairwise(bounds)]
