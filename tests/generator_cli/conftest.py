"""Fixtures of the command line and of nodes for it."""

from __future__ import annotations

from support.generator_shell import shell
from support.node_fixtures import dds, memory, network, only_loopback, pytest_generate_tests, pytest_pyfunc_call

__all__ = ["dds", "memory", "network", "only_loopback", "pytest_generate_tests", "pytest_pyfunc_call", "shell"]
