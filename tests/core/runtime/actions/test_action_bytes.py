"""Bytes that actions and parameters send (docs/internals/protocol.md 4, 5.1, 8, 9)."""

from __future__ import annotations

from typing import Any

import pytest
from fibonacci_action import Fibonacci
from support import raw_endpoints
from support.inner_state import graph_of, scope_of
from support.raw_endpoints import reply_name, request_name
from support.waiting import until
from support.worlds import World

from rosidl_py_gen.runtime.entities.message_types import service_type
from rosidl_py_gen.runtime.node.node import ServiceMethods
from rosidl_py_gen.runtime.time_values import ClockType, Time
from rosidl_py_gen.runtime.transport.api import TopicKey
from rosidl_py_gen.runtime.transport.qos import QoSProfile

pytestmark = pytest.mark.on_zenoh

GOAL_ID = bytes.fromhex("00112233445566778899aabbccddeeff")
HEADER = "00 01 00 00"  # XCDR1, little endian
STAMP = "0a 00 00 00  05 00 00 00"  # sec 10, nanosec 5
ACTION = "example_interfaces::action::dds_::Fibonacci_"
DEEP = QoSProfile().keep_all()


class Tap:
    def __init__(self, node: ServiceMethods, topic: str, dds_type: str) -> None:
        self.reader = raw_endpoints.reader(node, topic, dds_type)

    def take(self, *, service: bool = True) -> list[str]:
        items = [bytes(item[0]) for item in self.reader.queue.items]
        self.reader.queue.items.clear()
        return [(item[:4] + item[20 if service else 4 :]).hex() for item in items]


def wire(*parts: str) -> str:
    text = "".join((HEADER, *parts)).replace(" ", "")
    return text + "0" * (-len(text) % 8)


def tap_service(node: ServiceMethods, name: str, dds_type: str) -> tuple[Tap, Tap]:
    request = Tap(node, request_name(name), f"{dds_type}Request_")
    return request, Tap(node, reply_name(name), f"{dds_type}Response_")


async def until_canceled(goal: Any) -> Any:
    await goal.wait_for_cancel()
    goal.publish_feedback(Fibonacci.Feedback(sequence=[7]))
    return goal.canceled(Fibonacci.Result(sequence=[1, 2]))


async def test_bytes_of_a_cancelled_goal_match_ros(dds: World) -> None:
    watcher = dds.node("watcher")
    send = tap_service(watcher, "/fib/_action/send_goal", f"{ACTION}SendGoal_")
    result = tap_service(watcher, "/fib/_action/get_result", f"{ACTION}GetResult_")
    cancel = tap_service(watcher, "/fib/_action/cancel_goal", "action_msgs::srv::dds_::CancelGoal_")
    feedback = Tap(watcher, "rt/fib/_action/feedback", f"{ACTION}FeedbackMessage_")
    status = Tap(watcher, "rt/fib/_action/status", "action_msgs::msg::dds_::GoalStatusArray_")
    server = dds.node("server")
    server.clock.enable_ros_time_override()
    server.clock.set_ros_time_override(Time(seconds=10, nanoseconds=5, clock_type=ClockType.ROS_TIME))
    server.create_action_server(Fibonacci, "fib", until_canceled)
    client = dds.node("client").create_action_client(Fibonacci, "fib")
    goal = await client.send_goal(Fibonacci.Goal(order=3), timeout_s=20, goal_id=GOAL_ID)
    await until(lambda: len(status.reader.queue.items) == 1)
    await goal.cancel(timeout_s=20)
    await goal.result(timeout_s=20)
    one = GOAL_ID.hex()
    assert send[0].take() == [wire(one, "03 00 00 00")]  # goal_id, order
    assert send[1].take() == [wire("01 00 00 00", STAMP)]  # accepted, 3 pad bytes, stamp
    assert result[0].take() == [wire(one)]
    # status CANCELED, 3 pad bytes, two numbers
    assert result[1].take() == [wire("05 00 00 00", "02 00 00 00", "01 00 00 00", "02 00 00 00")]
    assert cancel[0].take() == [wire(one, "00 00 00 00  00 00 00 00")]  # goal_id, zero stamp
    # return_code NONE, 3 pad bytes, one GoalInfo with the acceptance stamp
    assert cancel[1].take() == [wire("00 00 00 00", "01 00 00 00", one, STAMP)]
    assert feedback.take(service=False) == [wire(one, "01 00 00 00", "07 00 00 00")]
    row = ("01 00 00 00", one, STAMP)  # one status: GoalInfo, then the number
    assert status.take(service=False) == [wire(*row, number) for number in ("02", "03", "05")]


async def test_cancel_all_and_cancel_before_send_zero_goal_id(dds: World) -> None:
    cancel = tap_service(dds.node("watcher"), "/fib/_action/cancel_goal", "action_msgs::srv::dds_::CancelGoal_")
    dds.node("server").create_action_server(Fibonacci, "fib", until_canceled)
    client = dds.node("client").create_action_client(Fibonacci, "fib")
    await client.cancel_all(timeout_s=20)
    await client.cancel_before(Time(seconds=10, nanoseconds=5), timeout_s=20)
    assert cancel[0].take() == [wire("00" * 24), wire("00" * 16, STAMP)]
    assert cancel[1].take() == [wire("00 00 00 00", "00 00 00 00")] * 2


async def test_result_request_for_unknown_goal_returns_unknown_and_default_result(dds: World) -> None:
    result = tap_service(dds.node("watcher"), "/fib/_action/get_result", f"{ACTION}GetResult_")
    dds.node("server").create_action_server(Fibonacci, "fib", until_canceled)
    result_client = dds.node("client").create_client(Fibonacci.GetResult, "fib/_action/get_result")
    await result_client.call(Fibonacci.GetResult.Request(), timeout_s=20)
    assert result[1].take() == [wire("00 00 00 00", "00 00 00 00")]


@pytest.mark.every_transport
def test_action_topic_names_types_and_qos_match_ros(world: World) -> None:
    node = world.node("server")
    node.create_action_server(Fibonacci, "fib", until_canceled)
    scope_of(node).discovery.refresh()
    endpoints = [e for e in graph_of(node).endpoints.values() if "/_action/" in e.wire_name]
    profiles = {
        (e.topic_key, e.type, e.is_writer): (e.qos.reliability.name, e.qos.durability.name, e.qos.depth)
        for e in endpoints
    }
    names = {topic for topic, _, _ in profiles}
    services = [f"/fib/_action/{one}" for one in ("send_goal", "cancel_goal", "get_result")]
    feedback, status = TopicKey("topic", "/fib/_action/feedback"), TopicKey("topic", "/fib/_action/status")
    assert names == {feedback, status, *(TopicKey(half, one) for one in services for half in ("request", "reply"))}
    send = service_type(Fibonacci.SendGoal).request.ros_name
    assert profiles[TopicKey("request", services[0]), send, False][:2] == ("RELIABLE", "VOLATILE")
    assert profiles[status, "action_msgs/msg/GoalStatusArray", True] == ("RELIABLE", "TRANSIENT_LOCAL", 1)
    feedback_type = "example_interfaces/action/Fibonacci_FeedbackMessage"
    assert profiles[feedback, feedback_type, True] == ("RELIABLE", "VOLATILE", 10)
