"""Run of the command ``launch``: packages and prefix, arguments of the launch file, and the end of all its
processes.
"""

from __future__ import annotations

import ctypes
import os
import re
import signal
import site
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.package_repositories import install_command_of
from rosidl_py_gen.base.resources import require_modules
from rosidl_py_gen.compiler.frontend.package_files import files_below
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.launch.missing import MissingParts, require_description
from rosidl_py_gen.ros_cli.prefix.build import NAME_RULE, Prefix, build_prefix, is_ament_name
from rosidl_py_gen.ros_cli.prefix.variables import SITE_PACKAGES, variables
from rosidl_py_gen.ros_cli.prefix.workspaces import make_importable, roots, workspaces

_PIP_FOLDERS = ("AMENT_PREFIX_PATH", sys.prefix), ("AMENT_PREFIX_PATH", site.USER_BASE)
"""Environment variables, each with a folder to add to it: pip installs share files of launch and a resource index
there."""
_PARSERS = {".xml": "launch_xml", ".yaml": "launch_yaml", ".yml": "launch_yaml"}
_BUILT_IN = {"emulate_tty", "launch-prefix", "launch-prefix-filter", "sigkill_timeout", "sigterm_timeout"}
"""Names of launch configurations that actions of launch and launch_ros read although no launch file declares them."""
_CONDITIONAL = "_conditionally_included"
_GRACE_S = 1.0
"""Time in seconds between SIGINT, SIGTERM and SIGKILL to a process that a node has left behind; all end within 5 s of
Ctrl-C."""


def start(
    words: Sequence[str], paths: Sequence[str], checkouts: Sequence[str], settings: Mapping[str, Any]
) -> Callable[[], None]:
    """Prepare a launch: build a prefix of the workspaces, set environment variables, and install the import hook.

    Returns:
        Function that runs or prints the launch file, and exits.

    Raises:
        CommandError: the launch file, its package, or a package of ROS that launch needs does not exist.
    """
    is_file = os.path.isfile(words[0])
    if not is_file and (os.sep in words[0] or words[0].endswith((".py", *_PARSERS))):
        kind = "it is a folder" if os.path.isdir(words[0]) else "no such file"
        raise CommandError(f"{words[0]}: expected a launch file, {kind}")
    if not (is_file or is_ament_name(words[0])):
        raise CommandError(f'"{words[0]}" is not a file, nor the name of a package; expected {NAME_RULE}')
    pairs = [word.partition(":=") for word in words[1 if is_file else 2 :]]
    place = Path(words[0]).resolve() if is_file else Path.cwd()
    prefix = build_prefix(roots(workspaces([*paths, *checkouts], place)), runs_setup=True)
    if problems := (*prefix.problems, *prefix.notes):
        more = f" ({len(problems)} such problems; rosidl-py prefix prints all)" if problems[1:] else ""
        terminal_output.note(f"warning: {problems[0]}{more}")
    os.environ.update(variables(prefix.folder))
    for name, folder in (*_PIP_FOLDERS, ("PATH", os.path.dirname(sys.executable))):
        os.environ[name] += f"{os.pathsep}{folder}" if folder else ""
    sys.path.append(str(prefix.folder / SITE_PACKAGES))
    make_importable(place, [*paths, *checkouts])
    file = str(place) if is_file else _file_of_package(words[0], words[1] if len(words) > 1 else "")
    _require_packages("launch", "launch_ros", _PARSERS.get(os.path.splitext(file)[1], "launch"))
    return lambda: _run(file, {name: value for name, _, value in pairs}, settings, prefix)


def _require_packages(*names: str) -> None:
    """Raise `CommandError` with the command that installs a package of ROS, if it is missing or another package has its
    name.
    """
    for name in names:
        spec = find_spec(name)
        if spec is None or spec.origin is None:
            text = f"the package {name} of ROS is neither installed nor below --path"
        elif name == "launch" and not hasattr(import_module(name), "LaunchService"):
            text = f"{spec.origin} is another package with the name launch"
        else:
            continue
        raise CommandError(f"{text}; run: {install_command_of(name)}")
    require_modules("osrf_pycommon", "packaging", "yaml")


def _file_of_package(package: str, name: str) -> str:
    packages: Any = import_module("ament_index_python.packages")
    known = packages.get_packages_with_prefixes()
    if package not in known:
        text = f'no file and no package "{package}"{did_you_mean(package, known)}; searched the workspace'
        raise CommandError(f"{text}, --path and AMENT_PREFIX_PATH")
    share: str = packages.get_package_share_directory(package, print_warning=False)
    found = {os.path.realpath(os.path.join(share, one)): one for one in reversed(files_below(Path(share)))}
    files = sorted(found.values())  # of links to one file, the first
    is_path = os.path.isfile(os.path.join(share, name))
    matching = [name] if is_path else [one for one in files if os.path.basename(one) == name]
    if len(matching) == 1:
        return os.path.join(share, matching[0])
    if matching:
        paths = ", ".join(matching)
        raise CommandError(f"{package} has several files {name}: {paths}; pass one of these paths instead of the name")
    files = [one for one in files if "launch" in os.path.basename(one) and one.endswith((".py", *_PARSERS))]
    text = f'{package} ({display_path(share)}) has no file "{name}"' if name else f"expected a launch file of {package}"
    hint = did_you_mean(name, map(os.path.basename, files))
    raise CommandError(f"{text}{hint}; its launch files: {', '.join(files) or 'none'}")


def _run(file: str, arguments: dict[str, str], settings: Mapping[str, Any], prefix: Prefix) -> None:
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
        require_description(description, file)
        if is_run:
            _check_arguments(description, arguments, display_path(os.path.realpath(file)))
        elif settings["show_args"]:
            text = _arguments_text(description.get_launch_arguments())
        else:
            text = launch.LaunchIntrospector().format_launch_description(description)
    except CommandError:
        raise
    except Exception as error:
        raise CommandError(missing.error_text(error, missing.part_of(error), (file, 0))) from error
    if not is_run:
        return terminal_output.block(text)
    source = launch.LaunchDescriptionSource(description, file, "launch file")
    include = launch.actions.IncludeLaunchDescription(source, launch_arguments=arguments.items())
    service.include_launch_description(launch.LaunchDescription([include]))
    sys.exit(_serve(service))


def _arguments_text(arguments: list[Any]) -> str:
    """Return the text about arguments of a launch file that `ros2 launch --show-args` prints."""
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
    """Run a LaunchService to its end and return its exit code; SIGTERM, like SIGINT, ends all processes."""
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
    """Return the names of running child processes by process ID; empty except on Linux."""
    names = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # the process has ended
            match = re.match(r"(\d+) \((.*)\) [^Z] (\d+) ", file.read_text(errors="replace"), re.DOTALL)
            if match and int(match[3]) == os.getpid():
                names[int(match[1])] = f"{match[2]} ({match[1]})"
    return names
