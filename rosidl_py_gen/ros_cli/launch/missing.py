"""Packages and executables that a launch file needs and that do not exist: errors with a cure, or skipped actions.

With ``--missing skip``, actions that need a missing part do nothing, and each part is reported once. The share folder
of a missing package is a path that does not exist, because many files look up all packages before they create actions.
What this depends on in launch and launch_ros: docs/internals/protocol.md 15.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import sysconfig
import traceback
import warnings
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.distributions import selected
from rosidl_py_gen.base.message_packages import download_note
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import report, terminal_output

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.prefix import Prefix

_NOT_FOUND = re.compile(r"(executable|package|file not found:?) .*")
"""Texts of SubstitutionFailure for executables and packages."""

_SHARE, _TARGET = "_share_folder", "_LoadComposableNodes__target_container"
"""Private names: our function that finds share folders, and an attribute of launch_ros without a public name."""


_CONTAINER = "executable component_container"


class _MissingCommandError(Exception):
    """The command of an action does not exist."""


class MissingParts:
    """Checks of actions before and after they run."""

    def __init__(self, skip: bool, file: str, prefix: Prefix) -> None:
        self._skip, self._file, self._prefix = skip, file, prefix
        self._not_built = {one.name: one for one in prefix.skipped}
        self._absent = os.path.join(prefix.folder, "missing")
        self._reported: set[str] = set()
        self._containers: set[str] = set()

    def install(self) -> None:
        """Replace `Action.visit`, through which launch runs each action, and what finds packages and commands."""
        packages: Any = import_module("ament_index_python.packages")
        action, local = import_module("launch").Action, import_module("launch.actions").ExecuteLocal
        load = import_module("launch_ros.actions").LoadComposableNodes
        share, visit, prepare, execute = vars(packages)[_SHARE], action.visit, local.prepare, load.execute
        warnings.filterwarnings("ignore", message="Share (directory|path) for")

        def share_folder(name: str) -> str:
            try:
                return share(name)  # type: ignore[no-any-return]
            except packages.PackageNotFoundError:
                if not self._skip:
                    raise
                self._report(f"package {name}")
                return os.path.join(self._absent, name)

        def prepare_and_check(self: Any, context: Any) -> None:
            prepare(self, context)
            details = self.process_details
            command, environment = details["cmd"][0], details["env"] or os.environ
            if os.sep in command:
                command = os.path.join(details["cwd"] or "", command)
            if not self.shell and shutil.which(command, path=environment.get("PATH")) is None:
                raise _MissingCommandError(f"command {command}")

        vars(packages)[_SHARE], local.prepare = share_folder, prepare_and_check
        action.visit = lambda one, context: self._visit(visit, one, context)
        load.execute = lambda one, context: None if self._lacks_container(one, context) else execute(one, context)

    def _visit(self, visit: Any, action: Any, context: Any) -> Any:
        try:
            return visit(action, context)
        except Exception as error:
            part = self.part_of(error, action, context)
            if part is None or not self._skip:
                report(self.error_text(error, part))
                raise
            if _CONTAINER in str(part):  # also a Node that names the executable of a container
                self._containers.add(action.node_name)
            self._report(f"{part} ({type(action).__name__})")
            return None

    def _report(self, part: str) -> None:
        if part not in self._reported:
            self._reported.add(part)
            terminal_output.note(f"missing, skipped: {part}")

    def _lacks_container(self, action: Any, context: Any) -> bool:
        """Return True for nodes that would wait forever for a container that was skipped."""
        target = vars(action)[_TARGET]
        name = target.node_name if hasattr(target, "node_name") else _text(target, context)
        if f"/{name.lstrip('/')}" not in self._containers:
            return False
        self._report(f"nodes of the container {name}")
        return True

    def part_of(self, error: BaseException, action: Any = None, context: Any = None) -> str | None:
        """Return the missing part that an error is about; None for other errors."""
        for one in _causes(error):
            kind = type(one).__name__
            is_failure = kind == "SubstitutionFailure" and _NOT_FOUND.match(str(one))
            is_of_node = kind == "PackageNotFoundError" or (is_failure and is_failure[1] in ("executable", "package"))
            if is_of_node and getattr(action, "node_package", None):
                return self._executable_text(
                    _text(action.node_package, context), _text(action.node_executable, context)
                )
            if kind == "PackageNotFoundError":
                return str(one.args[0]).partition(", searching")[0].replace("'", "").removesuffix(" not found")
            if isinstance(one, ModuleNotFoundError):
                return f"Python module {one.name}"
            if is_failure or isinstance(one, _MissingCommandError):
                return str(one)
        location = str(getattr(getattr(action, "launch_description_source", None), "location", ""))
        return f"launch file {os.path.relpath(location, self._absent)}" if location.startswith(self._absent) else None

    def error_text(self, error: BaseException, part: str | None) -> str:
        """Return an error, or its missing part, with the place in the launch file that caused it, and a cure."""
        cause = _causes(error)[-1]
        file, line = self._file, None
        if hasattr(cause, "position"):  # of XML
            line = cause.position[0]
        elif (mark := getattr(cause, "problem_mark", None)) is not None:  # of YAML
            line = mark.line + 1
        elif isinstance(cause, SyntaxError):
            file, line = cause.filename or file, cause.lineno
        elif frames := [*filter(_is_of_user, traceback.extract_tb(cause.__traceback__))]:
            file, line = frames[-1].filename, frames[-1].lineno
        place = display_path(os.path.realpath(file)) + (f":{line}" if line else "")
        if part is None:
            return f"{place}: {type(cause).__name__}: {cause.msg if isinstance(cause, SyntaxError) else cause}"
        package = part.rpartition(" ")[2].partition(".")[0]
        cure = download_note(package, selected().name) or "install it, or pass the folder of its package with --path"
        return f"{place}: missing {part}; {cure}" + ("" if self._skip else ", or start the rest with --missing skip")

    def _executable_text(self, package: str, executable: str) -> str:
        text = f"executable {executable} of {package}"
        if package in self._not_built:
            return f"{text}: its package has C++ code, which is not built"
        folder = self._prefix.folder / "lib" / package
        if package in self._prefix.packages or folder.is_dir():
            known = sorted(os.listdir(folder)) if folder.is_dir() else []
            return f"{text}{did_you_mean(executable, known)}; it has: {', '.join(known) or 'none in Python'}"
        return f"{text}: no such package{did_you_mean(package, self._prefix.packages)}"


def _causes(error: BaseException) -> list[BaseException]:
    """Return an error and its explicit causes."""
    return [error, *(_causes(error.__cause__) if error.__cause__ else ())]


def _is_of_user(frame: traceback.FrameSummary) -> bool:
    modules = (sys.modules.get(name) for name in ("launch", "launch_ros", "launch_xml", "launch_yaml", "rosidl_py_gen"))
    folders = {str(Path(one.__path__[0])) for one in modules if one is not None}
    folders |= {sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    return not frame.filename.startswith((*folders, "<"))


def _text(value: Any, context: Any) -> str:
    utilities = import_module("launch.utilities")
    return str(utilities.perform_substitutions(context, utilities.normalize_to_list_of_substitutions(value)))
