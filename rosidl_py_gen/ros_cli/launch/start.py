"""Finding the launch file and the packages launch and launch_ros, and preparing the prefix of the workspace."""

from __future__ import annotations

import importlib
import os
import site
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.resources import install_command, require_modules
from rosidl_py_gen.compiler.frontend.workspace import Workspace, workspace_around
from rosidl_py_gen.errors import display_path
from rosidl_py_gen.ros_cli import CommandError, terminal_output
from rosidl_py_gen.ros_cli.prefix import build_prefix
from rosidl_py_gen.ros_cli.prefix.package_plan import SITE_PACKAGES
from rosidl_py_gen.ros_cli.program_runner.run import make_importable, set_environment

_URL = "git+https://github.com/ros2/"
_ORIGINS = {
    "launch": f"{_URL}launch@3.4.3#subdirectory=launch",
    "launch_xml": f"{_URL}launch@3.4.3#subdirectory=launch_xml",
    "launch_yaml": f"{_URL}launch@3.4.3#subdirectory=launch_yaml",
    "launch_ros": f"{_URL}launch_ros@0.26.6#subdirectory=launch_ros",
}
"""Packages of Jazzy for pip. --no-deps, as the package index has another `launch`: docs/internals/protocol.md 15."""
_ENDINGS = (".launch.py", ".launch.xml", ".launch.yaml", ".launch.yml", "_launch.py", "_launch.xml", "_launch.yaml")


def start(
    words: Sequence[str], paths: Sequence[str], checkouts: Sequence[str], settings: Mapping[str, Any]
) -> Callable[[], None]:
    """Prepare imports, environment and prefix; returns a function that runs or prints the launch file, and exits."""
    if not words:
        raise click.UsageError("expected a launch file, or a package and a launch file")
    is_file = os.path.isfile(words[0])
    if not is_file and (words[0].endswith((".py", ".xml", ".yaml", ".yml")) or os.sep in words[0]):
        kind = "it is a folder" if os.path.isdir(words[0]) else "no such file"
        raise CommandError(f"{words[0]}: expected a launch file, {kind}")
    arguments = _arguments(words[1 if is_file else 2 :])
    place = Path(words[0]).resolve() if is_file else Path.cwd()
    around = workspace_around(place) or workspace_around(Path.cwd())
    roots = [folder.resolve() for folder in around.roots] if around is not None and around.packages else []
    given = [Path(one).resolve() for one in (*paths, *checkouts)]
    prefix = build_prefix([*roots, *(one for one in given if Workspace(one).packages)])
    if prefix.problems:
        more = f" ({len(prefix.problems)} such problems; rosidl-py prefix prints all)" if prefix.problems[1:] else ""
        terminal_output.note(f"warning: {prefix.problems[0]}{more}")
    set_environment()
    index = "share/ament_index/resource_index"  # pip installs launch with an index and share files
    pip_folders = [one for one in (sys.prefix, site.USER_BASE) if one and os.path.isdir(os.path.join(one, index))]
    last = {"AMENT_PREFIX_PATH": pip_folders, "PATH": [os.path.dirname(sys.executable)]}
    variables = prefix.environment()
    os.environ.update(variables | {name: os.pathsep.join([variables[name], *last[name]]) for name in last})
    sys.path.append(str(prefix.folder / SITE_PACKAGES))
    make_importable(place, [*paths, *checkouts])
    file = str(place) if is_file else _file_of_package(words[0], words[1] if len(words) > 1 else "")
    parser = {".xml": ["launch_xml"], ".yml": ["launch_yaml"], ".yaml": ["launch_yaml"]}
    for name in ("launch", "launch_ros", *parser.get(os.path.splitext(file)[1], [])):
        _require(name)
    require_modules("osrf_pycommon", "packaging", "yaml")
    from rosidl_py_gen.ros_cli.launch import service

    return lambda: service.run(file, arguments, settings, prefix)


def _arguments(words: Sequence[str]) -> dict[str, str]:
    arguments = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not (name and separator):
            raise click.UsageError(f'expected NAME:=VALUE, found "{word}"')
        arguments[name] = value
    return arguments


def _require(name: str) -> None:
    """Raise `CommandError` with the commands of pip if a package of ROS is missing, or another one has its name."""
    spec = find_spec(name)
    if spec is not None and spec.origin is not None:
        if name != "launch" or hasattr(importlib.import_module(name), "LaunchService"):
            return
        text = f"{spec.origin} is another package with the name launch"
    else:
        text = f"the package {name} of ROS is neither installed nor below --path"
    needed = [one for one in _ORIGINS if find_spec(one) is None or one == name]
    urls = " ".join(f"'{_ORIGINS[one]}'" for one in needed)
    raise CommandError(
        f"{text}; run: {install_command('launch')} && pip install --no-deps {urls}; "
        "or clone https://github.com/ros2/launch and https://github.com/ros2/launch_ros, and pass --launch-from FOLDER"
    )


def launch_files(share: str) -> dict[str, str]:
    """Return the paths of files below a share folder by their relative paths; of links to one file, the shortest."""
    found: dict[str, str] = {}
    folders: set[str] = set()
    for folder, inside, files in os.walk(share, followlinks=True):
        real = os.path.realpath(folder)
        inside[:] = [] if real in folders else sorted(one for one in inside if not one.startswith("."))
        if real not in folders:
            folders.add(real)
            found |= {os.path.relpath(path := os.path.join(folder, name), share): path for name in files}
    by_file: dict[str, str] = {}
    for relative in sorted(found, key=lambda one: (one.count(os.sep), one)):
        by_file.setdefault(os.path.realpath(found[relative]), relative)
    return {relative: found[relative] for relative in by_file.values()}


def _file_of_package(package: str, name: str) -> str:
    packages = importlib.import_module("ament_index_python.packages")
    try:
        share = packages.get_package_share_directory(package, print_warning=False)
    except packages.PackageNotFoundError as error:
        hint = did_you_mean(package, packages.get_packages_with_prefixes())
        text = f'no file and no package "{package}"{hint}'
        raise CommandError(f"{text}; searched the workspace, --path and AMENT_PREFIX_PATH") from error
    except ValueError as error:
        raise CommandError(f'"{package}" is neither a file nor the name of a package') from error
    if name and os.path.isfile(exact := os.path.join(share, name)):
        return exact
    files = launch_files(share)
    matching = [relative for relative in files if os.path.basename(relative) == name]
    if len(matching) == 1:
        return files[matching[0]]
    if matching:
        paths = ", ".join(matching)
        raise CommandError(f"{package} has several files {name}: {paths}; pass one of these paths instead of the name")
    known = sorted(relative for relative in files if relative.endswith(_ENDINGS))
    text = f'{package} ({display_path(share)}) has no file "{name}"' if name else f"expected a launch file of {package}"
    hint = did_you_mean(name, map(os.path.basename, known))
    raise CommandError(f"{text}{hint}; its launch files: {', '.join(known) or 'none'}")
