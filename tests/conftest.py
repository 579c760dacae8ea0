"""Settings all tests share: hypothesis without deadlines, how long the fuzzers run, and Ctrl-C as in a terminal."""

from __future__ import annotations

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "project",
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
    # CI tries the same examples every time, so that it fails for the change at hand; everybody else tries new ones.
    derandomize="ROSIDL_TEST_REQUIRE_PEERS" in os.environ,
)
settings.load_profile("project")


def pytest_configure() -> None:
    """Let SIGINT interrupt. A shell starts background jobs with SIGINT ignored, and every child inherits that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fuzz-rounds", type=int, default=100_000, help="inputs the codec fuzzers try (default 100000)")
