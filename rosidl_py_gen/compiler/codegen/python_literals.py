"""Python source text for values, docstrings and comments that come from interface files.

Definition files are untrusted: everything of theirs that reaches generated code passes through here, and comes out as a
literal of a plain type or as text inside a docstring. The spelling is the one `ruff format` leaves alone.
"""

from __future__ import annotations

import math
import textwrap
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
        return repr(value).replace("e+", "e")
    return repr(value)


def py_string(text: str) -> str:
    """A string literal; double quotes unless that needs more escapes, everything unprintable escaped."""
    quote = "'" if text.count('"') > text.count("'") else '"'
    if text.isascii() and text.isprintable():
        return quote + text.replace("\\", "\\\\").replace(quote, "\\" + quote) + quote
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
    if safe[0].startswith('"'):  # what formatters do with four quotes in a row
        safe[0] = " " + safe[0]
    if len(safe) == 1:
        open_quote = safe[0].endswith('"') and not safe[0].endswith('\\"\\"\\"')  # the second is escaped
        end = " " if open_quote else ""
        return f'"""{safe[0]}{end}"""'
    rest = textwrap.dedent("\n".join(safe[1:])).split("\n")  # formatters put the least indented line at the margin
    body = "\n".join(indent + line if line else "" for line in rest)
    return f'"""{safe[0]}\n{body}\n{indent}"""'


def visible(lines: tuple[str, ...]) -> tuple[str, ...]:
    """The lines, or none when a docstring of them would be empty."""
    return lines if any(_doc_line(line) for line in lines) else ()


def _doc_line(line: str) -> str:
    """One line that cannot end the docstring, start an escape, or hide characters."""
    line = line.expandtabs(4).rstrip().replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    if not line.isprintable():
        line = "".join(char if char.isprintable() else " " for char in line).rstrip()
    return line
