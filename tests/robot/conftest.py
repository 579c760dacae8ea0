"""Nodes that stay on this machine."""

from support.node_fixtures import dds, memory, only_loopback, pytest_generate_tests, pytest_pyfunc_call, world

__all__ = ["dds", "memory", "only_loopback", "pytest_generate_tests", "pytest_pyfunc_call", "world"]
