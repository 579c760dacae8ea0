"""Topics, services, actions, introspection, transforms and bags with classes of rclpy's message API, and with both."""

from __future__ import annotations

import array
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.rclpy_messages import rclpy_class
from support.waiting import until

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.runtime import GoalStatus, IntrospectionState

if TYPE_CHECKING:
    from support.worlds import World

MESSAGE_APIS = pytest.mark.parametrize("here", ["native", "rclpy"])
THERE = pytest.mark.parametrize("there", ["native", "rclpy"])
pytestmark = [
    pytest.mark.usefixtures("message_api"),
    pytest.mark.filterwarnings("ignore::rosidl_py_gen.ImportHookWarning"),  # of classes other tests generate
]


def cls_of(message_api: str, name: str) -> Any:
    if message_api == "rclpy":
        return rclpy_class(name)
    return {"msg": get_message, "srv": get_service, "action": get_action}[name.split("/")[1]](name)


@MESSAGE_APIS
@THERE
async def test_topics(memory: World, here: str, there: str) -> None:
    sent, wanted = cls_of(here, "sensor_msgs/msg/LaserScan"), cls_of(there, "sensor_msgs/msg/LaserScan")
    node = memory.node("n")
    subscription = memory.node("m").create_subscription(wanted, "scan")
    publisher = node.create_publisher(sent, "scan")
    await until(lambda: publisher.subscription_count)
    message = sent(ranges=[1.5, 2.5], header=cls_of(there, "std_msgs/msg/Header")(frame_id="laser"))
    publisher.publish(message)
    publisher.publish(cls_of(there, "sensor_msgs/msg/LaserScan")(ranges=[3]))  # with the other API
    found = await subscription.receive(timeout_s=5)
    assert type(found) is wanted and type(found.header) is cls_of(there, "std_msgs/msg/Header")
    assert (list(found.ranges), found.header.frame_id) == ([1.5, 2.5], "laser")
    assert type(found.ranges) is (array.array if there == "rclpy" else np.ndarray)
    assert list((await subscription.receive(timeout_s=5)).ranges) == [3]
    with pytest.raises(TypeError, match="expected a LaserScan"):
        publisher.publish(cls_of(here, "std_msgs/msg/String")())


@MESSAGE_APIS
@THERE
async def test_services(memory: World, here: str, there: str) -> None:
    served, called = cls_of(here, "std_srvs/srv/SetBool"), cls_of(there, "std_srvs/srv/SetBool")
    seen: list[Any] = []

    def handle(request: Any) -> Any:
        seen.append(request)
        return called.Response(success=request.data, message="yes")  # with the client's API

    server = memory.node("n").create_service(served, "set", handle)
    node = memory.node("m")
    client = node.create_client(called, "set")
    events = memory.node("l").create_subscription(called.Event, "/set/_service_event", qos=10)
    server.configure_introspection(node.clock, 10, IntrospectionState.CONTENTS)
    answer = await client.call(served.Request(data=True), timeout_s=5)
    assert (type(answer), answer.success, answer.message) == (called.Response, True, "yes")
    assert [type(one) for one in seen] == [served.Request]
    event = await events.receive(timeout_s=5)
    assert event.request[0].data is True and len(event.info.client_gid) == 16


@MESSAGE_APIS
@THERE
async def test_actions(memory: World, here: str, there: str) -> None:
    served = cls_of(here, "example_interfaces/action/Fibonacci")
    called = cls_of(there, "example_interfaces/action/Fibonacci")

    async def execute(goal: Any) -> Any:
        assert type(goal.request) is served.Goal
        goal.publish_feedback(called.Feedback(sequence=[1]))
        return called.Result(sequence=list(range(goal.request.order)))

    memory.node("n").create_action_server(served, "count", execute)
    client = memory.node("m").create_action_client(called, "count")
    goal = await client.send_goal(served.Goal(order=3), timeout_s=5)
    assert [list(one.sequence) async for one in goal.feedback()] == [[1]]
    status, result = await goal.result(timeout_s=5)
    assert status is GoalStatus.SUCCEEDED and type(result) is called.Result and list(result.sequence) == [0, 1, 2]
    with pytest.raises(TypeError, match="expected a Fibonacci_Goal"):
        await client.send_goal(called.Result(), timeout_s=5)


@MESSAGE_APIS
def test_bags(tmp_path: Path, here: str) -> None:
    scan, status = cls_of(here, "sensor_msgs/msg/LaserScan"), cls_of(here, "diagnostic_msgs/msg/DiagnosticStatus")
    other = cls_of("native" if here == "rclpy" else "rclpy", "sensor_msgs/msg/LaserScan")
    with BagWriter(tmp_path / "bag.mcap") as writer:
        writer.write("/scan", scan(ranges=[1.5]), 1)
        writer.write("/scan", other(ranges=[2.5]), 2)
        writer.write("/status", status(level=b"\2" if here == "rclpy" else 2), 3)
    with BagReader(tmp_path / "bag.mcap") as reader:
        found = [one.message for one in reader]
    assert [list(one.ranges) for one in found[:2]] == [[1.5], [2.5]]
    assert found[2].level == 2 and type(found[2]).ERROR == 2  # of the definition that is in the bag
