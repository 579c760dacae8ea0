"""Several threads of one program under our rclpy lose nothing and leave nothing behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.node_fixtures import domain_id

PROGRAM = Path(__file__).resolve().parent / "semantics" / "threads.py"


@pytest.mark.parametrize("case", ["counted_subscriptions", "services_of_services", "groups_of_what_was_destroyed"])
def test_threads_lose_nothing_and_leave_nothing(case: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", str(PROGRAM), case],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
