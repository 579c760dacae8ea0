"""Python source text for values, docstrings and comments that come from interface files.

Definition files are untrusted: everything of theirs that reaches generated code passes through here, and comes out as a
literal of a plain type or as text inside a docstring. The spelling is the one `ruff format` leaves alone.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable

_SHORT = {"\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}


def py_literal(value: bool | int | float | str) -> str:
    """A scalar as a Python expression of its own type."""
    if isinstance(value, str):
        return py_string(value)
    if isinstance(value, float):
        if math.isnan(value):
            return 'float("nan")'
        if math.isinf(value):
            return 'float("inf")' if value > 0 else 'float("-inf")'
    return repr(value)


def py_string(text: str) -> str:
    """A string literal; double quotes unless that needs more escapes, everything unprintable escaped."""
    quote = "'" if text.count('"') > text.count("'") else '"'
    return quote + "".join(_character(char, quote) for char in text) + quote


def _character(char: str, quote: str) -> str:
    if char == quote:
        return "\\" + char
    if char in _SHORT:
        return _SHORT[char]
    if char.isprintable() and unicodedata.category(char) != "Cf":
        return char
    code = ord(char)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def docstring(lines: Iterable[str], indent: str) -> str:
    """A docstring of the given lines, quotes included, indented for a body at `indent` (first line not indented)."""
    safe = [_doc_line(line) for line in lines]
    while safe and not safe[0]:
        safe.pop(0)
    while safe and not safe[-1]:
        safe.pop()
    if not safe:
        return '""""""'
    safe[0] = safe[0].lstrip()
    if len(safe) == 1:
        end = " " if safe[0].endswith('"') else ""
        return f'"""{safe[0]}{end}"""'
    body = "\n".join(indent + line if line else "" for line in safe[1:])
    return f'"""{safe[0]}\n{body}\n{indent}"""'


def _doc_line(line: str) -> str:
    """One line that cannot end the docstring, start an escape, or hide characters."""
    line = line.expandtabs(4).rstrip().replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    return "".join(char if char.isprintable() else " " for char in line).rstrip()
