"""The parts of ``rosidl-py foxglove`` without a server: names that ROS refuses, namesakes, what is late or too much."""

from __future__ import annotations

import asyncio
import gc
from time import time_ns
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from support import raw_endpoints
from support.node_fixtures import until

from rosidl_py_gen import get_message, get_service
from rosidl_py_gen.ros_cli import CommandError, type_resolution
from rosidl_py_gen.ros_cli.foxglove import limits
from rosidl_py_gen.ros_cli.foxglove.parameters import ParameterBridge
from rosidl_py_gen.ros_cli.foxglove.protocol import ClientAdvertisement
from rosidl_py_gen.ros_cli.foxglove.publishing import ClientPublishing
from rosidl_py_gen.ros_cli.foxglove.serve import ConnectionGraph
from rosidl_py_gen.ros_cli.foxglove.services import ServiceBridge
from rosidl_py_gen.ros_cli.foxglove.topics import TopicBridge

if TYPE_CHECKING:
    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node

String: Any = get_message("std_msgs/msg/String")
Event: Any = get_message("rcl_interfaces/msg/ParameterEvent")
AnyParameter: Any = get_message("rcl_interfaces/msg/Parameter")
Trigger: Any = get_service("std_srvs/srv/Trigger")
DDS_STRING, DDS_TRIGGER = "std_msgs::msg::dds_::String_", "std_srvs::srv::dds_::Trigger_Response_"
SHOWN: dict[str, Any] = {"paths": (), "hidden": False}


class Told:
    """A server without viewers, which keeps what it is told."""

    def __init__(self) -> None:
        self.offers: dict[tuple[int, int], ClientAdvertisement] = {}
        self.channels: dict[str, Any] = {}
        self.calls: dict[str, Any] = {}
        self.warnings: list[str] = []
        self.graph: tuple[Any, ...] = ()

    def open_channel(self, topic: str, type_name: str, definition: str) -> Any:
        made = self.channels[topic] = SimpleNamespace(viewers=frozenset(), send=print)
        return made

    def close_channel(self, channel: Any) -> None:
        pass

    def watch(self, topic: str) -> None:
        self.channels[topic].viewers = frozenset({1})

    def add_service(self, name: str, type_name: str, texts: Any, call: Any) -> None:
        self.calls[name] = call

    def remove_services(self, names: list[str]) -> None:
        pass

    def publish_graph(self, *graph: Any) -> None:
        self.graph = graph

    def send_control(self, about: str, text: str) -> None:
        self.warnings.append(text)


@pytest.fixture
def told() -> Any:
    return Told()


def command_node_of(node: Node) -> Any:
    return SimpleNamespace(node=node)


def write(node: Node, topic: str, type_name: str) -> None:
    """Write to a DDS topic of any name."""
    raw_endpoints.announce(node, topic, type_name, "x")


# ---------------------------------------------------------------------------------------------------------- odd names


async def test_names_that_ros_refuses_are_told_those_who_watch_and_harm_nothing_else(memory: World, told: Any) -> None:
    robot, ours = memory.pair()
    for topic in ("rt/2d_scan", "rt/a//b", "rt/"):
        write(robot, topic, DDS_STRING)
    write(robot, "rt/plain", "Plain")
    words = robot.create_publisher(String, "words")
    topics = TopicBridge(command_node_of(ours), told, time_ns, **SHOWN)
    await until(lambda: "/words" in dict(ours.get_topic_names_and_types()))
    topics.refresh()
    wanted = ["/2d_scan", "/a//b", "/plain", "/words"]
    await until(lambda: {*wanted} <= {*told.channels})
    for topic in wanted:
        told.watch(topic)
    topics.update_subscriptions()
    assert await words.wait_for_subscribers(5)
    topics.refresh()
    for topic in ("/2d_scan", "/a//b", "/plain"):
        assert len([text for text in told.warnings if text.startswith(f"{topic} cannot be read: ")]) == 1
    await topics.close()


async def test_services_and_parameters_with_names_that_ros_refuses_are_left_out(memory: World, told: Any) -> None:
    robot, ours = memory.pair()
    for service in ("2d", "a//b", "odd//node/list_parameters", "list_parameters"):
        write(robot, f"rr/{service}Reply", DDS_TRIGGER)
    robot.create_service(Trigger, "trigger", lambda request: Trigger.Response())
    robot.declare_parameter("gain", 1.0)
    services = ServiceBridge(command_node_of(ours), told, **SHOWN)
    parameters = ParameterBridge(command_node_of(ours), told, print, is_read_only=False)
    async with robot:
        services.refresh()
        await until(lambda: "/trigger" in told.calls)
        assert (await parameters.get([]))["/alice.gain"] == 1.0
    assert not {"/2d", "/a//b"} & {*told.calls}
    await services.close()
    await parameters.close()


async def test_nodes_in_namespaces_that_ros_refuses_are_left_out(memory: World, told: Any) -> None:
    robot, ours = memory.pair()
    robot.create_publisher(String, "words")
    robot._scope.discovery.add_node("odd", "/2d//space")
    await until(lambda: any(one.name == "odd" for one in ours.get_nodes()))
    ConnectionGraph(ours, told, hidden=False).refresh()
    assert told.graph[0]["/words"] == ["/alice"]


async def test_topics_of_a_namesake_are_shown_and_our_own_are_not(memory: World, told: Any) -> None:
    ours, namesake = memory.node("same"), memory.node("same")
    ours._scope.discovery._announce_delay_s = 5.0  # our endpoints are of no node yet
    topics = TopicBridge(command_node_of(ours), told, time_ns, **SHOWN)
    await asyncio.sleep(0)
    namesake.create_publisher(String, "theirs")
    ours.create_publisher(String, "ours")
    await until(lambda: {"/ours", "/theirs"} <= {*dict(ours.get_topic_names_and_types())})
    topics.refresh()
    await until(lambda: "/theirs" in told.channels)
    assert "/ours" not in told.channels
    await topics.close()


# ------------------------------------------------------------------------------------------------ late, and too much


async def test_a_call_of_a_service_that_has_gone_makes_no_client(memory: World, told: Any) -> None:
    robot, ours = memory.pair()
    service = robot.create_service(Trigger, "trigger", lambda request: Trigger.Response())
    services = ServiceBridge(command_node_of(ours), told, **SHOWN)
    services.refresh()
    await until(lambda: "/trigger" in told.calls)
    service.close()
    await until(lambda: ours.count_services("/trigger") == 0)
    services.refresh()
    with pytest.raises(CommandError, match=r"^service /trigger has disappeared$"):
        await told.calls["/trigger"](Trigger.Request().encode())
    assert ours.count_clients("/trigger") == 0
    await services.close()


async def test_events_of_nodes_that_are_not_there_are_not_kept(memory: World, told: Any) -> None:
    robot, ours = memory.pair()
    robot.declare_parameter("gain", 1.0)
    parameters = ParameterBridge(command_node_of(ours), told, print, is_read_only=False)
    async with robot:
        await parameters.get([])
        events = robot.create_publisher(Event, "/parameter_events")
        assert await events.wait_for_subscribers(5)
        for node in ("/nobody", "/alice"):
            event = Event(node=node, new_parameters=[AnyParameter(name="x")])
            event.new_parameters[0].value.type, event.new_parameters[0].value.integer_value = 2, 1
            events.publish(event)
        while "/alice.x" not in (known := await parameters.get([])):
            await asyncio.sleep(0.01)
        assert "/nobody.x" not in known
    await parameters.close()


async def test_viewers_can_define_so_many_types_and_no_more(
    memory: World, told: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MAX_SCHEMAS", 2)
    node = memory.node()
    publisher = ClientPublishing(command_node_of(node), told, paths=())

    async def refusal(number: int, name: str, schema: bytes) -> str:
        topic = f"/many{number}"
        told.offers[1, number] = ClientAdvertisement(topic, "cdr", f"viewers/msg/{name}", "ros2msg", schema)
        publisher.update_publishers()
        await until(lambda: node.count_publishers(topic) > 0 or any(topic in text for text in told.warnings))
        return "".join(text for text in told.warnings if topic in text)

    assert await refusal(0, "Wrong", b"no field\n")
    assert [await refusal(number, f"Many{number}", b"int8 x\n") for number in (1, 2)] == ["", ""]
    assert await refusal(3, "Many2", b"int8 x\n") == ""
    assert "too many definitions: 3 (21 bytes); expected at most 2 (" in await refusal(4, "Many4", b"int8 x\n")
    await publisher.close()


async def test_the_compiler_is_loaded_ahead_only_when_others_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, loaded, times = asyncio.get_running_loop(), asyncio.Event(), []

    def load() -> None:
        times.append(loop.time())
        loop.call_soon_threadsafe(loaded.set)

    monkeypatch.setattr(type_resolution, "load_compiler", load)
    await type_resolution.preload_while_waiting(asyncio.sleep(0))
    began = loop.time()
    await asyncio.wait_for(type_resolution.preload_while_waiting(loaded.wait()), 10)
    assert [time > began for time in times] == [True]


async def test_a_compiler_that_cannot_be_loaded_ahead_is_not_complained_of(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, failed = asyncio.get_running_loop(), asyncio.Event()

    def fail() -> None:
        loop.call_soon_threadsafe(failed.set)
        raise ImportError("broken")

    monkeypatch.setattr(type_resolution, "load_compiler", fail)
    complaints: list[Any] = []
    loop.set_exception_handler(lambda _, context: complaints.append(context))
    await asyncio.wait_for(type_resolution.preload_while_waiting(failed.wait()), 20)
    await loop.run_in_executor(None, print)
    for _ in range(10):
        await asyncio.sleep(0)
        gc.collect()
    assert complaints == []
