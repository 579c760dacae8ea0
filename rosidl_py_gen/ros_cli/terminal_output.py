"""Output of commands: tables and colours on a terminal, plain text elsewhere, JSON for programs.

Text of peers is not trusted: control characters are replaced, and line breaks in names are escaped.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.terminal_text import json_text, printable_line, printable_lines
from rosidl_py_gen.errors import printable

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


def is_terminal() -> bool:
    """Return True if standard output is a terminal with colours; ``NO_COLOR`` is respected."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def line(text: str = "", style: str = "") -> None:
    """Print one line; line breaks in it are escaped.

    Args:
        style: style of rich (``"bold cyan"``), for terminals.

    Raises:
        BrokenPipeError: the reader has closed the pipe.
    """
    _write(printable_line(text), style)


def lines(texts: Iterable[str]) -> None:
    """Print several lines at once; line breaks in them are escaped."""
    if rows := list(map(printable_line, texts)):
        _write("\n".join(rows))


def block(text: str, style: str = "") -> None:
    """Print a text with its line breaks, such as YAML; names in it must be escaped already."""
    _write(printable_lines(text), style)


def _write(text: str, style: str = "") -> None:
    if style and is_terminal():
        from rich.style import Style

        text = Style.parse(style).render(text)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def records(texts: Iterable[str]) -> None:
    """Print records of CSV or JSON, which may contain line breaks. Raises as `line`."""
    sys.stdout.writelines(printable_lines(text) + "\n" for text in texts)
    sys.stdout.flush()


def mermaid_label(text: str) -> str:
    """Return a label for Mermaid; special characters become character codes, which Mermaid does not interpret."""
    return re.sub(r"[^A-Za-z0-9_/ .,()-]", lambda char: f"#{ord(char[0])};", printable(text))


def note(text: str) -> None:
    """Print one line on standard error, next to the output of a command."""
    print(printable_line(text), file=sys.stderr, flush=True)


def names(rows: Sequence[dict[str, Any]], count: bool, show_types: bool, as_json: bool) -> None:
    """Print the rows of a list command; each has ``name`` and ``types``, and further values for JSON."""
    if as_json:
        document(rows)
    elif count:
        line(str(len(rows)))
    else:
        lines(f"{row['name']} [{', '.join(row['types'])}]" if show_types else row["name"] for row in rows)


def document(data: Any, *, in_stream: bool = False) -> None:
    """Print JSON; NaN and infinities become strings, as in `rosidl_py_gen.to_json`.

    Args:
        in_stream: print on one line, also on terminals, as one of several values.
    """
    _write(json_text(data, indent=2 if is_terminal() and not in_stream else None))


def values(texts: Sequence[str], as_json: bool) -> None:
    """Print texts, one on a line, or as a JSON list."""
    if as_json:
        document(texts)
    else:
        lines(texts)


def table(rows: Iterable[Sequence[str]], *headings: str, fields_of_wide_rows: bool = False) -> None:
    """Print a table that fits into the terminal; elsewhere columns separated by tabs, without headings.

    Args:
        fields_of_wide_rows: print a table that is wider than the terminal as one line for each field.
    """
    headings = tuple(map(printable_line, headings))
    rows = [[printable_line(cell) for cell in row] for row in rows]
    if not sys.stdout.isatty():
        sys.stdout.writelines("\t".join(row) + "\n" for row in rows)
        sys.stdout.flush()
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    if fields_of_wide_rows and _width([headings, *rows]) > shutil.get_terminal_size().columns:
        _fields(rows, headings)
        return
    styled = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, header_style="bold")
    for heading in headings:
        styled.add_column(Text(heading), overflow="fold")  # rich interprets markup in a str
    for row in rows:
        styled.add_row(*(Text(cell) for cell in row))
    Console(no_color=not is_terminal(), highlight=False).print(styled)


def _width(rows: Sequence[Sequence[str]]) -> int:
    """Return the width of a table in terminal columns, with three spaces between its columns."""
    from rich.cells import cell_len

    return sum(max(map(cell_len, column)) + 3 for column in zip(*rows, strict=True)) - 3


def _fields(rows: Iterable[Sequence[str]], headings: Sequence[str]) -> None:
    longest = max(map(len, headings))
    for number, row in enumerate(rows, 1):
        line(f"row {number}", "bold")
        block("\n".join(f"  {name.ljust(longest)}  {cell}" for name, cell in zip(headings, row, strict=True)))
