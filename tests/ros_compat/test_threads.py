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


CALL_IN_A_CALLBACK = """
import rclpy
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("n")
node.create_service(Trigger, "answer", lambda request, response: response)
client = node.create_client(Trigger, "answer")
node.create_timer(0.1, lambda: print(client.call(Trigger.Request(), timeout_sec=5.5)))
rclpy.spin_once(node)
"""


def test_a_call_that_its_executor_cannot_answer_is_logged(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(CALL_IN_A_CALLBACK)
    done = run("program.py", cwd=tmp_path, ROS_DOMAIN_ID=str(domain_id()), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    assert (done.returncode, done.stdout) == (0, "None\n"), done.stderr
    assert done.stderr.count("call of answer in a callback: its executor cannot receive the response") == 1
