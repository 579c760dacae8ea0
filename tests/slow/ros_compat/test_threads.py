"""Multithreaded programs under this rclpy lose no messages and leave no entities behind."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.folders import TESTS
from support.local_network import domain_id
from support.program_processes import run

PROGRAM = TESTS / "peers/ros_compat/semantics/threads.py"


@pytest.mark.parametrize(
    "case",
    [
        *("counted_subscriptions", "services_of_services", "groups_of_what_was_destroyed"),
        *("peers_found_during_creation", "own_endpoints_while_another_thread_spins"),
    ],
)
def test_multithreaded_program_completes_without_errors(case: str) -> None:
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


def test_blocking_call_in_callback_without_free_executor_is_logged(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(CALL_IN_A_CALLBACK)
    done = run("program.py", cwd=tmp_path, ROS_DOMAIN_ID=str(domain_id()), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    assert (done.returncode, done.stdout) == (0, "None\n"), done.stderr
    assert done.stderr.count("call of answer in a callback: its executor cannot receive the response") == 1


OTHER_DEFINITION = """
import rclpy
from rosidl_py_gen import compile_definition
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

rclpy.init()
node, received = rclpy.create_node("n"), []
node.create_subscription(String, "t", received.append, 1)
Other = compile_definition("std_msgs/msg/String", "string data\\nint32 number")
publisher = node.handle.entity.create_publisher(Other, "t")
client, service = node.create_client(Trigger, "s"), node.create_service(SetBool, "s", print)
while not received:
    publisher.publish(Other(data="x"))
    rclpy.spin_once(node, timeout_sec=0.1)
rclpy.spin_once(node, timeout_sec=0.5)
"""


def test_incompatible_type_and_converted_definition_are_logged_once(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(OTHER_DEFINITION)
    done = run("program.py", cwd=tmp_path, ROS_DOMAIN_ID=str(domain_id()), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    for text in (
        "[n]: Incompatible type on topic 't': their definitions of",
        "[rclpy]: no messages on /s from node /n to",
    ):
        assert done.stderr.count(text) == 1, done.stderr
    assert done.stderr.count("definitions of") == 1, done.stderr


FEEDBACK_AFTER_THE_RESULT = """
import asyncio
import rclpy
from rclpy.action import ActionClient, ActionServer
from example_interfaces.action import Fibonacci

def execute(goal):
    goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
    goal.succeed()
    return Fibonacci.Result()

rclpy.init()
server, node = rclpy.create_node("server"), rclpy.create_node("client")
goals = []
ActionServer(server, Fibonacci, "count", execute, handle_accepted_callback=goals.append)
client = ActionClient(node, Fibonacci, "count")
spin = lambda one: rclpy.spin_once(one, timeout_sec=0.05)
while not client.server_is_ready():
    spin(node)
received = []
accepted = client.send_goal_async(Fibonacci.Goal(), feedback_callback=received.append)
while not accepted.done():
    spin(server)
    spin(node)
result = accepted.result().get_result_async()
goals[0].execute()
taken = {}
while not taken.keys() >= {"feedback", "result"}:  # one thread takes the feedback, another one the result
    spin(server)
    taken |= client.take_data()
later = {kind: taken.pop(kind) for kind in ("feedback", "callback")}
asyncio.run(client.execute(taken))
asyncio.run(client.execute(later))
print(result.done(), len(received), len(client._feedback_callbacks))
"""


def test_feedback_handled_after_result_is_delivered(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(FEEDBACK_AFTER_THE_RESULT)
    done = run("program.py", cwd=tmp_path, ROS_DOMAIN_ID=str(domain_id()), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    assert (done.returncode, done.stdout) == (0, "True 1 0\n"), done.stderr
