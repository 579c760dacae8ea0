"""Real rclpy in an environment of its own, and DDS on loopback."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from environments import environment
from worlds import dds, only_loopback, pytest_pyfunc_call

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(1, str(Path(__file__).parents[1] / "interop_rclpy"))

from rclpy_peer import REQUIREMENTS

__all__ = ["dds", "only_loopback", "pytest_pyfunc_call"]


@pytest.fixture(scope="session")
def real_python() -> Path:
    """A Python that has rclpy of Jazzy."""
    return environment("rclpy-jazzy", REQUIREMENTS["jazzy"])


@pytest.fixture(scope="session")
def code_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where our rclpy keeps compiled message classes: the first program makes them."""
    return tmp_path_factory.mktemp("cache")
