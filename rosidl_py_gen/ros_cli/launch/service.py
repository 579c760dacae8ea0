"""Running and printing a launch file with the package launch, and the end of all its processes."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import sys
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import CommandError, exit_on_error, terminal_output
from rosidl_py_gen.ros_cli.launch.missing import MissingParts

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.prefix import Prefix

_BUILT_IN = {"emulate_tty", "launch-prefix", "launch-prefix-filter", "sigkill_timeout", "sigterm_timeout"}
"""Launch configurations that actions of launch and launch_ros read, and that no launch file declares."""
_SET_CHILD_SUBREAPER = 36
_GRACE_S = 1.0
"""Time between SIGINT, SIGTERM and SIGKILL to a process that a node has left behind; all end within 5 s of Ctrl-C."""


def run(file: str, arguments: dict[str, str], settings: Mapping[str, Any], prefix: Prefix) -> None:
    """Run or print a launch file, and exit with the code of launch."""
    with exit_on_error():
        code = _run(file, arguments, settings, prefix)
    sys.exit(code)


def _run(file: str, arguments: dict[str, str], settings: Mapping[str, Any], prefix: Prefix) -> int:
    if settings["show_all"]:
        os.environ.update(OVERRIDE_LAUNCH_PROCESS_OUTPUT="both")
    missing = MissingParts(settings["missing"] == "skip", file, prefix)
    missing.install()
    launch = import_module("launch")
    for name in ("launch-prefix", "launch-prefix-filter"):
        if value := settings[name.replace("-", "_")]:
            arguments[name] = value
    is_run = not (settings["show_args"] or settings["print_description"])
    if is_run:
        is_terminal = sys.stdin is not None and sys.stdin.isatty()
        service = launch.LaunchService(
            argv=[f"{name}:={value}" for name, value in arguments.items()],
            noninteractive=settings["noninteractive"] or not is_terminal,
            debug=settings["debug"],
        )
    sources = import_module("launch.launch_description_sources")
    try:
        description = sources.get_launch_description_from_any_launch_file(file)
    except Exception as error:
        raise CommandError(missing.error_text(error, missing.part_of(error))) from error
    if not is_run:
        if settings["show_args"]:
            text = "\n".join(_argument_lines(description.get_launch_arguments()))
        else:
            text = launch.LaunchIntrospector().format_launch_description(description)
        terminal_output.block(text)
        return 0
    _check_arguments(description, arguments, display_path(os.path.realpath(file)))
    source = launch.LaunchDescriptionSource(description, file, "launch file")
    include = launch.actions.IncludeLaunchDescription(source, launch_arguments=arguments.items())
    service.include_launch_description(launch.LaunchDescription([include]))
    return _serve(service)


def _argument_lines(arguments: Iterable[Any]) -> Iterable[str]:
    """Yield the lines that `ros2 launch --show-args` prints."""
    yield "Arguments (pass arguments as '<name>:=<value>'):"
    is_any, is_any_conditional = False, False
    for one in arguments:
        is_conditional = getattr(one, "_conditionally_included", False)
        is_any, is_any_conditional = True, is_any_conditional or is_conditional
        yield f"\n    '{one.name}':{'*' if is_conditional else ''}\n        {one.description}"
        if one.default_value is not None:
            yield f"        (default: {' + '.join(part.describe() for part in one.default_value)})"
    if is_any_conditional:
        yield "\n* argument(s) which are only used if specific conditions occur"
    if not is_any:
        yield "\n  No arguments."


def _check_arguments(description: Any, given: dict[str, str], file: str) -> None:
    """Raise `CommandError` for an argument without a value; print a warning for a name that no file declares."""
    arguments = description.get_launch_arguments_with_include_launch_description_actions()
    declared = {one.name for one, _ in arguments}
    for one, includes in arguments:
        is_required = (
            includes is None and one.default_value is None and not getattr(one, "_conditionally_included", False)
        )
        if is_required and one.name not in given:
            text = f"{file}: the argument {one.name} has no value: {one.description}"
            raise CommandError(f"{text}; pass {one.name}:=VALUE (--show-args prints all arguments)")
    for name in given:
        if name not in declared and name not in _BUILT_IN:
            text = f"{file} declares no argument {name}{did_you_mean(name, declared)}"
            terminal_output.note(f"warning: {text}; it is set nevertheless (--show-args prints all arguments)")


def _serve(service: Any) -> int:
    """Run the service to its end; SIGTERM ends all processes as SIGINT does, and none remains."""
    module: Any = import_module("launch.launch_service")
    original = module.AsyncSafeSignalManager

    class SignalManager(original):  # type: ignore[misc, valid-type]
        """Signals of the service; the original handler of SIGTERM leaves its processes running."""

        def handle(self, number: int, handler: Any) -> Any:
            is_term = number == signal.SIGTERM
            return super().handle(number, (lambda number: service.shutdown(force_sync=True)) if is_term else handler)

    module.AsyncSafeSignalManager = SignalManager
    # docs/internals/protocol.md 15: without a handler in Python, the service is not woken up.
    signal.signal(signal.SIGTERM, lambda number, frame: None)
    if sys.platform == "linux":  # processes whose parent has ended become children of this one
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        return int(service.run())
    finally:
        _end_remaining_processes()


def _end_remaining_processes() -> None:
    if names := _children():
        terminal_output.note(f"ending processes that nodes have left behind: {', '.join(names.values())}")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        signalled: set[int] = set()
        end = time.monotonic() + _GRACE_S
        while (names := _children()) and time.monotonic() < end:
            for process in names.keys() - signalled:
                with suppress(ProcessLookupError):
                    os.kill(process, number)
            signalled |= names.keys()
            time.sleep(0.05)


def _children() -> dict[int, str]:
    """Return the child processes by number with their names, without those that have ended; Linux only."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        return {}
    names = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            match = re.match(r"(\d+) \((.*)\) [^Z] (\d+) ", file.read_text(errors="replace"), re.DOTALL)
            if match and int(match[3]) == os.getpid():
                names[int(match[1])] = f"{match[2]} ({match[1]})"
    return names
