"""Output of commands: tables and colours on a terminal, plain text elsewhere, JSON for programs.

Text of peers is not trusted: control characters are replaced, and line breaks in names are escaped.
"""

from __future__ import annotations

import os
import re
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.terminal_text import json_text, printable_line, printable_lines
from rosidl_py_gen.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

_COLUMN_GAP = 3
"""Number of spaces between the columns of a table."""
_CLEAR_LINE = "\r\x1b[2K"
_MAX_NOTES = 10


def is_terminal() -> bool:
    """Return True if standard output is a terminal with colours; ``NO_COLOR`` is respected."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def is_error_terminal() -> bool:
    """Return True if standard error is a terminal on which a line can be replaced."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def line(text: str = "", style: str = "") -> None:
    """Print one line; on terminals in a style of rich such as ``"bold cyan"``. Line breaks in `text` are escaped."""
    _write(printable_line(text), style)


def lines(texts: Iterable[str]) -> None:
    """Print several lines of text at once; line breaks inside each line are escaped."""
    if rows := list(map(printable_line, texts)):
        _write("\n".join(rows))


def block(text: str, style: str = "") -> None:
    """Print a text of several lines, such as YAML; line breaks in names must be escaped already."""
    _write(printable_lines(text), style)


def _write(text: str, style: str = "") -> None:
    if style and is_terminal():
        from rich.style import Style

        text = Style.parse(style).render(text)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def records(texts: Iterable[str]) -> None:
    """Print records of CSV or JSON, which may contain line breaks."""
    sys.stdout.writelines(printable_lines(text) + "\n" for text in texts)
    sys.stdout.flush()


class StatusLine:
    """Status line on standard error, if that is a terminal, below the other output of a command; a context manager.

    The cursor stays visible, because a signal handler could not restore it. Nothing is displayed unless `is_possible`.
    """

    def __init__(self) -> None:
        self.is_possible = is_error_terminal()
        self._text = ""
        self._streams: tuple[Any, Any] = sys.stdout, sys.stderr

    def show(self, text: str) -> None:
        """Replace the text of the status line; a text that is wider than the terminal is cut."""
        if not self.is_possible:
            return
        columns = _columns_of(self._streams[1])
        text = printable_line(text)
        self._text = text if len(text) < columns else f"{text[: max(0, columns - 2)]}…"
        self._write(f"{_CLEAR_LINE}{self._text}")

    def clear(self) -> None:
        """Remove the status line from the terminal until the next call of `show`."""
        if self._text:
            self._text = ""
            self._write(_CLEAR_LINE)

    def _write(self, text: str) -> None:
        self._streams[1].write(text)
        self._streams[1].flush()

    def __enter__(self) -> StatusLine:
        self._streams = sys.stdout, sys.stderr
        if self.is_possible:
            if sys.stdout.isatty():
                sys.stdout = _AboveStatusLine(sys.stdout, self)
            sys.stderr = _AboveStatusLine(sys.stderr, self)
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()
        sys.stdout, sys.stderr = self._streams


class _AboveStatusLine:
    """Output stream that removes a status line before it writes; the next `show` draws the line below the output."""

    def __init__(self, stream: Any, status: StatusLine) -> None:
        self._stream, self._status = stream, status

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        self._status.clear()
        count: int = self._stream.write(text)
        return count

    def writelines(self, texts: Iterable[str]) -> None:
        self._status.clear()
        self._stream.writelines(texts)


def _columns_of(terminal: Any) -> int:
    try:
        columns = os.get_terminal_size(terminal.fileno()).columns
    except (OSError, ValueError):
        columns = 0
    return columns or _columns()


def _columns() -> int:
    from shutil import get_terminal_size  # slow to import

    return get_terminal_size().columns


def mermaid_label(text: str) -> str:
    """Return a text as label for Mermaid, with character codes for characters that Mermaid would interpret."""
    return re.sub(r"[^A-Za-z0-9_/ .,()-]", lambda char: f"#{ord(char[0])};", printable(text))


def note(text: str) -> None:
    """Print a note, one line on standard error, which is separate from the output of a command."""
    print(printable_line(text), file=sys.stderr, flush=True)


@cache
def note_once(text: str) -> None:
    """Print a note, one line on standard error, unless this process has printed the same note."""
    note(text)


def names(rows: Sequence[dict[str, Any]], count: bool, show_types: bool, as_json: bool) -> None:
    """Print rows of a list command: their names, only their number, or JSON. Each row has ``name`` and ``types``."""
    if as_json:
        document(rows)
    elif count:
        line(str(len(rows)))
    else:
        lines(f"{row['name']} [{', '.join(row['types'])}]" if show_types else row["name"] for row in rows)


def document(data: Any, *, in_stream: bool = False) -> None:
    """Print a value as JSON: on one line, or indented on a terminal unless it is one of several (`in_stream`)."""
    _write(json_text(data, indent=2 if is_terminal() and not in_stream else None))


def result(texts: Iterable[str], as_json: bool, data: Any = None) -> None:
    """Print texts, one on each line, or with JSON output the value `data`; without `data`, the texts as a JSON list."""
    if as_json:
        document([*texts] if data is None else data)
    else:
        lines(texts)


class OnceNotes:
    """Printer of notes, which prints each text once, and at most ten different texts."""

    def __init__(self) -> None:
        self._printed: set[str] = set()

    def __call__(self, text: str) -> None:
        if text not in self._printed and len(self._printed) < _MAX_NOTES:
            self._printed.add(text)
            note(text)


def drawing(
    kind: str, output: str | None, texts: Iterable[tuple[str, str]], draw: Mapping[str, Callable[[], str]]
) -> None:
    """Print or write a drawing in the format that `options.output_format` returns.

    Args:
        texts: lines and their styles for the format ``text``.
        draw: functions that return the drawing in the other formats; ``markdown`` contains ``mermaid``.
    """
    if output is None and kind == "text":
        for one, style in texts:
            line(one, style)
        return
    if kind == "text":
        drawn = "".join(f"{printable_line(one)}\n" for one, _ in texts)
    else:
        drawn = f"```mermaid\n{draw['mermaid']()}```\n" if kind == "markdown" else draw[kind]()
    if output is None:
        block(drawn.rstrip("\n"))
    else:
        Path(output).write_text(drawn if drawn.endswith("\n") else f"{drawn}\n", encoding="utf-8")


def table(rows: Iterable[Sequence[str]], *headings: str, has_names: bool = True) -> None:
    """Print a table that fits into the terminal; elsewhere columns separated by tabs, without headings.

    Cells wrap at spaces only, so names are never broken. A table that does not fit has a line for each cell.

    Args:
        has_names: True if the first cell of each row is its name, which is printed above cells that have own lines.
    """
    headings = tuple(map(printable_line, headings))
    rows = [[printable_line(cell) for cell in row] for row in rows]
    if not sys.stdout.isatty():
        sys.stdout.writelines("\t".join(row) + "\n" for row in rows)
        sys.stdout.flush()
        return
    columns = _columns()
    widths = _column_widths([headings, *rows], columns, may_wrap=has_names)
    if widths is None:
        _lines_of_cells(rows, headings, has_names)
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    styled = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, header_style="bold")
    for heading, width in zip(headings, widths, strict=True):
        styled.add_column(Text(heading), width=width)  # rich interprets markup in a str
    for row in rows:
        styled.add_row(*(Text(cell) for cell in row))
    Console(no_color=not is_terminal(), highlight=False, width=columns).print(styled)


def _column_widths(rows: Sequence[Sequence[str]], columns: int, *, may_wrap: bool) -> list[int] | None:
    """Return column widths with which a table fits into `columns` without breaking words; None if it cannot fit."""
    from rich.cells import cell_len

    cells = [*zip(*rows, strict=True)]
    widths = [max(map(cell_len, column)) for column in cells]
    smallest = [max(cell_len(word) for cell in column for word in (cell.split() or [""])) for column in cells]
    excess = sum(widths) + _COLUMN_GAP * (len(widths) - 1) - columns
    while excess > 0:
        number = max(range(len(widths)), key=lambda one: widths[one] - smallest[one])
        slack = widths[number] - smallest[number]
        if not (may_wrap and slack):
            return None
        widths[number] -= min(excess, slack)
        excess -= slack
    return widths


def _lines_of_cells(rows: Iterable[Sequence[str]], headings: Sequence[str], has_names: bool) -> None:
    skipped = int(has_names)
    longest = max(map(len, headings[skipped:]), default=0)
    for number, row in enumerate(rows, 1):
        line(row[0] if has_names else f"row {number}", "bold")
        cells = [*zip(headings, row, strict=True)][skipped:]
        if cells:
            block("\n".join(f"  {name.ljust(longest)}  {cell}" for name, cell in cells))
