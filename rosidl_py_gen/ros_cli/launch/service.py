"""Running and printing a launch file with the package launch, and the end of all its processes."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import CommandError, exit_on_error, terminal_output
from rosidl_py_gen.ros_cli.launch.missing import MissingParts

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.prefix.build import Prefix

_BUILT_IN = {"emulate_tty", "launch-prefix", "launch-prefix-filter", "sigkill_timeout", "sigterm_timeout"}
"""Launch configurations that actions of launch and launch_ros read, and that no launch file declares."""
_CONDITIONAL = "_conditionally_included"
_GRACE_S = 1.0
"""Time between SIGINT, SIGTERM and SIGKILL to a process that a node has left behind; all end within 5 s of Ctrl-C."""


@exit_on_error()
def run(file: str, arguments: dict[str, str], settings: Mapping[str, Any], prefix: Prefix) -> None:
    """Run or print a launch file, and exit with the code of launch."""
    if settings["show_all"]:
        os.environ.update(OVERRIDE_LAUNCH_PROCESS_OUTPUT="both")
    missing = MissingParts(settings["missing"] == "skip", file, prefix)
    missing.install()
    launch = import_module("launch")
    given = {name: settings[name.replace("-", "_")] for name in ("launch-prefix", "launch-prefix-filter")}
    arguments |= {name: value for name, value in given.items() if value}
    if is_run := not (settings["show_args"] or settings["print"]):
        service = launch.LaunchService(
            argv=[f"{name}:={value}" for name, value in arguments.items()],
            noninteractive=settings["noninteractive"] or not (sys.stdin and sys.stdin.isatty()),
            debug=settings["debug"],
        )
    sources = import_module("launch.launch_description_sources")
    try:
        description = sources.get_launch_description_from_any_launch_file(file)
    except Exception as error:
        raise CommandError(missing.error_text(error, missing.part_of(error), file)) from error
    if is_run:
        _check_arguments(description, arguments, display_path(os.path.realpath(file)))
        source = launch.LaunchDescriptionSource(description, file, "launch file")
        include = launch.actions.IncludeLaunchDescription(source, launch_arguments=arguments.items())
        service.include_launch_description(launch.LaunchDescription([include]))
        sys.exit(_serve(service))
    if settings["show_args"]:
        terminal_output.block(_arguments_text(description.get_launch_arguments()))
    else:
        terminal_output.block(launch.LaunchIntrospector().format_launch_description(description))


def _arguments_text(arguments: list[Any]) -> str:
    """Return what `ros2 launch --show-args` prints."""
    text = "Arguments (pass arguments as '<name>:=<value>'):"
    for one in arguments:
        text += f"\n\n    '{one.name}':{'*' if vars(one).get(_CONDITIONAL) else ''}\n        {one.description}"
        if one.default_value is not None:
            text += f"\n        (default: {' + '.join(part.describe() for part in one.default_value)})"
    if any(vars(one).get(_CONDITIONAL) for one in arguments):
        text += "\n\n* argument(s) which are only used if specific conditions occur"
    return text if arguments else f"{text}\n\n  No arguments."


def _check_arguments(description: Any, given: dict[str, str], file: str) -> None:
    """Raise `CommandError` for an argument without a value; print a warning for a name that no file declares."""
    arguments = description.get_launch_arguments_with_include_launch_description_actions()
    for one, includes in arguments:
        is_optional = one.name in given or one.default_value is not None or vars(one).get(_CONDITIONAL)
        if includes is None and not is_optional:  # launch checks the arguments of includes
            text = f"{file}: the argument {one.name} has no value: {one.description}"
            raise CommandError(f"{text}; pass {one.name}:=VALUE (--show-args prints all arguments)")
    declared = _BUILT_IN.union(one.name for one, _ in arguments)
    for name in given:
        if name not in declared:
            text = f"{file} declares no argument {name}{did_you_mean(name, declared)}"
            terminal_output.note(f"warning: {text}; it is set nevertheless (--show-args prints all arguments)")


def _serve(service: Any) -> int:
    """Run the service to its end; SIGTERM ends all processes as SIGINT does, and none remains."""
    manager: Any = import_module("launch.launch_service").AsyncSafeSignalManager
    handle = manager.handle
    # The handler of launch would leave its processes running.
    handlers = {signal.SIGTERM: lambda number: service.shutdown(force_sync=True)}
    manager.handle = lambda self, number, handler: handle(self, number, handlers.get(number, handler))
    # docs/internals/protocol.md 15: without a handler in Python, the service is not woken up.
    signal.signal(signal.SIGTERM, lambda number, frame: None)
    if sys.platform == "linux":  # PR_SET_CHILD_SUBREAPER: processes whose parent has ended become children of this one
        ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)
    try:
        return int(service.run())
    finally:
        _end_remaining_processes()


def _end_remaining_processes() -> None:
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C would leave processes
    if names := _children():
        terminal_output.note(f"ending processes that nodes have left behind: {', '.join(names.values())}")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        signalled: set[int] = set()
        end = time.monotonic() + _GRACE_S
        while (names := _children()) and time.monotonic() < end:
            for process in names.keys() - signalled:
                with suppress(OSError):  # it is not permitted
                    os.kill(process, number)
            signalled |= names.keys()
            time.sleep(0.05)
    signal.signal(signal.SIGINT, handler)


def _children() -> dict[int, str]:
    """Return the names of running child processes by number; Linux only."""
    names = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # the process has ended
            match = re.match(r"(\d+) \((.*)\) [^Z] (\d+) ", file.read_text(errors="replace"), re.DOTALL)
            if match and int(match[3]) == os.getpid():
                names[int(match[1])] = f"{match[2]} ({match[1]})"
    return names
