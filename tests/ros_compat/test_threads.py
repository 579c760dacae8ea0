"""Several threads of one program under our rclpy lose nothing and leave nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.node_fixtures import domain_id
from support.program_processes import run

PROGRAM = Path(__file__).resolve().parent / "semantics" / "threads.py"


@pytest.mark.parametrize("case", ["counted_subscriptions", "services_of_services", "groups_of_what_was_destroyed"])
def test_threads_lose_nothing_and_leave_nothing(case: str) -> None:
    done = run(PROGRAM, case, ROS_DOMAIN_ID=str(domain_id()), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
