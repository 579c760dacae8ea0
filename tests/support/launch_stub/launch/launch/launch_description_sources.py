"""Reading launch files."""

from __future__ import annotations

import re
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

from launch.core import LaunchDescription, LaunchDescriptionSource


class InvalidLaunchFileError(Exception):
    pass


class PythonLaunchDescriptionSource(LaunchDescriptionSource):
    def __init__(self, location: str) -> None:
        self.location = location

    def get_launch_description(self, context: object) -> LaunchDescription:
        return _load(self.location)


class AnyLaunchDescriptionSource(PythonLaunchDescriptionSource):
    def get_launch_description(self, context: object) -> LaunchDescription:
        return get_launch_description_from_any_launch_file(self.location)


def get_launch_description_from_any_launch_file(path: str) -> LaunchDescription:
    try:
        if path.endswith(".py"):
            return _load(path)
        return get_launch_description_from_frontend_launch_file(path)
    except Exception as error:
        failure = InvalidLaunchFileError(f"Caught exception when trying to load file of format [py]:\n - {error}")
        failure.__cause__ = error
        raise failure  # noqa: B904


def get_launch_description_from_frontend_launch_file(frontend_launch_file_path: str) -> LaunchDescription:
    from launch_ros.actions import Node

    text = Path(frontend_launch_file_path).read_text()
    names = re.findall(r"\bpkg\W+(\w+)\W+exec\W+(\w+)", text)
    return LaunchDescription([Node(package=package, executable=executable) for package, executable in names])


def _load(path: str) -> LaunchDescription:
    loader = SourceFileLoader("python_launch_file", path)
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module.generate_launch_description()
