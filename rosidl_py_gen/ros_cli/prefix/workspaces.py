"""Workspaces of a command line, and the imports of a process that uses their packages."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib.machinery import PathFinder
from pathlib import Path

from rosidl_py_gen.compiler.frontend.search_path import Workspace, package_around, workspace_around
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.type_loading.import_hook import ImportHookWarning, install_import_hook
from rosidl_py_gen.type_loading.scan_cache import workspace_packages


def workspaces(paths: Sequence[str], place: Path | None = None) -> list[Workspace]:
    """Return the workspaces of ``--path``, then the workspace of the program `place`, or of the current folder."""
    around = workspace_around(Path.cwd() if place is None else _workspace_folder(place))
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
            f"warning: rclpy is that of rosidl-py-gen {__version__}, not {Path(real.origin).parent}; "
            "so are its companions and all messages"
        )
        warnings.filterwarnings("ignore", category=ImportHookWarning)
    install_import_hook(message_api="rclpy", path=paths, workspace_of=_workspace_folder(place), override_installed=True)


def _workspace_folder(place: Path) -> Path:
    """Return the path around which a workspace is searched: `place`, or the current folder if it is in the workspace of
    `place`.
    """
    here = Path.cwd()
    package = package_around(place)
    if package is None:  # the folder of a script may be large, and is not searched for packages
        is_workspace = here.name == "src" or (here / "src").is_dir() or package_around(here) is not None
        return here if is_workspace else place
    if any(folder.name == "src" for folder in package.parents) or here not in package.parents:
        return place
    around = workspace_around(here)
    return here if around is not None and package in workspace_packages(around).values() else place
