"""Reading launch files."""

from __future__ import annotations

from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader

from launch.core import LaunchDescription


class InvalidLaunchFileError(Exception):
    pass


class PythonLaunchDescriptionSource:
    def __init__(self, location: str) -> None:
        self.location = location

    def get_launch_description(self, context: object) -> LaunchDescription:
        return _load(self.location)


def get_launch_description_from_any_launch_file(path: str) -> LaunchDescription:
    try:
        return _load(path)
    except Exception as error:
        failure = InvalidLaunchFileError(f"Caught exception when trying to load file of format [py]:\n - {error}")
        failure.__cause__ = error
        raise failure  # noqa: B904


def _load(path: str) -> LaunchDescription:
    loader = SourceFileLoader("python_launch_file", path)
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module.generate_launch_description()
