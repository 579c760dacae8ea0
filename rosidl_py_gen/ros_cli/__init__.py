"""``rosidl-py``: look at a running ROS 2 system and act on it from the command line.

This file knows the commands, with a sentence each, and how a run ends. A group of commands is a folder, whose
``__init__.py`` has their names and short help. The module of a command declares its options and implements it; it is
imported for that command alone, and imports inside its functions what help and completion do not need.

Exit codes: 0 done, 1 it could not be done (the reason is on standard error), 2 a wrong command line, 3 done, except for
damaged parts of a recording that were skipped (standard error has topics and times), 130 interrupted,
141 nobody reads the output any more.
Commands that go on until they are interrupted end with 0 then. A program that `run` started ends as with python.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
import warnings
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import wraps
from importlib import import_module
from inspect import iscoroutine
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen import __version__
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.output import printable_line, printable_lines
from rosidl_py_gen.base.project import importable_current_folder
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.errors import DefinitionError, RosidlError, printable
from rosidl_py_gen.ros_cli.groups import LazyGroup

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator
    from contextlib import AbstractContextManager

_COMMANDS = {
    "action": ("action", "Actions: list, info, send goals."),
    "bag": ("bag", "Recordings: record, play, info, convert, migrate, reindex, table, sql."),
    "completion": ("completion_script", "Print the completion script of a shell."),
    "doctor": ("doctor.check", "Check this installation, the network, and what answers on it."),
    "foxglove": ("foxglove.command", "Show topics, parameters and services live in Foxglove or Lichtblick."),
    "graph": ("graph.command", "Nodes and topics as text, Mermaid or SVG."),
    "interface": ("interface", "Definitions of messages, services and actions."),
    "lifecycle": ("lifecycle", "Lifecycle nodes: list, get and set their states."),
    "log": ("log.follow", "Follow what all nodes log."),
    "node": ("node", "Nodes: list, info."),
    "param": ("param", "Parameters: list, get, set, describe, dump, load, delete."),
    "run": ("program_runner.command", "Run a program written for rclpy as it is."),
    "service": ("service", "Services: list, type, call, info, echo."),
    "tf": ("tf", "Transforms: the tree of frames, one transform, rates and delays."),
    "topic": ("topic", "Topics: list, info, echo, pub, hz, bw, delay, type, find."),
    "zenoh-router": ("zenoh_router", "A router for nodes on rmw_zenoh."),
}


DAMAGED = 3
"""Exit code of a command that skipped damaged parts of a recording."""
_BROKEN_PIPE = 141
"""What a shell says of a program that SIGPIPE ended."""


class ToolError(RosidlError):
    """What the user asked for cannot be done; the text says why and what would help."""


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs=_COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)
@click.version_option(__version__, prog_name="rosidl-py")
def _cli() -> None:
    """Look at a running ROS 2 system and act on it. No ROS installation is needed.

    \b
    rosidl-py topic list -t
    rosidl-py topic echo /chatter
    rosidl-py service call /add_two_ints '{a: 1, b: 2}'

    ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE count, and so do --domain and --discovery of each command.
    """


def root() -> click.Group:
    """All commands, for completion."""
    return _cli


@dataclass(frozen=True)
class AsyncCommand:
    """What a command does on an event loop, and answers with its exit code.

    Attributes:
        endless: it goes on until it is interrupted, so that this is its usual end.
    """

    main: Coroutine[Any, Any, int]
    endless: bool = False


def verb(function: Callable[..., Any]) -> Callable[..., None]:
    """Decorate what click calls when a command is used: run what the function returns, and end with its exit code.

    The function returns an exit code or a `AsyncCommand`, or is a coroutine function. A context listens for peers
    while the function imports what it needs, unless a recording is read instead.
    """

    @wraps(function)
    def run(**arguments: Any) -> None:
        listening: AbstractContextManager[None] = nullcontext()
        if "network" in arguments and arguments.get("bag") is None:
            listening = import_module(f"{__name__}.command_node").context_opened_early(arguments["network"])
        try:
            with listening:
                answer = function(**arguments)
                if iscoroutine(answer):
                    answer = AsyncCommand(answer)
                code = run_async_command(answer) if isinstance(answer, AsyncCommand) else answer
            sys.stdout.flush()
        except BrokenPipeError:  # whoever read our output has enough; click would end with 1
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = _BROKEN_PIPE
        if code:
            raise click.exceptions.Exit(code)

    return run


def run_async_command(job: AsyncCommand) -> int:
    """Run it; the exit code it returns, or what a signal makes of it."""
    from rosidl_py_gen.runtime import run

    command_interrupts.ignores_first = True
    try:
        code = run(job.main)
    finally:
        command_interrupts.ignores_first = False
    if code is None:  # a signal
        command_interrupts.note()
        return 0 if job.endless else 130
    return code


def main(arguments: list[str] | None = None) -> None:
    """The console script; see the head of this file for exit codes."""
    given = sys.argv[1:] if arguments is None else arguments
    if "_ROSIDL_PY_COMPLETE" in os.environ:
        import_module("rosidl_py_gen.generator_cli.shells").install()
    if given[:1] != ["run"]:
        _configure_process(arguments is None)
    shown = warnings.showwarning
    program = None
    is_ours = given[:1] != ["run"] and "_ROSIDL_PY_COMPLETE" not in os.environ
    interrupts = command_interrupts.handling(is_ours and arguments is None)
    with interrupts, exit_on_error(), importable_current_folder() if is_ours else nullcontext():
        warnings.showwarning = _show_warning
        answer = _cli.main(arguments, prog_name="rosidl-py", standalone_mode=False)
        if isinstance(answer, int) and answer:
            sys.exit(answer)
        program = answer if callable(answer) else None
    if program is not None:
        warnings.showwarning = shown
        program()


def _configure_process(is_process: bool) -> None:
    """What is good for our own commands, and not for programs of others."""
    if is_process:
        # Looking for garbage in what is imported, and once more at the end, takes a tenth of a short command.
        gc.set_threshold(200_000)
        atexit.register(gc.freeze)
        # Nothing here does linear algebra, for which numpy starts a thread on each core that is busy until it sleeps.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed; a socket would get its number
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


@contextmanager
def exit_on_error() -> Iterator[None]:
    """Say on standard error why something could not be done, and exit with a code as the head of this file says."""
    try:
        yield
    except click.ClickException as wrong:
        shown = io.StringIO()
        wrong.show(shown)
        click.echo(printable_lines(shown.getvalue()), err=True, nl=False)
        sys.exit(wrong.exit_code)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    except DefinitionError as error:
        for problem in error.diagnostics:
            report(problem.with_caret())
        sys.exit(1)
    except RosidlError as error:
        report(str(error))
        sys.exit(1)
    except ModuleNotFoundError as missing:
        explained = missing_extra_message(missing)
        if explained is None:
            raise
        report(str(explained))
        sys.exit(1)
    except OSError as error:
        report(f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror or error))
        sys.exit(1)


def _show_warning(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
    """Show a warning without its place in the code, which helps nobody here."""
    click.echo(f"warning: {printable(str(message))}", err=True)


def report(text: str) -> None:
    """Say on standard error why something cannot be done, in one line, or with a source line and its caret below it.

    Text of peers may be in it: line breaks are escaped, control characters replaced.
    """
    head, *rest = text.split("\n    ")
    has_caret = len(rest) == 2 and rest[1].strip() == "^"
    lines = "\n    ".join(map(printable, (head, *rest))) if has_caret else printable_line(text)
    click.secho(f"error: {lines}", fg="red", err=True, color=False if os.environ.get("NO_COLOR") else None)
