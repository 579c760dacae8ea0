"""Error of a command, and its text on standard error."""

from __future__ import annotations

import os
import sys

from rosidl_py_gen.base.terminal_text import printable_line
from rosidl_py_gen.errors import RosidlError, printable


class CommandError(RosidlError):
    """Raised if a command cannot do what the user requests; the text has the reason and the fix."""


def report(text: str) -> None:
    """Print an error on standard error: on one line, or with the source line and caret that `text` contains.

    As the text may contain names of peers, line breaks are escaped and control characters replaced.
    """
    if sys.stderr is None:  # closed before the process started
        return
    head, *rest = text.split("\n    ")
    has_caret = len(rest) == 2 and rest[1].strip() == "^"
    lines = "\n    ".join(map(printable, (head, *rest))) if has_caret else printable_line(text)
    try:
        # Consoles of Windows print escape sequences as text, unless a program has configured them.
        is_red = os.name != "nt" and sys.stderr.isatty() and not os.environ.get("NO_COLOR")
    except (AttributeError, ValueError):  # a program has replaced or closed the stream
        is_red = False
    print(f"\x1b[31merror: {lines}\x1b[0m" if is_red else f"error: {lines}", file=sys.stderr, flush=True)
