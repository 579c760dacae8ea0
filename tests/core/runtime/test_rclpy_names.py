"""Names of rclpy that exist here, and `repr` of entities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import String
from std_srvs.srv import SetBool
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import runtime
from rosidl_py_gen.runtime import Context, MemoryTransport, Node, qos

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def node() -> Iterator[Any]:
    with Context(0, transport=MemoryTransport(), args=["test"]) as context:
        yield Node("n", "ns", context=context)


@pytest.mark.every_transport
async def test_common_rclpy_method_names_work(world: World) -> None:
    node: Any = world.node("minimal")
    received: list[Any] = []
    publisher = node.create_publisher(String, "topic", 10)
    subscription = node.create_subscription(String, "topic", received.append, 10)
    node.declare_parameter("speed", 1.5)
    assert node.get_parameter("speed") == 1.5
    assert (node.get_name(), node.get_namespace(), node.get_fully_qualified_name()) == ("minimal", "/", "/minimal")
    assert node.get_logger() is node.logger and node.get_clock().now().nanoseconds > 0
    await until(lambda: publisher.get_subscription_count() == 1 and subscription.get_publisher_count() == 1)
    publisher.publish(String(data="x"))
    await until(lambda: [message.data for message in received] == ["x"])
    assert publisher.topic_name == subscription.topic_name == "/topic"
    timer = node.create_timer(0.5, lambda: None)
    assert node.destroy_timer(timer) is True and node.destroy_publisher(publisher) is True
    subscription.destroy()
    client = node.create_client(SetBool, "s")
    assert client.srv_name == "/s" and client.service_is_ready() is False
    node.destroy_node()
    assert node.is_closed


async def test_action_handler_written_for_rclpy_works_unchanged(world: World) -> None:
    def execute(goal_handle: Any) -> Any:
        sequence = [0, 1]
        for _ in range(goal_handle.request.order - 1):
            if goal_handle.is_cancel_requested:
                goal_handle.canceled()
                return Fibonacci.Result(sequence=sequence)
            sequence.append(sequence[-2] + sequence[-1])
            goal_handle.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        goal_handle.succeed()
        return Fibonacci.Result(sequence=sequence)

    world.node("server").create_action_server(Fibonacci, "fib", execute)
    client = world.node("client").create_action_client(Fibonacci, "fib")
    goal = await client.send_goal(Fibonacci.Goal(order=4), timeout_s=10)
    status, answer = await goal.result(timeout_s=10)
    assert (status.name, list(answer.sequence)) == ("SUCCEEDED", [0, 1, 1, 2, 3])


def test_unknown_names_raise_the_errors_of_python(node: Any) -> None:
    with pytest.raises(AttributeError, match=r"'Node' object has no attribute 'spin_once'$"):
        _ = node.spin_once
    with pytest.raises(AttributeError, match=r"module 'rosidl_py_gen\.runtime' has no attribute 'spin_once'$"):
        _ = runtime.spin_once  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="unexpected keyword argument 'nonsense'"):
        node.logger.info("x", nonsense=1)


async def test_repr_of_entities_contains_name_type_qos_and_peers(world: World) -> None:
    node = world.node("shown")
    publisher = node.create_publisher(String, "t", qos.SENSOR_DATA)
    subscription = node.create_subscription(String, "t", print, qos.SENSOR_DATA)
    server = node.create_service(SetBool, "s", lambda request: SetBool.Response())
    client = node.create_client(SetBool, "s")
    actions = node.create_action_server(Fibonacci, "a", lambda goal: Fibonacci.Result())
    action_client = node.create_action_client(Fibonacci, "a")
    timer = node.create_wall_timer(60.0, lambda: None)
    assert await client.wait_for_service(10) and await action_client.wait_for_server(10)
    profile = "best effort, volatile, keep last 5"
    service = "reliable, volatile, keep all"
    await until(lambda: "1 sub" in repr(publisher) and "1 pub" in repr(subscription) and "1 client" in repr(actions))
    await until(lambda: "1 client" in repr(server))
    assert repr(publisher) == f"Publisher(/t, std_msgs/msg/String, {profile}, 1 subscription)"
    assert repr(subscription) == f"Subscription(/t, std_msgs/msg/String, {profile}, 1 publisher)"
    assert repr(server) == f"ServiceServer(/s, std_srvs/srv/SetBool, {service}, 1 client)"
    assert repr(client) == f"Client(/s, std_srvs/srv/SetBool, {service}, 1 server)"
    assert repr(actions) == "ActionServer(/a, example_interfaces/action/Fibonacci, 0 active goals, 1 client)"
    assert repr(action_client) == "ActionClient(/a, example_interfaces/action/Fibonacci, 1 server)"
    assert repr(timer) == "Timer(60 s, STEADY_TIME, 0 calls)"
    timer.cancel()
    assert repr(timer) == "Timer(60 s, STEADY_TIME, canceled, 0 calls)"
    assert repr(node).startswith("Node(/shown, domain ") and repr(node).endswith(" other nodes)")
    node.close()
    for closed in (publisher, subscription, server, client, actions, action_client, timer, node):
        assert repr(closed).endswith(", closed)")
