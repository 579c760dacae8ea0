"""Executables of a package, read from its sources. Only a setup.py is run, if the caller asks for it.

Executables are console scripts, scripts, the files that CMakeLists.txt installs as PROGRAMS, and Python programs that
are installed into ``lib/<package>``. An installed package has the console scripts of its distribution, and the
executable files of its prefix.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.compiler.frontend import CMakeScript, PackageBudget, PackageFiles, UnreadableError
from rosidl_py_gen.errors import RosidlError, display_path
from rosidl_py_gen.prefix.environment import Executable, is_python_program
from rosidl_py_gen.type_loading import Install, PackageSetup, workspace_packages

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend import Workspace

_ENTRY = re.compile(r"\s*([^\s=]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*(?:\[.*\])?\s*")
_GROUP = "console_scripts"
_IN_LIB = re.compile(r"lib/(?!python\d)")
BUNDLED: dict[str, dict[str, str]] = {
    "joint_state_publisher": {"joint_state_publisher": "rosidl_py_gen.robot.joint_state_publisher:main"},
    "joint_state_publisher_gui": {
        "joint_state_publisher_gui": "rosidl_py_gen.robot.joint_state_publisher:main_without_window"
    },
    "robot_state_publisher": {"robot_state_publisher": "rosidl_py_gen.robot.robot_state_publisher:main"},
    "tf2_ros": {"static_transform_publisher": "rosidl_py_gen.robot.static_transform_publisher:main"},
}
"""Executables of ROS packages that rosidl-py-gen contains: a dict by ROS package, then by name, with
``module:function``."""


def find_executables(
    package: str, workspaces: Sequence[Workspace], *, runs_setup: bool = False
) -> tuple[dict[str, Executable], list[str]]:
    """Return the executables of a package by name, from its sources, pip or a prefix, and the folders with them.

    Args:
        package: name of the package.
        workspaces: workspaces that may have sources of the package; the first has precedence.
        runs_setup: run a setup.py that cannot be read completely.

    Raises:
        CommandError: a file of the package cannot be read.
    """
    places: list[str] = []
    for workspace in workspaces:
        if folder := workspace_packages(workspace).get(package):
            places.append(str(folder))
            if by_name := of_sources(folder, package, runs_setup=runs_setup):
                return by_name, places
    for find in (of_distribution, of_bundled, of_prefixes):
        if by_name := find(package):
            return by_name, [str(next(iter(by_name.values())).folder)]
    return {}, places


def of_sources(folder: Path, name: str = "", *, runs_setup: bool = False) -> dict[str, Executable]:
    """Return the executables of a source package by name.

    Args:
        folder: folder of the package.
        name: name of the package, for warnings about executables that a build does not install into ``lib/NAME``.
        runs_setup: run a setup.py that cannot be read completely.

    Raises:
        CommandError: a file cannot be read.
    """
    budget = PackageBudget()
    try:
        setup = read_setup(folder, budget, runs_setup)
    except RosidlError as error:
        raise CommandError(str(error)) from error
    try:
        found = [
            *console_scripts(setup, folder, name, lambda text: terminal_output.note(f"warning: {text}")),
            *_scripts(setup, folder),
            *(_programs(folder, budget) if (folder / "CMakeLists.txt").is_file() else ()),
        ]
    except UnreadableError as error:
        raise CommandError(f"{folder / 'CMakeLists.txt'}: {error.reason}") from error
    for text in setup.problems:
        terminal_output.note_once(f"warning: {text}")
    if text := uncertain_text(setup, folder, "entry_points", "scripts"):
        terminal_output.note_once(f"note: {text}; there may be other executables")
    return {one.name: one for one in reversed(found)}


def read_setup(folder: Path, budget: PackageBudget, runs_setup: bool) -> PackageSetup:
    """Return the install rules of a Python package; with `runs_setup`, a setup.py that cannot be read completely runs.

    Raises:
        RosidlError: a file cannot be read; the text begins with the path of the file.
    """
    return PackageSetup.read(folder, budget, _run_setup_py if runs_setup else None)


def _run_setup_py(folder: Path, why: str) -> list[dict[str, object]]:
    # Slow to import, and rarely needed.
    from rosidl_py_gen.prefix.setup_process import run_setup_py

    return run_setup_py(folder, why)


def uncertain_text(setup: PackageSetup, folder: Path, *arguments: str) -> str:
    """Return a text about which of the `arguments` of the call of ``setup()`` are unknown; "" if all are known."""
    unknown = [name for name in arguments if name in setup.uncertain]
    place = display_path(folder / (setup.unread or "setup.py"))
    text = f"{' and '.join(unknown)} of {place} are not known{'' if setup.unread else ' without running it'}: "
    return text + setup.uncertain[unknown[0]] if unknown else ""


def console_scripts(
    setup: PackageSetup, folder: Path, package: str, problem: Callable[[str], None]
) -> list[Executable]:
    """Return the console scripts of a package; calls `problem` with a text for each malformed one."""
    found = []
    root = PackageFiles.inside(setup.folders.get("", "")) or ""
    warning = "" if not package or setup.scripts_folder == f"lib/{package}" else _elsewhere(setup, package)
    for text in filter(str.strip, setup.groups.get(_GROUP, ())):
        if match := _ENTRY.fullmatch(text):
            found.append(Executable(match[1], folder / root, None, match[2], match[3], warning))
        else:
            expected = f'expected "name = module:function", found "{text.strip()[:200]}"'
            problem(f"{display_path(folder)}: console_scripts: {expected}; it is skipped")
    return found


def _elsewhere(setup: PackageSetup, package: str) -> str:
    """Return a warning for an executable that a build installs in a place where ros2 run and launch do not find it."""
    return (
        f"a build installs this executable of {package} into {setup.scripts_folder}, where ros2 run and launch do not "
        f"find it; setup.cfg needs [develop] script_dir=$base/lib/{package} and "
        f"[install] install_scripts=$base/lib/{package}"
    )


def _scripts(setup: PackageSetup, folder: Path) -> Iterator[Executable]:
    """Yield the scripts that setup.py declares, and the Python programs among its data files below ``lib``."""
    installs = [
        Install(folder, "PROGRAMS", tuple(setup.texts("scripts")), setup.scripts_folder),
        *(one for one in setup.data_files if _IN_LIB.match(one.destination)),
    ]
    for one in installs:
        for name, path in one.files():
            if one.kind == "PROGRAMS" or is_lib_program(folder / path):
                yield Executable(name, folder, folder / path)


def is_lib_program(file: Path) -> bool:
    """Return True if a file that is installed below ``lib`` is a Python program."""
    return (file.suffix == ".py" and os.access(file, os.X_OK)) or is_python_program(file)


def of_distribution(package: str) -> dict[str, Executable]:
    """Return the console scripts of a package that pip has installed, by name; {} if it is not installed."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        installed = distribution(package)
    except PackageNotFoundError:
        return {}
    scripts = {one.name: one.value for one in installed.entry_points if one.group == _GROUP}
    return _functions(scripts, Path(str(installed.locate_file(""))))


def of_bundled(package: str) -> dict[str, Executable]:
    """Return the executables of a ROS package that rosidl-py-gen contains, by name."""
    return _functions(BUNDLED.get(package, {}), Path(__file__).parents[2])


def _functions(values: Mapping[str, str], folder: Path) -> dict[str, Executable]:
    found = {name: _ENTRY.fullmatch(f"{name} = {value}") for name, value in values.items()}
    return {name: Executable(name, folder, None, one[2], one[3]) for name, one in found.items() if one}


def of_prefixes(package: str) -> dict[str, Executable]:
    """Return the executable files in ``lib/<package>`` of the prefixes in AMENT_PREFIX_PATH, by name."""
    executables: dict[str, Executable] = {}
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        for path in sorted(Path(prefix, "lib", package).glob("*")):
            if path.is_file() and os.access(path, os.X_OK):
                executables.setdefault(path.name, Executable(path.name, path.parent, path))
    return executables


def _programs(folder: Path, budget: PackageBudget) -> Iterator[Executable]:
    """Yield files that CMakeLists.txt installs as PROGRAMS, and Python files that it installs into ``lib``."""
    for one in Install.of_cmake(folder, CMakeScript.read(folder, budget)):
        is_program = one.kind == "PROGRAMS"
        if is_program or one.destination.startswith("lib/"):
            for name, path in one.files():
                if is_program or (path.endswith(".py") and "/" not in name):
                    yield Executable(name, folder, folder / path)
