"""The reference compilers, started once for all tests of this folder, and a search path without installed packages."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rosidl_py_gen.base.resources import InstalledInterfaces
from support.rosidl_oracle import Rosidl


@pytest.fixture(scope="session")
def rosidl() -> Iterator[Rosidl]:
    processes = Rosidl()
    yield processes
    processes.close()


@pytest.fixture(autouse=True)
def no_installed_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide message packages of the environment, such as those that the README's first command installs."""
    monkeypatch.setattr(InstalledInterfaces, "ENTRY_POINTS", "a group without packages")
    monkeypatch.setattr(InstalledInterfaces, "ros_index", lambda: "a folder that does not exist")
