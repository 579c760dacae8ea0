"""Settings all tests share: hypothesis without deadlines, how long the fuzzers run, and Ctrl-C as in a terminal."""

from __future__ import annotations

import os
import signal

import pytest
from hypothesis import HealthCheck, settings
from scale import examples


@pytest.hookimpl(tryfirst=True)  # before hypothesis looks at --hypothesis-profile
def pytest_configure(config: pytest.Config) -> None:
    """Let SIGINT interrupt. A shell starts background jobs with SIGINT ignored, and every child inherits that."""
    settings.register_profile(
        "project",
        max_examples=examples(100),
        deadline=None,
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
        # CI tries the same examples every time, so that it fails for the change at hand, and once more those of a seed
        # that it prints; everybody else tries new ones.
        derandomize="ROSIDL_TEST_REQUIRE_PEERS" in os.environ and not config.getoption("--hypothesis-seed"),
    )
    settings.load_profile("project")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fuzz-rounds", type=int, default=examples(100_000), help="inputs the codec fuzzers try")
