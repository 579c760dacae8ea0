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


_REAL_TIME = ("runtime", "runtime_actions", "runtime_parameters", "interop")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Processes and DDS on a shared machine: a race lost to the load is run again, a bug fails every time."""
    for item in items:
        if item.path.parent.name in _REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=2))


def pytest_configure() -> None:
    """Let SIGINT interrupt. A shell starts background jobs with SIGINT ignored, and every child inherits that."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fuzz-rounds", type=int, default=100_000, help="inputs the codec fuzzers try (default 100000)")
