"""``rosidl-py``: commands for a running ROS 2 system and for recordings.

This module has the entry point and the handling of errors, `groups` the table of commands. The module of a command
declares the command's options and implements the command. The module is imported only for the command, the help of its
group, and completion; functions in the module import whatever help and completion do not need.

Exit codes: 0 success, 1 failure (the reason is on standard error), 2 wrong command line, 3 success, but damaged parts
of a recording were skipped (topics and times are on standard error), 130 interrupted, 141 the reader of the output has
closed the pipe. Commands that run until they are interrupted end with 0. A program started by `run` ends as in python.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
import warnings
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache, wraps
from importlib import import_module
from inspect import iscoroutine
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import __version__
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.project import GeneratedPackages, with_project_path
from rosidl_py_gen.base.terminal_text import printable_lines
from rosidl_py_gen.errors import DefinitionError, RosidlError, printable

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator
    from contextlib import AbstractContextManager

    import click

DAMAGED = 3
"""Exit code of a command that skipped damaged parts of a recording."""


@cache
def root() -> click.Group:
    """Return the click group ``rosidl-py``, which contains all commands."""
    from rosidl_py_gen.ros_cli.groups import root_group

    return click_module().version_option(__version__, prog_name="rosidl-py")(root_group())  # type: ignore[no-any-return]


def click_module() -> Any:
    """Import and return click; the import takes 10 ms, and programs that `run` starts do not need click."""
    import click

    return click


@dataclass(frozen=True)
class AsyncCommand:
    """Wrapper of a command that runs on an event loop; its coroutine `main` returns the exit code, None for 0.

    A command that is endless runs until it is interrupted, and its exit code is 0 then.
    """

    main: Coroutine[Any, Any, int | None]
    endless: bool = False


def verb(function: Callable[..., Any]) -> Callable[..., None]:
    """Decorate the callback of a click command so that its result becomes the exit code of the command.

    The callback returns an exit code (None for 0) or an `AsyncCommand`, or is a coroutine function.
    If the callback has the argument `network` and reads no bag, a context discovers peers while the callback imports
    modules.
    """

    @wraps(function)
    def run(**arguments: Any) -> None:
        context: AbstractContextManager[None] = nullcontext()
        if "network" in arguments and arguments.get("bag") is None:
            from rosidl_py_gen.command_support import context_opened_early

            context = context_opened_early(arguments["network"])
        try:
            with context:
                result = function(**arguments)
                if iscoroutine(result):
                    result = AsyncCommand(result)
                code = run_async_command(result) if isinstance(result, AsyncCommand) else result
            sys.stdout.flush()
        except BrokenPipeError:  # click would end with 1
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = command_interrupts.BROKEN_PIPE
        if code:
            raise click_module().exceptions.Exit(code)

    return run


def run_async_command(command: AsyncCommand) -> int:
    """Run a command on an event loop and return its exit code; after a signal 0 if it is endless, else 130."""
    from rosidl_py_gen.runtime import run

    async def main() -> int:
        return await command.main or 0

    command_interrupts.ignores_first = True
    try:
        code = run(main())
    finally:
        command_interrupts.ignores_first = False
    if code is None:  # a signal
        command_interrupts.note()
        return 0 if command.endless else 130
    return code


def main(arguments: list[str] | None = None) -> None:
    """Run the command line ``rosidl-py`` with `arguments` (None: of this process); exits with a code other than 0."""
    words = sys.argv[1:] if arguments is None else arguments
    if arguments is None:
        sys.unraisablehook = command_interrupts.repeat_ignored
    is_completion = "_ROSIDL_PY_COMPLETE" in os.environ
    is_run = words[:1] in (["run"], ["launch"], ["test"])
    if is_completion:
        from rosidl_py_gen.generator_cli import install_completion

        install_completion(is_process=arguments is None)
    if not is_run:
        _configure_process(arguments is None)
    elif arguments is None:
        gc.disable()  # until the program starts; collections would take a tenth of the time to there
    default_showwarning = warnings.showwarning
    program = None
    is_command = not (is_run or is_completion)
    interrupts = command_interrupts.handling(is_command and arguments is None)
    with interrupts, exit_on_error(), GeneratedPackages.of_current_folder() if is_command else nullcontext():
        warnings.showwarning = _show_warning
        if words[:1] == ["run"] and words[1:2] and not words[1].startswith("-"):
            # without the options, click is not needed
            start = import_module("rosidl_py_gen.program_runner.run").start
            result = start(words[1:], with_project_path(()), False, False, False)
        else:
            result = root().main(arguments, prog_name="rosidl-py", standalone_mode=False)
        if isinstance(result, int) and result:
            sys.exit(result)
        program = result if callable(result) else None
    if program is not None:
        warnings.showwarning = default_showwarning
        if arguments is None:
            gc.freeze()  # collections of the program need not visit the objects of this package
            gc.enable()
        program()


def _configure_process(is_process: bool) -> None:
    """Set up garbage collection and standard streams of a process that runs a command of this package, and no program
    of the user.
    """
    if is_process:
        # Garbage collection of imported modules, and at exit, takes a tenth of the time of a short command.
        gc.set_threshold(200_000)
        atexit.register(gc.freeze)
        # numpy starts a busy thread on each core for linear algebra, which no command uses.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed; a socket would get its descriptor
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


@contextmanager
def exit_on_error() -> Iterator[None]:
    """Print an error of the block on standard error and exit with 1, 2 (wrong command line) or 130 (Ctrl-C)."""
    try:
        yield
    except click_module().ClickException as error:
        from rosidl_py_gen.generator_cli import HintedUsageError

        click_module().echo(printable_lines(HintedUsageError.text_of(error)), err=True)
        sys.exit(error.exit_code)
    except (click_module().Abort, KeyboardInterrupt):
        sys.exit(130)
    except (RosidlError, ModuleNotFoundError, OSError) as error:
        texts = _texts_of(error)
        if texts is None:
            raise
        from rosidl_py_gen.command_support import report

        for text in texts:
            report(text)
        sys.exit(1)


def _texts_of(error: RosidlError | ModuleNotFoundError | OSError) -> list[str] | None:
    """Return the texts that a command prints for an error; None for a missing module that belongs to no extra."""
    match error:
        case DefinitionError():
            return [one.with_caret() for one in error.diagnostics]
        case RosidlError():
            return [str(error)]
        case ModuleNotFoundError():
            message = Extra.missing_error(error)
            return None if message is None else [str(message)]
    return [f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror or error)]


def _show_warning(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
    """Print a Python warning on standard error without its location in the code."""
    click_module().echo(f"warning: {printable(str(message))}", err=True)
