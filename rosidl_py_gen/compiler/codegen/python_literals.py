"""Python source text for values, docstrings and comments that come from interface files.

Definition files are untrusted: all of their text that reaches generated code passes through this module and becomes a
literal of a plain type or text inside a docstring. Literals are spelled as `ruff format` spells them.
"""

from __future__ import annotations

import math
import textwrap
import unicodedata
from collections.abc import Iterable

_SHORT = {"\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}


def py_literal(value: bool | int | float | str) -> str:
    """Return Python source that evaluates to the scalar, as an object of the same type."""
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
    """Return text as a Python string literal: double quotes unless they need more escapes, unprintables escaped."""
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
    """Return a docstring with its quotes; all lines but the first are indented by `indent`."""
    safe = [_doc_line(line) for line in lines]
    while safe and not safe[0]:
        safe.pop(0)
    while safe and not safe[-1]:
        safe.pop()
    if not safe:
        return '""""""'
    safe[0] = safe[0].lstrip()
    if safe[0].startswith('"'):  # as formatters do for four quotes in a row
        safe[0] = " " + safe[0]
    if len(safe) == 1:
        open_quote = safe[0].endswith('"') and not safe[0].endswith('\\"\\"\\"')  # the second is escaped
        end = " " if open_quote else ""
        return f'"""{safe[0]}{end}"""'
    rest = textwrap.dedent("\n".join(safe[1:])).split("\n")  # formatters put the least indented line at the margin
    body = "\n".join(indent + line if line else "" for line in rest)
    return f'"""{safe[0]}\n{body}\n{indent}"""'


def visible(lines: tuple[str, ...]) -> tuple[str, ...]:
    """Return the docstring lines unchanged, or an empty tuple if nothing in them would be visible."""
    return lines if any(_doc_line(line) for line in lines) else ()


def _doc_line(line: str) -> str:
    """Return a line of text in a form that is safe in a docstring: it cannot end the docstring, start an escape, or
    hide characters.
    """
    line = line.expandtabs(4).rstrip().replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    if not line.isprintable():
        line = "".join(char if char.isprintable() else " " for char in line).rstrip()
    return line
