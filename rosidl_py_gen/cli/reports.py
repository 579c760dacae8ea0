"""How problems and notes look, on a terminal and as JSON."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import click

from rosidl_py_gen.errors import Problem, printable


def rows(problems: Iterable[Problem]) -> list[dict[str, str | int]]:
    """Problems or notes for JSON."""
    return [{"path": one.path, "line": one.line, "column": one.column, "text": one.text} for one in problems]


def print_json(data: Any) -> None:
    """JSON for programs, on standard output."""
    import json

    click.echo(json.dumps(data, indent=2))


def print_problems(problems: Iterable[Problem]) -> None:
    """Each with its place, its line and a caret, on standard error."""
    for problem in problems:
        first, *rest = problem.with_caret().split("\n")
        where = first.removesuffix(printable(problem.text))
        print_line(click.style(where, bold=True) + click.style(first[len(where) :], fg="red"))
        for line in rest:
            print_line(line)


def print_notes(notes: Iterable[Problem]) -> None:
    """What was assumed, a line each, on standard error."""
    for note in notes:
        print_line(f"note: {note}", "yellow")


def print_line(text: str, colour: str = "") -> None:
    """A line on standard error."""
    shown = click.style(text, fg=colour) if colour else text
    click.echo(shown, err=True, color=False if os.environ.get("NO_COLOR") else None)


def count(problems: Sequence[Problem]) -> str:
    """How many there are, in words."""
    return "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
