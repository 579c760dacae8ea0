"""Features of nodes: /rosout, simulated time, type descriptions, logger levels, introspection."""

from __future__ import annotations

import logging
from typing import Any

import pytest
from peer_helpers import fresh, message, plain, repeated, service
from rclpy_peer import Peer
from support.inner_state import graph_of
from support.waiting import until

from rosidl_py_gen import from_dict, get_message, type_hash
from rosidl_py_gen.runtime import IntrospectionState, Node, TypeDescriptionError
from rosidl_py_gen.runtime.transport.qos import ROSOUT, SYSTEM_DEFAULT

WAIT_S = 10
LOG = "rcl_interfaces/msg/Log"
SET_BOOL = "std_srvs/srv/SetBool"
RCLPY_ROSOUT = {"depth": 1000, "durability": "TRANSIENT_LOCAL"}
LEVELS = [20, 30, 40, 50]
MINUTE_NS = 60_000_000_000


async def test_log_messages_of_rclpy_node_are_received_from_rosout(world: Any, shared_peer: Peer) -> None:
    node, text = world.node("reader"), fresh("words from them")
    subscription = node.create_subscription(message(shared_peer, LOG), "/rosout", qos=ROSOUT)
    await shared_peer.do("log", text=text)
    records: list[Any] = []
    while len(records) < len(LEVELS):
        record = await subscription.receive(timeout_s=WAIT_S)
        records += [record] if record.msg == text else []
    assert [(one.level, one.name) for one in records] == [(level, shared_peer.name) for level in LEVELS]
    assert (
        records[0].stamp.sec > 1_600_000_000 and records[0].file.endswith("nodes.py") and records[0].function == "log"
    )


async def test_rclpy_receives_log_messages_from_rosout(world: Any, shared_peer: Peer) -> None:
    name, text = fresh("writer"), fresh("words from us")
    node = world.node(name.strip("/"), "/deep")
    for level in LEVELS:
        node.logger.log(level, text)
    await shared_peer.do("subscribe", topic="/rosout", type=LOG, qos=RCLPY_ROSOUT)
    records: list[Any] = []
    while len(records) < len(LEVELS):
        (record,) = await shared_peer.do("take", topic="/rosout")
        records += [record] if record["msg"] == text else []
    expected = [(level, f"deep{name.replace('/', '.')}") for level in LEVELS]
    assert [(one["level"], one["name"]) for one in records] == expected


async def test_rclpy_clock_publisher_sets_simulated_time_of_node(world: Any, shared_peer: Peer) -> None:
    node = Node(fresh("simulated").strip("/"), context=world.context(), parameter_overrides={"use_sim_time": True})
    await shared_peer.do("publisher", topic="/clock", type="rosgraph_msgs/msg/Clock")
    stamp = {"clock": {"sec": 1234, "nanosec": 5}}

    async def send() -> None:
        await shared_peer.do("publish", topic="/clock", messages_=[stamp])

    async def arrived() -> None:
        await until(lambda: node.clock.now().nanoseconds == 1_234_000_000_005)

    try:
        await repeated(send, arrived())
    finally:
        node.close()


async def test_clock_publisher_sets_simulated_time_of_rclpy_node(world: Any, shared_peer: Peer) -> None:
    name = fresh("simulated").strip("/")
    await shared_peer.do("add_node", name=name, parameters={"use_sim_time": True})
    cls = message(shared_peer, "rosgraph_msgs/msg/Clock")
    publisher = world.node("tester").create_publisher(cls, "/clock")
    stamp = cls()
    stamp.clock.sec = 60
    arrived = shared_peer.do("now_ns", node=name, at_least=MINUTE_NS)
    assert await repeated(lambda: publisher.publish(stamp), arrived) == MINUTE_NS


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_type_description_of_rclpy_node_is_requested(world: Any, shared_peer: Peer) -> None:
    node, kind = world.node("tester"), "test_msgs/msg/MultiNested"
    await shared_peer.do("publisher", topic=fresh("described"), type=kind)
    wanted = type_hash(message(shared_peer, kind))
    answer = await node.get_type_description(f"/{shared_peer.name}", kind, wanted, timeout_s=WAIT_S)
    assert answer.type_description.type_description.type_name == kind
    assert answer.type_sources[0].type_name == kind and "array_of_arrays" in answer.type_sources[0].raw_file_contents
    with pytest.raises(TypeDescriptionError):
        await node.get_type_description(f"/{shared_peer.name}", kind, f"RIHS01_{'0' * 64}", timeout_s=WAIT_S)


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_type_description_service_replies_like_rclpy_node(
    world: Any, shared_peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(shared_peer.share.parent))  # where sources of types are looked for
    node, kind = world.node(fresh("owner").strip("/")), "test_msgs/msg/MultiNested"
    cls = message(shared_peer, kind)
    node.create_publisher(cls, fresh("described"))
    await shared_peer.do("publisher", topic=fresh("described"), type=kind)
    described = []
    for owner in (node.fully_qualified_name, f"/{shared_peer.name}"):
        name = f"{owner}/get_type_description"
        await shared_peer.do("client", name=name, type="type_description_interfaces/srv/GetTypeDescription")
        request = {"type_name": kind, "type_hash": type_hash(cls), "include_type_sources": True}
        (answer,) = await shared_peer.do("call", name=name, requests_=[request])
        for source in answer["type_sources"]:
            source["raw_file_contents"] = source["raw_file_contents"].rstrip("\n")  # theirs has lost the last one
        described.append({key: answer[key] for key in ("successful", "type_description", "type_sources")})
    assert described[0]["successful"] and described[0] == described[1]


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_logger_levels_of_rclpy_node_are_set_and_read(world: Any, shared_peer: Peer) -> None:
    name = fresh("logging").strip("/")
    await shared_peer.do("add_node", name=name, enable_logger_service=True)
    node = world.node("tester")
    levels = [{"name": f"{name}.part", "level": 40}]
    setter, getter = (service(shared_peer, f"rcl_interfaces/srv/{verb}LoggerLevels") for verb in ("Set", "Get"))
    setting = node.create_client(setter, f"/{name}/set_logger_levels")
    answer = await setting.call(from_dict(setter.Request, {"levels": levels}), WAIT_S)
    assert [one.successful for one in answer.results] == [True]
    assert await shared_peer.do("logger_level", name=f"{name}.part") == "ERROR"
    getting = node.create_client(getter, f"/{name}/get_logger_levels")
    answer = await getting.call(getter.Request(names=[f"{name}.part"]), WAIT_S)
    assert plain(answer) == {"levels": levels}


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_rclpy_client_sets_and_reads_logger_levels(world: Any, shared_peer: Peer) -> None:
    name = fresh("logging").strip("/")
    node = Node(name, context=world.context(), logger_services=True)
    levels = [{"name": name, "level": 40}]
    try:
        for verb, request, expected in (
            ("set", {"levels": levels}, {"results": [{"successful": True, "reason": ""}]}),
            ("get", {"names": [name]}, {"levels": levels}),
        ):
            served, kind = f"/{name}/{verb}_logger_levels", f"rcl_interfaces/srv/{verb.title()}LoggerLevels"
            await shared_peer.do("client", name=served, type=kind)
            assert await shared_peer.do("call", name=served, requests_=[request]) == [expected]
        assert not node.logger.isEnabledFor(logging.WARNING) and node.logger.isEnabledFor(logging.ERROR)
    finally:
        node.close()


EVENTS = ["REQUEST_SENT", "REQUEST_RECEIVED", "RESPONSE_SENT", "RESPONSE_RECEIVED"]


OURS = pytest.mark.parametrize("is_ours", [True, False], ids=["our client", "our server"])


async def watched(node: Node, peer: Peer, name: str, is_ours: bool, state: str) -> Any:
    """Create our client and a server of the peer, or the reverse, with introspection; return a function that calls."""
    cls = service(peer, SET_BOOL)
    if is_ours:
        await peer.do("serve", name=name, type=SET_BOOL, how="set_bool")
        end: Any = node.create_client(cls, name)
    else:
        end = node.create_service(cls, name, lambda request: cls.Response(success=True, message="done"))
        await peer.do("client", name=name, type=SET_BOOL)
    await peer.do("introspect", kind="service" if is_ours else "client", name=name, state=state)
    end.configure_introspection(node.clock, SYSTEM_DEFAULT, IntrospectionState[state])

    async def call() -> None:
        if is_ours:
            assert (await end.call(cls.Request(data=True), WAIT_S)).success
        else:
            assert (await peer.do("call", name=name, requests_=[{"data": True}]))[0]["success"]

    return call


@pytest.mark.only_with("kilted", "lyrical")  # Jazzy's clients tell the GUID of their writer
@pytest.mark.about_fast_dds("with rmw_cyclonedds client and server announce different values")
@OURS
async def test_service_events_of_both_sides_contain_gid_of_reply_reader(
    world: Any, shared_peer: Peer, is_ours: bool
) -> None:
    node, name = world.node("tester"), fresh("watched")
    subscription = node.create_subscription(
        get_message(f"{SET_BOOL}_Event", path=shared_peer.share), f"{name}/_service_event", qos=100
    )
    call = await watched(node, shared_peer, name, is_ours, "METADATA")
    assert await subscription.wait_for_publishers(timeout_s=WAIT_S, count=2)
    await shared_peer.do("until_subscribed", topic=f"{name}/_service_event", count=1)
    for _ in range(3):
        await call()
    events = [await subscription.receive(timeout_s=WAIT_S) for _ in range(3 * len(EVENTS))]
    (gid,) = {bytes(event.info.client_gid) for event in events}
    readers = [reply for reply in graph_of(node).endpoints.values() if reply.topic_key == ("reply", name)]
    assert gid in [reply.guid for reply in readers if not reply.is_writer]


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
@pytest.mark.parametrize("state", ["METADATA", "CONTENTS"])
@OURS
async def test_service_introspection_of_client_and_server_publishes_all_events(
    world: Any, shared_peer: Peer, is_ours: bool, state: str
) -> None:
    node, name = world.node("tester"), fresh("watched")
    await check_events(node, shared_peer, name, state, await watched(node, shared_peer, name, is_ours, state))


async def check_events(node: Node, peer: Peer, name: str, state: str, call: Any) -> None:
    topic, kind = f"{name}/_service_event", f"{SET_BOOL}_Event"
    subscription = node.create_subscription(get_message(kind, path=peer.share), topic)
    await peer.do("subscribe", topic=topic, type=kind)
    assert await subscription.wait_for_publishers(timeout_s=WAIT_S, count=2)
    await peer.do("matched", topic=topic, count=2)
    await peer.do("until_subscribed", topic=topic, count=2)  # their publisher of events knows ours
    await until(lambda: node.count_subscribers(topic) == 2)  # they may know our publisher before it knows them
    await call()
    ours = [plain(await subscription.receive(timeout_s=WAIT_S)) for _ in EVENTS]
    theirs = await peer.do("take", topic=topic, count=len(EVENTS))
    for events in (ours, theirs):
        events.sort(key=lambda event: event["info"]["event_type"])
        assert [event["info"]["event_type"] for event in events] == [0, 1, 2, 3]
        assert len({event["info"]["sequence_number"] for event in events}) == 1
        requests = [event["request"] for event in events]
        responses = [event["response"] for event in events]
        has_contents = state == "CONTENTS"
        assert requests == ([[{"data": True}]] * 2 if has_contents else [[]] * 2) + [[]] * 2
        assert [len(one) for one in responses] == [0, 0, has_contents, has_contents]
    assert ours == theirs
