"""Run of a launch file with launch and launch_ros: packages, prefix, arguments, and the end of all its processes.

Packages and executables that the file needs and that do not exist are errors that state the fix, or skipped actions.
With ``--missing skip``, the share folder of a missing package is a path that does not exist, because many files look up
all packages first. The facts about launch and launch_ros are in docs/internals/protocol.md 15.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import site
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from inspect import iscoroutine
from pathlib import Path
from types import FrameType
from typing import Any
from xml.etree.ElementTree import ParseError

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.package_repositories import MessagePackage
from rosidl_py_gen.command_support import CommandError, report, terminal_output
from rosidl_py_gen.compiler.frontend import PackageFiles
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.prefix import executables
from rosidl_py_gen.prefix.build import NAME_RULE, Prefix, build_prefix, is_ament_name
from rosidl_py_gen.prefix.environment import SITE_PACKAGES, make_importable, roots, workspaces
from rosidl_py_gen.prefix.launch_packages import install_command_of, install_note

_ERRORS = ("PackageNotFoundError", "SubstitutionFailure", "FileNotFoundError")
_NOT_FOUND = re.compile("(executable|package|command|file not found:?) ")
"""Pattern of error texts that are about a missing executable, package, command or file."""
_SHARE, _TARGET = "_share_folder", "_LoadComposableNodes__target_container"
"""Private names of other packages: the function of ament_index_python that finds share folders, and an attribute of
launch_ros."""
_PLACE = "_rosidl_py_gen_place"
"""Name of an attribute that is added to actions of launch: the launch file that created the action, and the line (0 in
XML and YAML)."""
_PYTHON_FILE, _FRONTEND_FILE = "python_launch_file", "frontend_launch_file_path"
"""Two names: the module name of every launch file in Python, and the variable of launch with the path of an XML or YAML
file."""
_MAX_DEPTH = 100
"""Maximum depth of includes of launch files."""
_MAX_VALUE_CHARS = 60
_NAMING = r"\b(?:exec|cmd|pkg|find-pkg-\w+)\W+{}(?![\w.-])"
"""Regular expression for XML and YAML text that names a package, executable or command; ``{}`` is replaced by its name.
"""


class MissingParts:
    """Checks for missing packages and executables before and after each action of a launch file runs."""

    def __init__(self, skip: bool, file: str, prefix: Prefix) -> None:
        self._skip, self._file, self._prefix = skip, file, prefix
        self._absent = os.path.join(prefix.folder, "missing")
        self._reported: set[str] = set()
        self._containers: set[str] = set()

    def install(self) -> None:
        """Replace functions of launch so that each action, and each package and command that it needs, is checked."""
        packages: Any = import_module("ament_index_python.packages")
        action, local = import_module("launch").Action, import_module("launch.actions").ExecuteLocal
        load = import_module("launch_ros.actions").LoadComposableNodes
        share, visit, prepare, execute = vars(packages)[_SHARE], action.visit, local.prepare, load.execute
        description = import_module("launch").LaunchDescription
        visit_all = description.visit
        warnings.filterwarnings("ignore", message="Share (directory|path) for")

        def share_folder(name: str) -> str:
            if not self._skip or name in packages.get_packages_with_prefixes():
                return share(name)  # type: ignore[no-any-return]
            self._report(f"package {name}")
            return os.path.join(self._absent, name)

        def prepare_and_check(self: Any, context: Any) -> None:
            prepare(self, context)
            details = self.process_details
            name = details["cmd"][0]
            command = os.path.join((details["cwd"] or "") if os.sep in name else "", name)
            if not self.shell and shutil.which(command, path=(details["env"] or os.environ).get("PATH")) is None:
                raise FileNotFoundError(f"command {command}")

        def record_places(cls: Any) -> None:
            create = cls.__init__

            def create_with_place(self: Any, *arguments: Any, **settings: Any) -> None:
                vars(self)[_PLACE] = _place(traceback.walk_stack(sys._getframe(1)))
                create(self, *arguments, **settings)

            cls.__init__ = create_with_place

        source = import_module("launch").LaunchDescriptionSource
        load_file = source.get_launch_description
        source.get_launch_description = lambda one, context: _checked_description(
            load_file(one, context), str(one.location)
        )
        vars(packages)[_SHARE], local.prepare = share_folder, prepare_and_check
        record_places(action)
        record_places(description)
        action.visit = lambda one, context: self._visit(visit, one, context)
        description.visit = lambda one, context: self._visit(visit_all, one, context)
        load.execute = lambda one, context: self._load(execute, one, context)

    def _visit(self, visit: Any, action: Any, context: Any) -> Any:
        try:
            return _checked_elements(action, visit(action, context))
        except Exception as error:
            location = str(getattr(getattr(action, "launch_description_source", None), "location", ""))
            part = self.part_of(error, action, context)
            if part is None and location.startswith(self._absent):
                part = f"launch file {os.path.relpath(location, self._absent)}"
            if part is None or not self._skip:
                report(self.error_text(error, part, vars(action).get(_PLACE) or (self._file, 0)))
                raise
            if "executable component_container" in part:  # also a Node that names the executable of a container
                self._containers.add(action.node_name)
            self._report(f"{part} ({type(action).__name__})")

    def _report(self, part: str) -> None:
        if part not in self._reported:
            self._reported.add(part)
            terminal_output.note(f"missing, skipped: {part}")

    def _load(self, execute: Any, action: Any, context: Any) -> Any:
        """Execute an action that loads nodes into a container, unless the container was skipped as missing."""
        target = vars(action)[_TARGET]
        name = target.node_name if hasattr(target, "node_name") else _text(target, context)
        if is_skipped := f"/{name.lstrip('/')}" in self._containers:
            self._report(f"nodes of the container {name}")
        return None if is_skipped else execute(action, context)

    def part_of(self, error: BaseException, action: Any = None, context: Any = None) -> str | None:
        """Return a text about the missing package, executable or file that caused an error; None for other errors."""
        for one in _causes(error):
            if isinstance(one, ModuleNotFoundError):
                return f"Python module {one.name}"
            text = str(one.args[0] if one.args else "")
            if type(one).__name__ in _ERRORS and _NOT_FOUND.match(text):
                if getattr(action, "node_package", None):
                    names = _text(action.node_package, context), _text(action.node_executable, context)
                    if any(f"'{name}'" in text for name in names):
                        return self._executable_text(*names)
                return text.partition(", searching")[0].replace("'", "").removesuffix(" not found")
        return None

    def error_text(self, error: BaseException, part: str | None, default: tuple[str, int]) -> str:
        """Return the text of an error in a launch file: location (or `default`), the missing part if known, and how to
        fix it.
        """
        causes = _causes(error)
        cause: Any = causes[-1]
        frames = [pair for one in causes for pair in traceback.walk_tb(one.__traceback__)]
        file, line = _place(reversed(frames)) or default
        if isinstance(cause, ParseError):  # of XML
            line = cause.position[0]
        elif isinstance(cause, SyntaxError):
            file, line = cause.filename or file, cause.lineno or line
        elif mark := getattr(cause, "problem_mark", None):  # of YAML
            line = mark.line + 1
        elif part is not None:
            line = line or _line_naming(part.split()[1], file)
        place = display_path(os.path.realpath(file)) + (f":{line}" if line else "")
        nested = sum(frame.f_code.co_name == "process_entities" for frame, _ in frames)  # of launch
        if isinstance(cause, RecursionError) and nested > _MAX_DEPTH:
            return _includes_itself_text(file)
        if part is None:
            return f"{place}: {type(cause).__name__}: {cause.msg if isinstance(cause, SyntaxError) else cause}"
        package = part.rpartition(" ")[2].partition(".")[0]
        note = install_note(package) or MessagePackage(package).download_note(Distribution.selected().name)
        cure = note or "install it, or pass the folder of its package with --path"
        return f"{place}: missing {part}; {cure}" + ("" if self._skip else ", or start the rest with --missing skip")

    def _executable_text(self, package: str, executable: str) -> str:
        text = f"executable {executable} of {package}"
        if any(one.name == package for one in self._prefix.skipped):
            return f"{text}: its package has C++ code, which is not built"
        prefixes = import_module("ament_index_python.packages").get_packages_with_prefixes()
        if package not in prefixes:
            return f"{text}: no such package{did_you_mean(package, prefixes)}"
        known = sorted(executables.of_prefixes(package))
        return f"{text}{did_you_mean(executable, known)}; it has: {', '.join(known) or 'none in Python'}"


def require_description(description: Any, file: str) -> None:
    """Raise `CommandError` if a launch file has returned something else than descriptions and actions."""
    launch = import_module("launch")
    try:
        pending = [(_checked_description(description, file), 0)]
    except TypeError as error:
        raise CommandError(str(error)) from error
    while pending:
        entity, depth = pending.pop()
        if depth > _MAX_DEPTH:
            raise CommandError(_includes_itself_text(file))
        groups = [entity.describe_sub_entities(), *(group for _, group in entity.describe_conditional_sub_entities())]
        try:
            if isinstance(entity, launch.actions.IncludeLaunchDescription):
                location = entity.launch_description_source.location
                pending += [(_checked_description(one, str(location)), depth + 1) for one in groups[0]]
                continue
            pending += [(one, depth) for group in groups for one in _checked_elements(entity, group) or ()]
        except TypeError as error:
            if isinstance(entity, launch.actions.IncludeLaunchDescription):
                raise CommandError(str(error)) from error
            path, line = vars(entity).get(_PLACE) or (file, 0)
            place = display_path(os.path.realpath(path)) + (f":{line}" if line else "")
            raise CommandError(f"{place}: {error}") from error


def _checked_description(description: Any, file: str) -> Any:
    """Return `description` if it is a LaunchDescription; raises `TypeError` with the launch file otherwise."""
    if isinstance(description, import_module("launch").LaunchDescription):
        return description
    if iscoroutine(description):
        description.close()  # or Python warns that it was never awaited
    text = f"generate_launch_description returned {_described(description)}; expected a LaunchDescription"
    raise TypeError(f"{display_path(os.path.realpath(file))}: {text}")


def _checked_elements(owner: Any, elements: Any) -> list[Any] | None:
    """Return the elements of an action or description; raises `TypeError` for one that launch cannot visit."""
    if elements is None:
        return None
    name, expected = type(owner).__name__, "expected actions and LaunchDescriptions"
    entity = import_module("launch").LaunchDescriptionEntity
    if isinstance(elements, (str, entity)) or not isinstance(elements, Iterable):
        raise TypeError(f"{name} returned {_described(elements)}; {expected} in a list")
    checked = list[Any](elements)
    for number, one in enumerate(checked, 1):
        if not isinstance(one, entity):
            # Other actions add elements of their own.
            position = f"element {number}" if name in ("LaunchDescription", "OpaqueFunction") else "an element"
            cure = "; * in front of the list unpacks it" if isinstance(one, (list, tuple)) else ""
            raise TypeError(f"{position} of {name} is {_described(one)}; {expected}{cure}")
    return checked


def _includes_itself_text(file: str) -> str:
    text = "it includes itself, or a file that includes it; launch reads all includes before their conditions"
    cure = "an OpaqueFunction can return the include only when it is needed"
    return f"{display_path(os.path.realpath(file))}: {text}: {cure}"


def _described(value: Any) -> str:
    """Return a text about a value for errors: its type, and a short form of it."""
    if value is None:
        return "None"
    text = " ".join(ascii(value).split()) if isinstance(value, (str, int, float)) else ""
    return f"a value of type {type(value).__name__}" + (f", {text[:_MAX_VALUE_CHARS]}" if text else "")


def _place(frames: Iterable[tuple[FrameType, int]]) -> tuple[str, int] | None:
    """Return the launch file and line of the first stack frame that runs a launch file in Python, or reads one in XML
    or YAML.

    Returns None if there is no such frame.
    """
    for frame, line in frames:
        if frame.f_globals.get("__name__") == _PYTHON_FILE:
            return frame.f_code.co_filename, line
        if _FRONTEND_FILE in frame.f_code.co_varnames and os.path.isfile(file := frame.f_locals[_FRONTEND_FILE]):
            return file, 0
    return None


def _line_naming(name: str, file: str) -> int:
    """Return the line of an XML or YAML file that names a package, executable or command.

    Returns 0 if there is not exactly one such line.
    """
    text = Path(file).read_text(encoding="utf-8", errors="replace")
    lines = [text.count("\n", 0, one.end()) + 1 for one in re.finditer(_NAMING.format(re.escape(name)), text)]
    return lines[0] if len(lines) == 1 else 0


def _causes(error: BaseException) -> list[BaseException]:
    """Return an error and the errors that explicitly caused it."""
    return [error, *(_causes(error.__cause__) if error.__cause__ else ())]


def _text(value: Any, context: Any) -> str:
    utilities = import_module("launch.utilities")
    return str(utilities.perform_substitutions(context, utilities.normalize_to_list_of_substitutions(value)))


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


def is_launch_file(word: str) -> bool:
    """Return True for the path of a launch file, False for the name of a package.

    Raises:
        CommandError: the word is neither, or looks like a path and there is no such file.
    """
    if os.path.isfile(word):
        return True
    if os.sep in word or word.endswith((".py", *_PARSERS)):
        kind = "it is a folder" if os.path.isdir(word) else "no such file"
        raise CommandError(f"{word}: expected a launch file, {kind}")
    if not is_ament_name(word):
        raise CommandError(f'"{word}" is not a file, nor the name of a package; expected {NAME_RULE}')
    return False


def start_launch(
    words: Sequence[str], paths: Sequence[str], checkouts: Sequence[str], settings: Mapping[str, Any]
) -> Callable[[], None]:
    """Prepare a launch: build a prefix of the workspaces, set environment variables, and install the import hook.

    Returns:
        Function that runs or prints the launch file, and exits.

    Raises:
        CommandError: the launch file, its package, or a package of ROS that launch needs does not exist.
    """
    is_file = is_launch_file(words[0])
    pairs = [word.partition(":=") for word in words[1 if is_file else 2 :]]
    place = Path(words[0]).resolve() if is_file else Path.cwd()
    prefix = build_prefix(roots(workspaces([*paths, *checkouts], place)), runs_setup=True)
    if problems := (*prefix.problems, *prefix.notes):
        more = f" ({len(problems)} such problems; rosidl-py prefix prints all)" if problems[1:] else ""
        terminal_output.note(f"warning: {problems[0]}{more}")
    os.environ.update(prefix.variables)
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
    Extra.require_modules("osrf_pycommon", "packaging", "yaml")


def _file_of_package(package: str, name: str) -> str:
    packages: Any = import_module("ament_index_python.packages")
    known = packages.get_packages_with_prefixes()
    if package not in known:
        text = f'no file and no package "{package}"{did_you_mean(package, known)}; searched the workspace'
        raise CommandError(f"{text}, --path and AMENT_PREFIX_PATH")
    share: str = packages.get_package_share_directory(package, print_warning=False)
    found = {os.path.realpath(os.path.join(share, one)): one for one in reversed(PackageFiles(Path(share)).paths())}
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
