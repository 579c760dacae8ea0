"""Printable text and JSON for terminals, made from untrusted data, and the rule for logging repeated events.

Commands print only text of these functions or of `errors.printable`: text of peers, of definition files and of
recordings could otherwise control a terminal, or reorder its output. `is_logged` selects which occurrences of an event
are logged if the number of events depends on peers.
"""

from __future__ import annotations

import json
import math
import re
import sys
from typing import Any

from rosidl_py_gen.errors import printable

_SPECIAL = re.compile("[^\n -~]")


def printable_lines(text: str) -> str:
    """Return the text with U+FFFD in place of characters that control a terminal; line breaks and tabs stay."""
    lines = text.replace("\r\n", "\n").split("\n")
    return "\n".join("\t".join(map(printable, line.split("\t"))) for line in lines)


def printable_line(text: str) -> str:
    r"""Return the text as one printable line: line breaks and tabs become ``\n``, ``\r`` and ``\t``.

    Other characters that control a terminal become U+FFFD.
    """
    return printable(text.replace("\n", "\\n").replace("\r", "\\r").replace("\t", "\\t"))


def pluralize(number: int, noun: str) -> str:
    """Return a count with its noun: ``1 server``, ``2 servers``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def print_next_step(*words: str) -> None:
    """Print a command that users probably call next, after the word ``next:`` on standard error, if that is
    a terminal.
    """
    if sys.stdout.isatty() and sys.stderr.isatty():
        print(printable_line(f"next: {' '.join(words)}"), file=sys.stderr, flush=True)


def json_text(data: Any, *, indent: int | None = None, for_terminal: bool = True) -> str:
    """Return a value as JSON text, on one line or indented; NaN and the infinities become strings.

    Args:
        for_terminal: unprintable characters become escapes.
    """
    try:
        text = json.dumps(data, ensure_ascii=False, allow_nan=False, indent=indent)
    except ValueError:
        text = json.dumps(_finite(data), ensure_ascii=False, allow_nan=False, indent=indent)
    return escape_json(text) if for_terminal else text


def _finite(value: Any) -> Any:
    """Return a plain value (dicts, lists, scalars) in which NaN and the infinities are replaced by strings, as JSON has
    none.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def escape_json(text: str) -> str:
    r"""Return equivalent JSON text with unprintable characters as ``\u`` escapes."""
    return _SPECIAL.sub(_escaped, text)


def _escaped(found: re.Match[str]) -> str:
    char = found[0]
    if char.isprintable():
        return char
    units = char.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[at : at + 4]}" for at in range(0, len(units), 4))


_MAX_FIRST = 10
"""Number of occurrences of an event that are all logged before occurrences are skipped. There are rarely more different
causes, such as programs on one topic."""


def is_logged(count: int) -> bool:
    """Return True if occurrence `count` of an event should be logged: 1 to `_MAX_FIRST`, then 16, 32, 64 and so on.

    A limit for each second would lose messages at the start of a program, when several causes are found at once.
    """
    return count <= _MAX_FIRST or not count & (count - 1)
