"""Parts of a command line: printed text, diagnostics and notes, completion callbacks, and the option ``--distro``.

`rosidl-py-gen` prints text and JSON by these functions, because names and texts of definitions are not trusted. Both
command lines use the rest. Completion callbacks never raise, and import modules only when a shell completes: a shell
would print a traceback into the line that is being typed, so an error of any kind results in no suggestions.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.terminal_text import json_text, pluralize, printable_lines
from rosidl_py_gen.errors import Diagnostic, printable

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.shell_completion import CompletionItem


def rows(problems: Iterable[Diagnostic]) -> list[dict[str, str | int]]:
    """Return diagnostics as rows for JSON output, each with path, line, column and text."""
    return [{"path": one.path, "line": one.line, "column": one.column, "text": one.text} for one in problems]


class HintedUsageError(click.UsageError):
    """Error of the command line with a hint, which is printed instead of the usage of the command."""

    def __init__(self, message: str, hint: str, ctx: click.Context | None = None) -> None:
        super().__init__(message, ctx)
        self.hint = hint

    @staticmethod
    def text_of(error: click.ClickException) -> str:
        """Return an error of click in the form of all errors: lines ``error: COMMAND: text`` and ``hint: text``.

        A command that was called without arguments has its help instead.
        """
        context = getattr(error, "ctx", None)
        if context is None:
            return f"error: {_message(error)}"
        if type(error).__name__ == "NoArgsIsHelpError":  # click 8.2 and later
            return str(context.get_help())
        usage = " ".join((context.command_path, *context.command.collect_usage_pieces(context)))
        hint = getattr(error, "hint", f"expected `{usage}`; --help explains it")
        return f"error: {context.command_path}: {_message(error)}\nhint: {hint}"


def _message(error: click.ClickException) -> str:
    """Return the text of an error of click in the style of this package: what was found, then what was expected,
    without full stop.
    """
    text = error.format_message()
    match error:
        case click.MissingParameter(param=click.Parameter() as parameter):
            name = _parameter_name(parameter)
            choices = getattr(parameter.type, "choices", ())
            return f"missing {name}" + (f"; expected one of {', '.join(map(str, choices))}" if choices else "")
        case click.NoSuchOption(option_name=name):
            similar = [f'"{one}"' for one in error.possibilities or ()]
            return f"no option {name}" + (f"; did you mean {' or '.join(similar)}?" if similar else "")
        case click.BadParameter(param=click.Parameter() as parameter):
            return f"{_parameter_name(parameter)}: {error.message.removesuffix('.')}"
        case click.BadOptionUsage(option_name=name):
            return re.sub(r"^Option '.*?'", name, text).removesuffix(".")
    if unexpected := re.fullmatch(r"Got unexpected extra (arguments?) \((.*)\)", text, re.DOTALL):
        return f"unexpected {unexpected[1]} {unexpected[2]}"
    return text


def _parameter_name(parameter: click.Parameter) -> str:
    is_option = isinstance(parameter, click.Option)
    return max(parameter.opts, key=len) if is_option else str(parameter.metavar or parameter.name).upper()


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
        raise click.exceptions.Exit(command_interrupts.BROKEN_PIPE) from None


def _styled(text: str, style: str) -> str:
    if style == "bold":
        return click.style(text, bold=True)
    return click.style(text, fg=style) if style else text


def print_problems(problems: Iterable[Diagnostic]) -> None:
    """Print diagnostics after ``error:``, with location, source line and caret, on standard error."""
    for problem in problems:
        first, *rest = problem.with_caret().split("\n")
        where = first.removesuffix(printable(problem.text))
        echo(("error: ", "red"), (where, "bold"), (first[len(where) :], "red"), err=True)
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


def split_filter(text: str) -> list[str]:
    """Return the names in a filter such as ``a:b;c``, which are separated by colons, semicolons or commas."""
    return [part.strip() for part in re.split("[:;,]", text) if part.strip()]


def lazy_completion(
    module: str, function: str, *arguments: str
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Return a completion callback for a click parameter that calls a function of a module imported only then.

    Args:
        module: name of the module.
        function: name of the function; called with `arguments`, the click context and the incomplete word.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return suggestions(lambda: getattr(import_module(module), function)(*arguments, ctx, incomplete))

    return complete


def suggestions(find: Callable[[], list[Any]]) -> list[Any]:
    """Call `find` and return its result; return an empty list if `find` raises an error or is interrupted."""
    try:
        return find()
    except (Exception, KeyboardInterrupt, SystemExit):
        return []


DISTRIBUTION = click.Choice(Distribution.NAMES, case_sensitive=False)
"""Click type of a parameter that names a ROS 2 distribution."""


def _select(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    if value is not None:
        ctx.with_resource(Distribution.of_command(value))


distro: Callable[[Any], Any] = click.option(
    "--distro",
    metavar="NAME",
    type=DISTRIBUTION,
    expose_value=False,
    callback=_select,
    help="ROS 2 distribution whose definitions are used: humble, jazzy, kilted or lyrical. [default: ROS_DISTRO, else "
    "jazzy]",
)
"""Decorator that adds ``--distro``, the ROS 2 distribution whose definitions a command uses."""
