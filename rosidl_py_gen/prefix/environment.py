"""Environment of processes that use the packages of a workspace: executables, variables, workspaces and imports.

An `Executable` belongs to a package or a command line, and a program in a prefix runs it.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.machinery import PathFinder
from pathlib import Path

from rosidl_py_gen import ImportHookWarning, install_import_hook
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.resources import RUN_PREFIX
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.compiler.frontend import Workspace
from rosidl_py_gen.type_loading import workspace_packages

_RUN_FUNCTION = """from {module} import {first}

if __name__ == "__main__":
    sys.exit({function}())
"""
_RUN_FILE = """__file__ = {file!a}
sys.path.insert(0, {folder!a})
with open(__file__, "rb") as _script:
    _code = compile(_script.read(), __file__, "exec", dont_inherit=True)
exec(_code)
"""
_MAX_SHEBANG = 120
"""Maximum length of the first line of a program, which names the interpreter; Linux before 5.1 reads 127 bytes."""


@dataclass(frozen=True)
class Executable:
    """Python executable: a script, a module, or a function of a module.

    Attributes:
        name: name in its package; of a program that is run, `sys.argv[0]`.
        folder: first folder of `sys.path`.
        module: module that becomes `__main__` or has the function; None for a script that is not run as a module.
        function: function of a console script, with dots for attributes, or None.
        warning: text that is printed when the executable starts, or empty.
    """

    name: str
    folder: Path
    file: Path | None = None
    module: str | None = None
    function: str | None = None
    warning: str = ""

    @property
    def place(self) -> Path:
        """Path that determines the workspace of the executable: its script, or else its folder."""
        return self.folder if self.file is None else self.file.resolve()

    @property
    def is_python(self) -> bool:
        """True unless the executable is a file that is not written in Python."""
        return self.file is None or self.file.suffix == ".py" or is_python_program(self.file)

    def program(self) -> bytes:
        """Return the text of a program that runs the script, or ends with the function's result, with this Python."""
        first = f"#!{sys.executable}"
        if len(os.fsencode(first)) > _MAX_SHEBANG or any(map(str.isspace, first)) or not first.isascii():
            quoted = sys.executable.replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$").replace("`", "\\`")
            first = f"""#!/bin/sh\n'''exec' "{quoted}" "$0" "$@"\n' '''"""  # sh starts Python, for which it is a text
        if self.file is not None:
            text = _RUN_FILE.format(file=str(self.file), folder=str(self.file.parent))
        else:
            name = str(self.function)
            text = _RUN_FUNCTION.format(module=self.module, first=name.partition(".")[0], function=name)
        if self.warning:
            text = f"print({'warning: ' + self.warning!a}, file=sys.stderr)\n{text}"
        return os.fsencode(f"{first}\n# Written by rosidl-py prefix.\nimport sys\n\n{text}")


def is_python_program(file: Path) -> bool:
    """Return True for a file whose first line, ``#!...``, names Python as interpreter."""
    if not file.is_file():  # opening a pipe would wait for its writer
        return False
    with file.open("rb") as opened:
        line = opened.readline(200)
    return line.startswith(b"#!") and b"python" in line


SITE_PACKAGES = f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
PROGRAMS = "lib/rosidl_py_gen/bin"
"""Folder of a prefix with programs that a ROS installation has on PATH, such as ros2."""
FIXED = {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3"}


def variables(prefix: Path | None) -> dict[str, str]:
    """Return environment variables for a process that uses a prefix (if not None).

    Variables with lists keep their current entries.
    """
    found = {name: os.environ.get(name, value) for name, value in FIXED.items()} | of_distribution()
    found[RUN_PREFIX] = ""
    for name, folder in folders(prefix).items() if prefix is not None else ():
        places = (str(folder), *filter(None, os.environ.get(name, "").split(os.pathsep)))
        found[name] = os.pathsep.join(dict.fromkeys(places))
    if prefix is not None:  # at the end: programs of a ROS installation precede
        found["PATH"] = os.pathsep.join(dict.fromkeys((*found["PATH"].split(os.pathsep), str(prefix / PROGRAMS))))
    return found


def of_distribution() -> dict[str, str]:
    """Return the variables that name the selected distribution; {} if only the user has set ROS_DISTRO."""
    choice = Distribution.selected()
    if choice.is_explicit:
        return {Distribution.VARIABLE: choice.name}
    is_default = os.environ.get(Distribution.VARIABLE) in (None, "", os.environ.get(Distribution.ASSUMED_VARIABLE))
    names = (Distribution.ASSUMED_VARIABLE, Distribution.VARIABLE)
    return dict.fromkeys(names, Distribution.DEFAULT) if is_default else {}


def folders(prefix: Path) -> dict[str, Path]:
    """Return the folders of a prefix, each by the environment variable that lists it."""
    return {"AMENT_PREFIX_PATH": prefix, "PYTHONPATH": prefix / SITE_PACKAGES, "PATH": prefix / "bin"}


def workspaces(paths: Sequence[str], place: Path | None = None) -> list[Workspace]:
    """Return the workspaces of ``--path``, then the workspace of the program `place`, or of the current folder."""
    around = Workspace.around(Path.cwd() if place is None else _workspace_folder(place))
    return [*(Workspace(Path(path).resolve()) for path in paths), *([around] if around else [])]


def roots(found: Sequence[Workspace]) -> list[Path]:
    """Return the folders that contain all packages of some workspaces; prints a note about an incomplete search."""
    for one in found:
        if one.packages and one.holds_others and one.limit_text:
            terminal_output.note(f"note: {one.limit_text}")
    return [root for one in found if one.packages for root in one.roots]


def make_importable(place: Path, paths: Sequence[str]) -> None:
    """Make rclpy, messages and workspace packages importable; print a warning if an installed rclpy is replaced."""
    real = PathFinder.find_spec("rclpy")
    if real is not None and real.origin is not None:
        from rosidl_py_gen import __version__

        terminal_output.note(
            f"warning: rclpy comes from rosidl-py-gen {__version__}, not from {Path(real.origin).parent}; "
            "so do its companions and all messages"
        )
        warnings.filterwarnings("ignore", category=ImportHookWarning)
    install_import_hook(message_api="rclpy", path=paths, workspace_of=_workspace_folder(place), override_installed=True)


def _workspace_folder(place: Path) -> Path:
    """Return the path around which a workspace is searched: `place`, or the current folder if it is in the workspace of
    `place`.
    """
    here = Path.cwd()
    package = Workspace.package_around(place)
    if package is None:  # the folder of a script may be large, and is not searched for packages
        is_workspace = here.name == "src" or (here / "src").is_dir() or Workspace.package_around(here) is not None
        return here if is_workspace else place
    if any(folder.name == "src" for folder in package.parents) or here not in package.parents:
        return place
    around = Workspace.around(here)
    return here if around is not None and package in workspace_packages(around).values() else place
