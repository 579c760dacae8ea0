"""Finding the launch file and the packages launch and launch_ros, and preparing the prefix of the workspace."""

from __future__ import annotations

import os
import site
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.resources import install_command, require_modules
from rosidl_py_gen.compiler.frontend.workspace import Workspace, workspace_around
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import CommandError, terminal_output
from rosidl_py_gen.ros_cli.prefix.build import build_prefix
from rosidl_py_gen.ros_cli.prefix.variables import SITE_PACKAGES
from rosidl_py_gen.ros_cli.program_runner.run import make_importable

_ORIGINS = dict.fromkeys(("launch", "launch_xml", "launch_yaml"), "launch@3.4.3") | {"launch_ros": "launch_ros@0.26.6"}
"""Repositories of ros2 and versions of Jazzy. The package index has another `launch`: docs/internals/protocol.md 15."""
_PIP_FOLDERS = ("AMENT_PREFIX_PATH", sys.prefix), ("AMENT_PREFIX_PATH", site.USER_BASE)
"""Folders into which pip installs the share files of launch, and a resource index."""
_PARSERS = {".xml": "launch_xml", ".yaml": "launch_yaml", ".yml": "launch_yaml"}


def start(
    words: Sequence[str], paths: Sequence[str], checkouts: Sequence[str], settings: Mapping[str, Any]
) -> Callable[[], None]:
    """Prepare imports, environment and prefix; returns a function that runs or prints the launch file, and exits."""
    is_file = os.path.isfile(words[0])
    if not is_file and (os.sep in words[0] or words[0].endswith((".py", *_PARSERS))):
        kind = "it is a folder" if os.path.isdir(words[0]) else "no such file"
        raise CommandError(f"{words[0]}: expected a launch file, {kind}")
    pairs = [word.partition(":=") for word in words[1 if is_file else 2 :]]
    if wrong := ["".join(pair) for pair in pairs if not (pair[0] and pair[1])]:
        raise click.UsageError(f'expected NAME:=VALUE, found "{wrong[0]}"')
    place = Path(words[0]).resolve() if is_file else Path.cwd()
    around = workspace_around(place) or workspace_around(Path.cwd())
    sources = [folder.resolve() for folder in (*(around.roots if around else ()), *map(Path, (*paths, *checkouts)))]
    prefix = build_prefix(folder for folder in sources if Workspace(folder).packages)
    if prefix.problems:
        more = f" ({len(prefix.problems)} such problems; rosidl-py prefix prints all)" if prefix.problems[1:] else ""
        terminal_output.note(f"warning: {prefix.problems[0]}{more}")
    os.environ.update(prefix.environment())
    for name, folder in (*_PIP_FOLDERS, ("PATH", os.path.dirname(sys.executable))):
        os.environ[name] += f"{os.pathsep}{folder}" if folder else ""
    sys.path.append(str(prefix.folder / SITE_PACKAGES))
    make_importable(place, [*paths, *checkouts])
    file = str(place) if is_file else _file_of_package(words[0], words[1] if len(words) > 1 else "")
    _require_packages("launch", "launch_ros", _PARSERS.get(os.path.splitext(file)[1], "launch"))
    from rosidl_py_gen.ros_cli.launch.service import run

    return lambda: run(file, {name: value for name, _, value in pairs}, settings, prefix)


def _require_packages(*names: str) -> None:
    """Raise `CommandError` with the commands of pip if a package of ROS is missing, or another one has its name."""
    for name in names:
        spec = find_spec(name)
        if spec is None or spec.origin is None:
            text = f"the package {name} of ROS is neither installed nor below --path"
        elif name == "launch" and not hasattr(import_module(name), "LaunchService"):
            text = f"{spec.origin} is another package with the name launch"
        else:
            continue
        needed = [one for one in _ORIGINS if find_spec(one) is None or one == name]
        urls = " ".join(f"'git+https://github.com/ros2/{_ORIGINS[one]}#subdirectory={one}'" for one in needed)
        raise CommandError(
            f"{text}; run: {install_command('launch')} && pip install --no-deps {urls}; or clone "
            "https://github.com/ros2/launch and https://github.com/ros2/launch_ros, and pass --launch-from FOLDER"
        )
    require_modules("osrf_pycommon", "packaging", "yaml")


def _file_of_package(package: str, name: str) -> str:
    packages: Any = import_module("ament_index_python.packages")
    known = packages.get_packages_with_prefixes()
    if package not in known:
        text = f'no file and no package "{package}"{did_you_mean(package, known)}; searched the workspace'
        raise CommandError(f"{text}, --path and AMENT_PREFIX_PATH")
    share: str = packages.get_package_share_directory(package, print_warning=False)
    files = files_below(share)
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


def files_below(folder: str | Path) -> list[str]:
    """Return the relative paths of all files below a folder; of links to one file, the first."""
    found: dict[str, str] = {}
    visited: set[str] = set()
    for inside, folders, files in os.walk(folder, followlinks=True):
        real = os.path.realpath(inside)
        folders[:] = sorted(one for one in folders if real not in visited and not one.startswith("."))
        visited.add(real)  # links may form loops
        for path in (os.path.join(inside, name) for name in sorted(files)):
            found.setdefault(os.path.realpath(path), os.path.relpath(path, folder))
    return sorted(found.values())
