"""The pytest fixtures that come with the package, as users get them: through the entry point."""

from __future__ import annotations

from typing import TYPE_CHECKING

from std_msgs.msg import String

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import MemoryTransport, Node


def test_nodes_of_the_fixture_have_their_own_command_line(ros_node: Callable[..., Node]) -> None:
    node = ros_node("relay", args=("--ros-args", "-r", "__ns:=/robot"))
    assert node.fully_qualified_name == "/robot/relay"


async def test_nodes_of_the_fixture_meet_in_memory(ros_node: Callable[..., Node], ros_world: MemoryTransport) -> None:
    talker, listener = ros_node("talker"), ros_node("listener")
    subscription = listener.create_subscription(String, "chatter")
    talker.create_publisher(String, "chatter").publish(String(data="hello"))
    assert (await subscription.receive(timeout_s=5)).data == "hello"
    assert sorted(listener.get_node_names()) == ["/listener", "/talker"]
    assert ros_world is not None
