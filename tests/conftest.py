"""Settings all tests share: hypothesis without deadlines, and how long the fuzzers run."""

from __future__ import annotations

import os

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


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fuzz-rounds", type=int, default=100_000, help="inputs the codec fuzzers try (default 100000)")
