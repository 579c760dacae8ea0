"""How answers look: tables and colours on a terminal, plain text elsewhere, JSON for programs.

Text of peers is not trusted: what could steer a terminal is replaced, and line breaks in names are escaped.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.output import json_text, printable_line, printable_lines
from rosidl_py_gen.errors import printable

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


def is_terminal() -> bool:
    """Whether standard output is a terminal that shall have colours: ``NO_COLOR`` is respected."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def line(text: str = "", style: str = "") -> None:
    """Print one line; line breaks in it are escaped.

    Args:
        style: of rich (``"bold cyan"``), for terminals.

    Raises:
        BrokenPipeError: nobody reads any more.
    """
    _write(printable_line(text), style)


def lines(texts: Iterable[str]) -> None:
    """Print several lines at once; line breaks in them are escaped."""
    if rows := list(map(printable_line, texts)):
        _write("\n".join(rows))


def block(text: str, style: str = "") -> None:
    """Print text with its line breaks: YAML, pictures, values. Names in it must be escaped already."""
    _write(printable_lines(text), style)


def _write(text: str, style: str = "") -> None:
    if style and is_terminal():
        from rich.style import Style

        text = Style.parse(style).render(text)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def records(texts: Iterable[str]) -> None:
    """Print any number of records of CSV or JSON, each with its own line breaks. Raises as `line`."""
    sys.stdout.writelines(printable_lines(text) + "\n" for text in texts)
    sys.stdout.flush()


def mermaid_label(text: str) -> str:
    """Text inside quotes: everything that is not plain becomes a character code, which Mermaid shows as it is."""
    return re.sub(r"[^A-Za-z0-9_/ .,()-]", lambda found: f"#{ord(found[0])};", printable(text))


def note(text: str) -> None:
    """A line on standard error, for what is no part of the answer."""
    print(printable_line(text), file=sys.stderr, flush=True)


def names(found: Sequence[dict[str, Any]], count: bool, show_types: bool, as_json: bool) -> None:
    """What a list command found: each has a name and types, and what else belongs into the JSON."""
    if as_json:
        document(found)
    elif count:
        line(str(len(found)))
    else:
        lines(f"{one['name']} [{', '.join(one['types'])}]" if show_types else one["name"] for one in found)


def document(data: Any, *, in_stream: bool = False) -> None:
    """JSON; NaN and infinities become strings, as `rosidl_py_gen.to_json` does it.

    Args:
        in_stream: one of several, each of which takes one line.
    """
    _write(json_text(data, indent=2 if is_terminal() and not in_stream else None))


def json_line(data: Any) -> None:
    """JSON on one line, also on terminals: one of a stream of values."""
    _write(json_text(data))


def table(rows: Iterable[Sequence[str]], *headings: str, fields_of_wide_rows: bool = False) -> None:
    """Columns: fitted into the terminal; elsewhere separated by tabs, without headings, for cut and awk.

    Args:
        fields_of_wide_rows: a table that is wider than the terminal is printed as one line for each field.
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
    shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, header_style="bold")
    for heading in headings:
        shown.add_column(Text(heading), overflow="fold")  # in a string, rich would find its own markup
    for row in rows:
        shown.add_row(*(Text(cell) for cell in row))
    Console(no_color=not is_terminal(), highlight=False).print(shown)


def _width(rows: Sequence[Sequence[str]]) -> int:
    """Columns of the terminal that a table takes, with three spaces between its own."""
    from rich.cells import cell_len

    return sum(max(map(cell_len, column)) + 3 for column in zip(*rows, strict=True)) - 3


def _fields(rows: Iterable[Sequence[str]], headings: Sequence[str]) -> None:
    longest = max(map(len, headings))
    for number, row in enumerate(rows, 1):
        line(f"row {number}", "bold")
        block("\n".join(f"  {name.ljust(longest)}  {cell}" for name, cell in zip(headings, row, strict=True)))
