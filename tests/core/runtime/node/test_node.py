"""Nodes and contexts: names, arguments, lifetime, graph."""

from __future__ import annotations

import asyncio
import logging
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool
from support import raw_endpoints
from support.folders import ROOT
from support.local_network import domain_id, second_domain_id
from support.waiting import until

from rosidl_py_gen import get_message, get_service, runtime, type_hash
from rosidl_py_gen.errors import ClosedError, InvalidNameError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log, LoggerLevel
from rosidl_py_gen.msgs.rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rosidl_py_gen.runtime import (
    Context,
    EndpointType,
    MemoryTransport,
    Node,
    QoSProfile,
    TopicEndpointInfo,
    WaitTimeoutError,
)
from rosidl_py_gen.runtime.entities.message_types import (
    lazy_message_type,
    lazy_service_type,
    message_type,
    service_type,
)
from rosidl_py_gen.runtime.logs import get_logger
from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError
from rosidl_py_gen.runtime.node.context import core_of
from rosidl_py_gen.runtime.parameters.values import ParameterError
from rosidl_py_gen.runtime.transport.qos import ROSOUT, Durability, History, Reliability

if TYPE_CHECKING:
    from support.worlds import World

pytestmark = pytest.mark.on_zenoh


@pytest.mark.every_transport
async def test_node_and_entity_names_are_expanded_and_remapped(world: World) -> None:
    context = world.context("--ros-args", "-r", "__ns:=/robot", "-r", "chatter:=/loud", "-r", "~/in:=other")
    node = world.node("arm", "ignored", context=context)
    assert (node.name, node.namespace, node.fully_qualified_name) == ("arm", "/robot", "/robot/arm")
    assert node.logger.name == "robot.arm"
    assert node.create_publisher(String, "chatter").topic == "/loud"
    assert node.create_subscription(String, "~/in").topic == "/robot/other"
    assert node.create_publisher(String, "{node}/x").topic == "/robot/arm/x"
    assert node.create_service(AddTwoInts, "~/add").name == "/robot/arm/add"


@pytest.mark.every_transport
async def test_nodes_discover_each_other_and_notice_closed_nodes(world: World) -> None:
    alice, bob = world.pair()
    carol = world.node("carol", "/ns", context=alice.context)
    for node in (alice, bob, carol):
        for name in ("/alice", "/bob", "/ns/carol"):
            assert await node.wait_for_node(name, timeout_s=20)
        assert node.get_node_names() == ["/alice", "/bob", "/ns/carol"]
    carol.close()

    async def until_carol_left() -> None:
        if bob.get_node_names() == ["/alice", "/bob"]:
            return
        async for _ in bob.graph_changes():
            if bob.get_node_names() == ["/alice", "/bob"]:
                return

    await asyncio.wait_for(until_carol_left(), 20)
    with pytest.raises(WaitTimeoutError, match=r"^no node /nobody appeared in 0.05 s$"):
        await bob.wait_for_node("nobody", timeout_s=0.05)
    with pytest.raises(WaitTimeoutError, match='no node /alce appeared; did you mean "/alice"'):
        await bob.wait_for_node("alce", timeout_s=0.01)


@pytest.mark.every_transport
async def test_endpoint_info_contains_node_type_hash_and_qos(world: World) -> None:
    alice, bob = world.pair()
    qos = QoSProfile().keep_last(7).transient_local().deadline(1.5)
    publisher = alice.create_publisher(String, "/topic", qos)
    alice.create_subscription(String, "/topic", qos=QoSProfile().keep_all().best_effort())
    assert await publisher.wait_for_subscribers(timeout_s=20)
    assert await bob.wait_for_node("/alice", timeout_s=20)
    await until(lambda: bob.count_publishers("/topic") == 1 and bob.count_subscribers("/topic") == 1)
    await until(lambda: bob.get_publishers_info_by_topic("/topic")[0].node_name == "alice")
    (info,) = bob.get_publishers_info_by_topic("topic")
    assert (info.node_name, info.node_namespace, info.topic_type) == ("alice", "/", "std_msgs/msg/String")
    assert info.topic_type_hash == type_hash(String)
    assert info.endpoint_type is EndpointType.PUBLISHER
    assert info.endpoint_gid == publisher.gid and len(info.endpoint_gid) == 16
    assert (info.qos_profile.history, info.qos_profile.depth) == (History.KEEP_LAST, 7)
    assert info.qos_profile.durability is Durability.TRANSIENT_LOCAL
    assert info.qos_profile.deadline_ns == 1_500_000_000
    (other,) = bob.get_subscriptions_info_by_topic("rt/topic" if world.kind == "dds" else "/topic", no_mangle=True)
    assert other.qos_profile.history is History.KEEP_ALL
    assert other.qos_profile.depth == (42 if world.kind == "zenoh" else 0)
    assert other.qos_profile.reliability is Reliability.BEST_EFFORT


@pytest.mark.every_transport
async def test_topics_and_services_are_listed_for_the_graph_and_for_each_node(world: World) -> None:
    alice, bob = world.pair()
    alice.create_publisher(String, "/out")
    alice.create_subscription(Int32, "/in")
    alice.create_service(AddTwoInts, "/add")
    bob.create_client(AddTwoInts, "/add")
    string, int32, add = ["std_msgs/msg/String"], ["std_msgs/msg/Int32"], ["example_interfaces/srv/AddTwoInts"]
    log, event = ["rcl_interfaces/msg/Log"], ["rcl_interfaces/msg/ParameterEvent"]
    common = [("/parameter_events", event), ("/rosout", log)]
    await until(lambda: len(bob.get_topic_names_and_types()) == 4)
    assert bob.get_topic_names_and_types() == [("/in", int32), ("/out", string), *common]
    requests = ("rq/addRequest", ["example_interfaces::srv::dds_::AddTwoInts_Request_"])
    if world.kind == "zenoh":
        requests = ("/add", ["example_interfaces::srv::dds_::AddTwoInts_"])
    if world.kind == "memory":
        requests = ("/add", [f"example_interfaces/srv/AddTwoInts_{half}" for half in ("Request", "Response")])
    assert requests in bob.get_topic_names_and_types(no_demangle=True)
    of_alice, of_bob = every_nodes_services("/alice"), every_nodes_services("/bob")
    await until(lambda: bob.get_service_names_and_types() == [("/add", add), *of_alice, *of_bob])
    await until(lambda: bob.get_service_names_and_types_by_node("alice") == [("/add", add), *of_alice])
    assert bob.get_publisher_names_and_types_by_node("alice") == [("/out", string), *common]
    assert bob.get_subscriber_names_and_types_by_node("alice") == [("/in", int32)]
    await until(lambda: bob.get_client_names_and_types_by_node("bob") == [("/add", add)])
    assert bob.get_client_names_and_types_by_node("alice") == []


@pytest.mark.every_transport
async def test_servers_and_clients_of_a_service_are_counted(world: World) -> None:
    alice, bob = world.pair()
    server = alice.create_service(AddTwoInts, "/add")
    clients = [node.create_client(AddTwoInts, "/add") for node in (alice, bob)]
    await until(lambda: (bob.count_services("add"), bob.count_clients("add")) == (1, 2))
    another = bob.create_service(AddTwoInts, "/add")
    await until(lambda: (alice.count_services("add"), alice.count_clients("add")) == (2, 2))
    for endpoint in (server, another, clients[1]):
        endpoint.close()
    await until(lambda: (bob.count_services("add"), bob.count_clients("add")) == (0, 1))
    assert (bob.count_services("nobody"), bob.count_clients("nobody")) == (0, 0)


async def test_count_services_expands_and_remaps_service_names(world: World) -> None:
    alice = world.node("alice", "/ns")
    alice.create_service(AddTwoInts, "sum")
    alice.create_client(AddTwoInts, "~/own")
    asker = world.node("alice", "/ns", args="--ros-args -r rosservice://add:=sum -r rostopic://sum:=other")
    await until(lambda: asker.count_services("add") == 1 and asker.count_clients("~/own") == 1)
    assert (asker.count_services("sum"), asker.count_services("/sum")) == (1, 0)
    for count in (asker.count_services, asker.count_clients):
        with pytest.raises(InvalidNameError, match="invalid service name"):
            count("a//b")


def every_nodes_services(node: str) -> list[tuple[str, list[str]]]:
    """Return the services of every node (docs/internals/protocol.md 9.1)."""
    parameters = (
        "DescribeParameters",
        "GetParameterTypes",
        "GetParameters",
        "GetTypeDescription",
        "ListParameters",
        "SetParameters",
        "SetParametersAtomically",
    )
    found = []
    for name in parameters:
        package = "type_description_interfaces" if name == "GetTypeDescription" else "rcl_interfaces"
        snake = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name)[1:]
        found.append((f"{node}/{snake}", [f"{package}/srv/{name}"]))
    return sorted(found)


async def test_context_returns_program_arguments_and_applies_parameter_arguments(memory: World) -> None:
    context = memory.context("--fast", "--ros-args", "-p", "speed:=2", "-p", "arm:speed:=3", "--", "file")
    assert context.arguments == ["test", "--fast", "file"]
    arm, leg = memory.node("arm", context=context), memory.node("leg", context=context)
    assert [node.declare_parameter("speed", 1) for node in (arm, leg)] == [3, 2]


def test_failed_node_creation_leaves_no_node_in_the_graph(memory: World) -> None:
    context = memory.context("--ros-args", "-p", "use_sim_time:=3")
    with pytest.raises(ParameterError):
        Node("n", context=context)
    assert core_of(context).discovery.graph.nodes() == []


def test_lazily_imported_types_equal_the_bundled_types() -> None:
    services = [name for name in HASHES if f"{name}_Request" in HASHES]
    assert "rcl_interfaces/srv/SetParameters" in services
    for name in services:
        early, late = service_type(get_service(name)), lazy_service_type(name)
        for one, other in ((early, late), (early.request, late.request), (early.response, late.response)):
            assert (one.ros_name, one.type_hash) == (other.ros_name, other.type_hash)
        message = get_service(name).Request()
        assert late.request.decode(late.request.encode(message)) == message
    name = "rcl_interfaces/msg/ParameterEvent"
    assert lazy_message_type(name).type_hash == message_type(name).type_hash
    assert lazy_message_type(name).encode(get_message(name)()) == get_message(name)().encode()


@pytest.mark.slow
def test_a_node_starts_without_what_it_may_never_need() -> None:
    program = (
        "import sys\nfrom rosidl_py_gen.runtime import Context, MemoryTransport, Node\n"
        "node = Node('n', context=Context(transport=MemoryTransport(), args=['p']))\n"
        "print([m for m in sys.modules if m == 'yaml' or '.runtime.action' in m or '_srv' in m or '.srv._' in m])\n"
        "node.context.close()\n"
    )
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


@pytest.mark.slow
def test_a_forgotten_node_lives_until_process_exit_and_is_warned_about() -> None:
    program = (
        "import gc\nfrom rosidl_py_gen.runtime import Context, MemoryTransport, Node\n"
        "context = Context(transport=MemoryTransport(), args=['p'])\n"
        "Node('forgotten', context=context)\ngc.collect()\n"
        "print(Node('n', context=context).get_node_names())\n"
    )
    command = [sys.executable, "-W", "always", "-c", program]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout == "['/forgotten', '/n']\n"
    assert "ResourceWarning: node /forgotten was never closed" in run.stderr


def test_every_exported_name_exists() -> None:
    stub = (ROOT / "rosidl_py_gen" / "runtime" / "__init__.pyi").read_text().splitlines()
    assert [name for name in runtime.__all__ if getattr(runtime, name) is None] == []
    assert len(stub) == len(runtime.__all__) > 100


async def test_node_constructor_options_are_applied(memory: World) -> None:
    node = Node(
        "n",
        context=memory.context(),
        parameter_overrides={"a": 1},
        automatically_declare_parameters_from_overrides=True,
        start_services=False,
        logger_services=True,
    )
    assert node.get_parameter("a", int) == 1
    names = ["/n/get_logger_levels", "/n/get_type_description", "/n/set_logger_levels"]
    await until(lambda: [name for name, _ in node.get_service_names_and_types_by_node("n")] == names)
    node.close()


@pytest.mark.every_transport
@pytest.mark.without_zenoh("everything is compatible")
async def test_incompatible_qos_is_logged_once_by_each_node_with_both_names(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    def warnings() -> list[str]:
        return [text for text in (record.getMessage() for record in caplog.records) if "incompatible" in text]

    alice, bob = world.pair()
    with caplog.at_level(logging.WARNING):
        alice.create_publisher(String, "s", QoSProfile().best_effort())
        bob.create_subscription(String, "s", qos=QoSProfile().reliable())
        await until(lambda: len(warnings()) == 2)  # each node logs to its own user
        bob.create_publisher(String, "unrelated")
        await until(lambda: alice.count_publishers("unrelated") == bob.count_publishers("unrelated") == 1)
    assert len(warnings()) == 2
    for line in warnings():
        assert "on /s from node /alice to node /bob" in line
        assert "Best effort publisher and reliable subscription" in line


def test_failing_on_incompatible_endpoint_callback_is_logged_and_discovery_continues(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(text: str, topic: str) -> None:
        calls.append((topic, alice.count_publishers("later")))
        raise ValueError("boom")

    calls: list[tuple[str, int]] = []
    alice, bob = memory.pair()
    alice.context.on_incompatible_endpoint = fail
    bob.create_publisher(String, "s")
    assert alice.count_publishers("s") == 1
    alice.create_subscription(Int32, "s")
    bob.create_publisher(String, "later")  # arrives together with the subscription
    assert alice.count_publishers("later") == 1
    assert calls == [("/s", 1)] and "Context.on_incompatible_endpoint failed" in caplog.text


@pytest.mark.every_transport
async def test_log_messages_of_a_node_are_published_on_rosout(world: World) -> None:
    alice, bob = world.pair()
    logs = bob.create_subscription(Log, "/rosout", qos=ROSOUT)
    alice.logger.warning("careful")
    while True:
        message = await logs.receive(timeout_s=20)
        if message.name == "alice":
            break
    assert (message.level, message.msg) == (30, "careful")
    assert message.file.endswith("test_node.py") and message.function and message.line > 0


@pytest.mark.every_transport
async def test_best_available_qos_is_resolved_from_existing_peers_at_creation(world: World) -> None:
    from rosidl_py_gen.runtime.transport.qos import BEST_AVAILABLE

    alice, bob = world.pair()
    alice.create_publisher(String, "s", QoSProfile().best_effort())
    await until(lambda: bob.count_publishers("s") == 1)
    subscription = bob.create_subscription(String, "s", qos=BEST_AVAILABLE)
    assert subscription.qos.reliability is Reliability.BEST_EFFORT
    assert subscription.qos.durability is Durability.VOLATILE


@pytest.mark.every_transport
def test_closing_a_context_closes_its_nodes(world: World) -> None:
    context = world.context()
    node = world.node("n", context=context)
    publisher = node.create_publisher(String, "s")
    context.close()
    context.close()
    assert node.is_closed
    with pytest.raises(ClosedError):
        publisher.publish(String())
    with pytest.raises(ClosedError):
        Node("m", context=context)


@pytest.mark.slow
@pytest.mark.usefixtures("network")
def test_default_context_exists_from_first_node_to_last_node() -> None:
    with Node("a") as first, Node("b") as second:
        context = first.context
        assert second.context is context
        first.close()
        assert not context.is_closed
    assert context.is_closed
    with Node("c") as third:
        assert third.context is not context


def test_context_refuses_a_second_running_loop(world: World) -> None:
    node = world.node("n")

    async def outer() -> None:
        core_of(node.context).loop_binding.running_loop()

        async def inner() -> None:
            core_of(node.context).loop_binding.running_loop()

        with pytest.raises(WrongEventLoopError, match="create a Context for the nodes of each loop"):
            await asyncio.to_thread(lambda: asyncio.run(inner()))

    asyncio.run(outer())

    async def later() -> None:
        subscription = node.create_subscription(Int32, "n")
        publisher = node.create_publisher(Int32, "n")
        assert await publisher.wait_for_subscribers(timeout_s=20)
        publisher.publish(Int32(data=1))
        assert (await subscription.receive(timeout_s=20)).data == 1

    asyncio.run(later())  # consecutive loops are allowed


async def test_contexts_of_different_domains_do_not_match_in_memory() -> None:
    world = MemoryTransport()
    with Context(1, transport=world) as one, Context(2, transport=world) as two:
        first, second = Node("first", context=one), Node("second", context=two)
        publisher = first.create_publisher(String, "s")
        second.create_subscription(String, "s")
        with pytest.raises(WaitTimeoutError, match=r"^0 subscriptions on /s, expected at least 1, in 0.05 s: no"):
            await publisher.wait_for_subscribers(timeout_s=0.05)
        first.close()
        second.close()


@pytest.mark.slow
@pytest.mark.usefixtures("network")
async def test_contexts_of_different_domains_do_not_match_on_the_network() -> None:
    assert domain_id() != second_domain_id()
    with (
        Context(domain_id()) as one,
        Context(domain_id()) as same,
        Context(second_domain_id()) as two,
        Node("first", context=one) as first,
        Node("near", context=same) as near,
        Node("far", context=two) as far,
    ):
        publisher = first.create_publisher(String, "s")
        near_subscription = near.create_subscription(String, "s")
        far_subscription = far.create_subscription(String, "s")
        assert await publisher.wait_for_subscribers(timeout_s=20)
        with pytest.raises(WaitTimeoutError, match=r"^1 subscription on /s, expected at least 2, in 1 s$"):
            await publisher.wait_for_subscribers(timeout_s=1, count=2)
        publisher.publish(String(data="near"))
        assert await near_subscription.receive(timeout_s=20) == String(data="near")
        with pytest.raises(WaitTimeoutError):
            await far_subscription.receive(timeout_s=0.2)
        await until(lambda: sorted(first.get_node_names()) == ["/first", "/near"])
        assert far.get_node_names() == ["/far"]
        assert far.count_publishers("s") == 0


@pytest.mark.every_transport
async def test_incompatible_endpoints_are_listed_with_nodes_and_reason(world: World) -> None:
    alice, bob, asker = world.node("alice"), world.node("bob"), world.node("asker")
    alice.create_publisher(String, "t")
    bob.create_subscription(Int32, "t")
    alice.create_service(AddTwoInts, "s")
    bob.create_client(SetBool, "s")
    await until(
        lambda: (
            asker.incompatible_endpoints_of_topic("t")
            and asker.incompatible_endpoints_of_service("/s")
            and asker.node_names_complete()
        )
    )
    (topic,), (service,) = asker.incompatible_endpoints_of_topic("t"), asker.incompatible_endpoints_of_service("/s")
    assert (topic.writer.node_text, topic.reader.node_text, topic.kind) == ("/alice", "/bob", "type")
    assert topic.reason == "types differ, std_msgs/msg/String and std_msgs/msg/Int32"
    assert (service.writer.node_text, service.reader.node_text, service.kind) == ("/bob", "/alice", "type")
    assert service.reason == "types differ, std_srvs/srv/SetBool and example_interfaces/srv/AddTwoInts"
    assert asker.incompatible_endpoints_of_topic("/rosout") == asker.incompatible_endpoints_of_service("nobody") == []


@pytest.mark.every_transport
async def test_servers_clients_and_participants_are_listed_with_node_names(world: World) -> None:
    alice, bob = world.pair()
    alice.create_service(AddTwoInts, "add")
    bob.create_client(AddTwoInts, "add")

    def service_endpoints() -> list[TopicEndpointInfo]:
        return [*bob.get_servers_info_by_service("add"), *bob.get_clients_info_by_service("/add")]

    await until(lambda: [one.has_node_name for one in service_endpoints()] == [True, True])
    server, client = service_endpoints()
    assert (server.node_text, client.node_text) == ("/alice", "/bob")
    found = {one.guid: one for one in bob.context.participants()}
    assert [one.guid for one in found.values() if one.is_own] == [client.participant_guid]
    assert [node.fully_qualified_name for node in found[server.participant_guid].nodes] == ["/alice"]
    assert bob.context.middleware.lower() == world.kind


@pytest.mark.every_transport
async def test_existing_topics_with_invalid_ros_names_can_be_queried(world: World) -> None:
    other, asker = world.node("other"), world.node("asker")
    raw_endpoints.announce(other, "rt/2d_scan", "std_msgs::msg::dds_::String_", "")
    await until(lambda: "/2d_scan" in dict(asker.get_topic_names_and_types()))
    assert [one.topic_type for one in asker.get_publishers_info_by_topic("/2d_scan")] == ["std_msgs/msg/String"]
    assert (asker.count_publishers("/2d_scan"), asker.incompatible_endpoints_of_topic("/2d_scan")) == (1, [])
    with pytest.raises(InvalidNameError):
        asker.get_publishers_info_by_topic("/3d_scan")


async def test_logger_services_set_and_report_levels(world: World) -> None:
    world.node("n", logger_services=True)
    other = world.node("other")
    change = other.create_client(SetLoggerLevels, "/n/set_logger_levels")
    request = SetLoggerLevels.Request(levels=[LoggerLevel(name="svc.a", level=40), LoggerLevel(name="svc.b", level=25)])
    results = (await change.call(request, 5)).results
    assert [(r.successful, bool(r.reason)) for r in results] == [(True, False), (False, True)]
    assert get_logger("svc.a.child").getEffectiveLevel() == 40
    get_levels = other.create_client(GetLoggerLevels, "/n/get_logger_levels")
    levels = (await get_levels.call(GetLoggerLevels.Request(names=["svc.a", "svc.a.child"]), 5)).levels
    assert [(level.name, level.level) for level in levels] == [("svc.a", 40), ("svc.a.child", 0)]
