"""Classes of the topics that commands use."""

from __future__ import annotations

import click
import pytest

from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.command_node import CommandNode
from rosidl_py_gen.ros_cli.completion import complete_names
from rosidl_py_gen.ros_cli.type_resolution import action_class, message_class, opaque_class, service_class
from rosidl_py_gen.runtime import Node


async def test_a_topic_of_two_types_needs_to_be_told_which() -> None:
    async with CommandNode({}) as command_node:
        node = command_node.node
        node.create_publisher("std_msgs/msg/String", "both")
        node.create_publisher("std_msgs/msg/Bool", "both")
        with pytest.raises(CommandError, match="more than one type: std_msgs/msg/Bool, std_msgs/msg/String"):
            await message_class(command_node, "/both")
        assert (await message_class(command_node, "/both", "std_msgs/Bool")).__name__ == "Bool"


async def test_an_opaque_class_carries_the_hash_that_is_announced() -> None:
    async with CommandNode({}) as command_node:
        publisher = command_node.node.create_publisher("std_msgs/msg/String", "words")
        (info,) = command_node.node.get_publishers_info_by_topic("/words")
        cls = opaque_class(command_node, "/words")
        assert (cls._TYPE.name, cls._TYPE.hash) == (publisher.message_type, info.topic_type_hash)


async def test_actions_and_services_are_found_by_the_types_of_their_servers() -> None:
    async with CommandNode({}) as command_node:
        node: Node = command_node.node
        node.create_service("example_interfaces/srv/AddTwoInts", "add")
        node.create_action_server("example_interfaces/action/Fibonacci", "count", lambda goal: {})
        assert (await service_class(command_node, "/add"))._TYPE.name == "example_interfaces/srv/AddTwoInts"
        assert (await action_class(command_node, "/count"))._TYPE.name == "example_interfaces/action/Fibonacci"


def test_types_are_completed_without_a_network() -> None:
    found = [item.value for item in complete_names("types", click.Context(click.Command("x")), "std_msgs/msg/Str")]
    assert found == ["std_msgs/msg/String"]


async def test_a_type_that_nobody_has_is_refused() -> None:
    async with CommandNode({}) as command_node:
        command_node.node.create_service("example_interfaces/srv/AddTwoInts", "add")
        with pytest.raises(CommandError, match="has type example_interfaces/srv/AddTwoInts, not std_srvs/srv/Empty"):
            await service_class(command_node, "/add", "std_srvs/Empty")
        assert (await service_class(command_node, "/new", "std_srvs/Empty"))._TYPE.name == "std_srvs/srv/Empty"
