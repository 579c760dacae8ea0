"""Output of `rosidl-py-gen`: text, diagnostics and notes, on a terminal and as JSON.

All modules of the command line print by these functions, because names and texts of definitions are not trusted.
"""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import click

from rosidl_py_gen.base.interrupts import BROKEN_PIPE
from rosidl_py_gen.base.terminal_text import json_text, pluralize, printable_lines
from rosidl_py_gen.errors import Diagnostic, printable


def rows(problems: Iterable[Diagnostic]) -> list[dict[str, str | int]]:
    """Return diagnostics as rows for JSON output, each with path, line, column and text."""
    return [{"path": one.path, "line": one.line, "column": one.column, "text": one.text} for one in problems]


def usage_error_text(error: click.ClickException) -> str:
    """Return the usage and text of an error of click, with ``error:`` instead of click's ``Error:``."""
    shown = io.StringIO()
    error.show(shown)
    return re.sub(r"^Error: ", "error: ", shown.getvalue().rstrip("\n"), flags=re.MULTILINE)


def print_json(data: Any) -> None:
    """Print a value as indented JSON on standard output."""
    echo(json_text(data, indent=2))


def echo(*parts: str | tuple[str, str], err: bool = False) -> None:
    """Print joined parts and a line break; a part is a text, or a text and its style (``"bold"`` or a colour)."""
    pairs = (part if isinstance(part, tuple) else (part, "") for part in parts)
    text = "".join(_styled(printable_lines(text), style) for text, style in pairs)
    try:
        click.echo(text, err=err, color=False if os.environ.get("NO_COLOR") else None)
    except BrokenPipeError:  # the reader of the output has ended, as `head` does; click would end with 1
        os.dup2(os.open(os.devnull, os.O_WRONLY), (sys.stderr if err else sys.stdout).fileno())
        raise click.exceptions.Exit(BROKEN_PIPE) from None


def _styled(text: str, style: str) -> str:
    if style == "bold":
        return click.style(text, bold=True)
    return click.style(text, fg=style) if style else text


def print_problems(problems: Iterable[Diagnostic]) -> None:
    """Print diagnostics with location, source line and caret on standard error."""
    for problem in problems:
        first, *rest = problem.with_caret().split("\n")
        where = first.removesuffix(printable(problem.text))
        echo((where, "bold"), (first[len(where) :], "red"), err=True)
        for line in rest:
            print_line(line)


def print_notes(notes: Iterable[Diagnostic]) -> None:
    """Print diagnostics that are only notes on standard error, each after ``note:``."""
    for note in notes:
        print_line(f"note: {note}", "yellow")


def print_line(text: str, colour: str = "") -> None:
    """Print a line on standard error."""
    echo((text, colour), err=True)


def count(problems: Sequence[Diagnostic]) -> str:
    """Return the number of diagnostics as text, such as ``2 problems``."""
    return pluralize(len(problems), "problem")
