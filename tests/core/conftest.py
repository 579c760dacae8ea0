"""Parametrize tests that have a `world` or a `network` with transports."""

from support.worlds import pytest_generate_tests

__all__ = ["pytest_generate_tests"]
