"""Fixtures of tests with nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from support.node_fixtures import memory, only_loopback, pytest_pyfunc_call
from support.rclpy_messages import rclpy_flavour

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["memory", "only_loopback", "pytest_pyfunc_call"]


@pytest.fixture(scope="module")
def message_api() -> Iterator[None]:
    """Make the import hook find messages of rclpy's API."""
    with rclpy_flavour():
        yield
