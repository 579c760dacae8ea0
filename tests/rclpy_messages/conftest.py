"""Fixtures of tests with nodes."""

from __future__ import annotations

from support.node_fixtures import memory, only_loopback, pytest_pyfunc_call

__all__ = ["memory", "only_loopback", "pytest_pyfunc_call"]
