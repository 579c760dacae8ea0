"""Classes of rclpy's message API beside our own, for tests that have both."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from rosidl_py_gen import install_import_hook
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.type_loading import class_lookup
from rosidl_py_gen.type_loading.import_hook import ImportHookWarning

INTERFACES = Path(__file__).resolve().parents[1] / "interfaces"


@contextmanager
def hooked(*, warns: bool = False, **settings: Any) -> Iterator[None]:
    """Install the import hook, forget imported and compiled classes, and hide warnings; afterwards all is as before."""
    before = {name: module for name, module in sys.modules.items() if _is_of_messages(name)}
    loaded, named = {name: list(found) for name, found in class_lookup._loaded.items()}, dict(class_lookup._by_name)
    for name in before:
        del sys.modules[name]
    class_lookup._loaded.clear()
    class_lookup._by_name.clear()
    try:
        with warnings.catch_warnings():
            if not warns:
                warnings.simplefilter("ignore", ImportHookWarning)
            with install_import_hook(**settings):
                yield
    finally:
        for name in [name for name in sys.modules if _is_of_messages(name)]:
            del sys.modules[name]
        sys.modules.update(before)
        # Classes that were compiled because generated ones could not be imported are not those of later tests.
        class_lookup._loaded.clear()
        class_lookup._loaded.update(loaded)
        class_lookup._by_name.clear()
        class_lookup._by_name.update(named)


def _is_of_messages(name: str) -> bool:
    top, _, rest = name.partition(".")
    return f"{top}.msg" in sys.modules or top.endswith(("_msgs", "_interfaces", "_srvs")) or rest in RosName.KINDS


def rclpy_class(name: str) -> Any:
    """Return the class for a name such as ``std_msgs/msg/String``, with rclpy's API; needs the hook."""
    package, kind, word = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), py_name(word))


@contextmanager
def rclpy_flavour() -> Iterator[None]:
    with hooked(message_api="rclpy", path=str(INTERFACES), override_installed=True):
        yield


@pytest.fixture(scope="module")
def message_api() -> Iterator[None]:
    """Make the import hook find messages of rclpy's API."""
    with rclpy_flavour():
        yield
