"""Programs for rclpy with ROS_DISTRO=lyrical."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from support.node_fixtures import domain_id
from support.program_processes import run

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.real_time("programs are processes")
PROGRAM = """
import time, rclpy
from lifecycle_msgs.msg import TransitionEvent
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

class Managed(LifecycleNode):
    def on_configure(self, state):
        return TransitionCallbackReturn.SUCCESS

class Broken(LifecycleNode):
    def on_configure(self, state):
        raise ValueError("broken")

def spin_until(condition):
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)

rclpy.init()
node, seen = Managed("managed"), []
node.create_subscription(TransitionEvent, "~/transition_event", seen.append, 10)
spin_until(lambda: node._rosidl_transition_events.get_subscription_count() > 0)
node.trigger_configure()
Broken("broken").trigger_configure()
spin_until(lambda: len(seen) == 2)
for event in seen:
    print(event.stamp.sec > 0, event.transition.id, event.transition.label, event.goal_state.label)
"""


def test_lifecycle_events_have_the_definition_of_the_distribution(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM, encoding="utf-8")
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    done = run(program, ROS_DISTRO="lyrical", **settings)
    assert done.stdout.splitlines() == ["True 1 configure configuring", "True 10 transition_success inactive"], (
        done.stderr
    )
    assert "[broken]: on_configure raised ValueError: broken\n" in done.stderr  # rclpy does not log it
