"""Fixtures of the runtime tests, which use only the loopback interface."""

from __future__ import annotations

import sys
from pathlib import Path

from support.node_fixtures import dds, memory, network, only_loopback, pytest_generate_tests, pytest_pyfunc_call, world

sys.path.insert(0, str(Path(__file__).parent / "actions"))  # for the scripts and worlds of its tests

__all__ = ["dds", "memory", "network", "only_loopback", "pytest_generate_tests", "pytest_pyfunc_call", "world"]
