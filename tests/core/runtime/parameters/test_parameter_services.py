"""Parameter services, events and the remote client (docs/internals/protocol.md 9.1 to 9.5)."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from support import raw_endpoints
from support.inner_state import graph_of, scope_of, transport_end_of
from support.raw_endpoints import reply_name, request_name
from support.waiting import take, until
from support.worlds import World, entity

from rosidl_py_gen.msgs.rcl_interfaces.msg import Parameter as ParameterMessage
from rosidl_py_gen.msgs.rcl_interfaces.msg import ParameterEvent as EventMessage
from rosidl_py_gen.msgs.rcl_interfaces.msg import ParameterValue as ValueMessage
from rosidl_py_gen.msgs.rcl_interfaces.srv import GetParameters, GetParameterTypes, ListParameters, SetParameters
from rosidl_py_gen.runtime import (
    CallTimeoutError,
    ClockType,
    Durability,
    History,
    QoSProfile,
    Reliability,
    SetResult,
    Time,
    WaitTimeoutError,
)
from rosidl_py_gen.runtime.parameters.services import (
    descriptor_from_message,
    descriptor_to_message,
    value_from_message,
    value_to_message,
)
from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterValue,
    WrongParameterTypeError,
    parameter_value,
)
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS

pytestmark = pytest.mark.on_zenoh

SERVICES = [
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
]
ALL_TYPES: list[Any] = [None, True, -5, 2.5, "text", b"\x01\xff", [True, False], [1, 2], [0.5], ["a", "ü"]]


def test_parameter_message_uses_only_the_member_of_its_type() -> None:
    assert value_to_message(parameter_value(7)) == ValueMessage(type=2, integer_value=7)
    assert value_from_message(ValueMessage(type=200, integer_value=7)) == ParameterValue()


@pytest.mark.parametrize(
    "descriptor",
    [
        ParameterDescriptor("a", ParameterType.INTEGER, "d", "c", True, False, None, IntRange(1, 9, 2)),
        ParameterDescriptor("a", ParameterType.DOUBLE, dynamic_typing=True, floating_point_range=FloatRange(0, 1, 0.5)),
    ],
)
def test_descriptors_round_trip_through_messages(descriptor: ParameterDescriptor) -> None:
    assert descriptor_from_message(descriptor_to_message(descriptor)) == descriptor


@pytest.mark.every_transport
def test_node_has_the_services_and_parameters_of_rclpy_nodes(world: World) -> None:
    node = world.node("n", "/ns", logger_services=True)
    services = dict(node.get_service_names_and_types())
    for name in SERVICES:
        assert f"/ns/n/{name}" in services
    assert {"/ns/n/get_logger_levels", "/ns/n/set_logger_levels", "/ns/n/get_type_description"} <= set(services)
    assert node.get_parameter("use_sim_time", bool) is False
    assert node.get_parameter("start_type_description_service", bool) is True
    assert node.describe_parameter("start_type_description_service") == ParameterDescriptor(
        "start_type_description_service",
        ParameterType.BOOL,
        "If enabled, start the ~/get_type_description service.",
        read_only=True,
    )


def test_the_type_description_service_can_be_switched_off(world: World) -> None:
    node = world.node("n", args="--ros-args -p start_type_description_service:=false")
    assert "/n/get_type_description" not in dict(node.get_service_names_and_types())


@pytest.mark.every_transport
async def test_parameter_services_reply_like_rclpy(world: World) -> None:
    node = world.node("n")
    node.declare_parameter("a", 1)
    node.declare_parameter("g.b", "x")
    other = world.node("other")
    get = other.create_client(GetParameters, "/n/get_parameters")
    answer = await get.call(GetParameters.Request(names=["g.b", "a"]), 20)
    assert [value.type for value in answer.values] == [4, 2]
    assert (await get.call(GetParameters.Request(names=["a", "nope"]), 20)).values == []
    types = other.create_client(GetParameterTypes, "/n/get_parameter_types")
    assert list((await types.call(GetParameterTypes.Request(names=["a", "g.b"]), 20)).types) == [2, 4]
    listing = other.create_client(ListParameters, "/n/list_parameters")
    found = (await listing.call(ListParameters.Request(prefixes=["g"]), 20)).result
    assert (found.names, found.prefixes) == (["g.b"], ["g"])
    change = other.create_client(SetParameters, "/n/set_parameters")
    request = SetParameters.Request(
        parameters=[
            ParameterMessage(name="a", value=ValueMessage(type=4, string_value="no")),
            ParameterMessage(name="a", value=ValueMessage(type=2, integer_value=5)),
            ParameterMessage(name="x", value=ValueMessage(type=2)),
        ]
    )
    results = (await change.call(request, 20)).results
    assert [(r.successful, r.reason) for r in results] == [
        (False, "Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'"),
        (True, ""),
        (False, "Invalid access to undeclared parameter(s): ['x']"),
    ]


@pytest.mark.every_transport
async def test_set_parameters_response_is_sent_before_its_event(world: World) -> None:
    node, other = world.node("n"), world.node("other")
    node.declare_parameter("a", 1)
    events, client = other.parameter_events("/n"), other.create_parameter_client("/n")
    assert await events.wait_for_publishers(20) and await client.wait_for_services(20)
    await until(lambda: entity(node, "/parameter_events").has_subscriptions)
    written: list[str] = []
    record_calls(entity(node, "/parameter_events"), "_write", "event", written)
    record_calls(transport_end_of(entity(node, "/set_parameters")), "send", "answer", written)
    assert (await client.set({"a": 2}, 20))[0].successful
    await until(lambda: len(written) == 2)
    assert written == ["answer", "event"]
    written.clear()
    node.set_parameter("a", 3)
    await until(lambda: written == ["event"])
    await asyncio.to_thread(node.set_parameter, "a", 4)
    assert written == ["event"] * 2  # written at once if no loop runs that may have a response to send


def record_calls(of: Any, function: str, name: str, written: list[str]) -> None:
    write = getattr(of, function)

    def recorded(*sent: object) -> bool:
        written.append(name)
        return bool(write(*sent))

    setattr(of, function, recorded)


@pytest.mark.every_transport
@pytest.mark.without_zenoh("sessions find each other after the node has published the first of these events")
async def test_parameter_events_contain_node_stamp_and_changes(world: World) -> None:
    listener = world.node("listener")
    seen = listener.create_subscription(EventMessage, "/parameter_events", None, 100)
    node = world.node("n", "/ns")
    node.declare_parameter("a", 1)
    node.declare_parameter("d", 1, ParameterDescriptor(dynamic_typing=True))
    assert node.set_parameters_atomically({"a": 2, "d": None}).successful
    messages = [await seen.receive(5) for _ in range(5)]
    assert {m.node for m in messages} == {"/ns/n"} and messages[0].stamp.sec > 0
    assert [[p.name for p in m.new_parameters] for m in messages[:4]] == [
        ["use_sim_time"],
        ["start_type_description_service"],
        ["a"],
        ["d"],
    ]
    last = messages[4]
    assert [(p.name, p.value.integer_value) for p in last.changed_parameters] == [("a", 2)]
    assert [(p.name, p.value.type) for p in last.deleted_parameters] == [("d", 0)]


@pytest.mark.parametrize("value", ALL_TYPES[1:])
async def test_every_type_can_be_set_and_read_remotely(world: World, value: object) -> None:
    node = world.node("n")
    node.declare_parameter("p", None, ParameterDescriptor(dynamic_typing=True))
    remote = world.node("other").create_parameter_client("n")
    assert await remote.set({"p": value}, 5) == [SetResult(True)]
    assert await remote.get("p", 5) == parameter_value(value).value


@pytest.mark.every_transport
async def test_parameter_events_of_another_node_can_be_iterated(world: World) -> None:
    node, noise, other = world.node("n"), world.node("noise"), world.node("other")
    remote = other.create_parameter_client("/n")
    events, everything = remote.events(), other.parameter_events()
    await events.wait_for_publishers(20)
    await until(lambda: all(entity(one, "/parameter_events").subscription_count == 2 for one in (node, noise)))
    noise.declare_parameter("b", 1)
    node.declare_parameter("a", 1)
    got = await take(events)
    assert (got.node, got.event.new) == ("/n", (Parameter("a", parameter_value(1)),))
    assert {(await take(everything)).node for _ in range(2)} == {"/noise", "/n"}  # each stream has its own subscription
    remote.close()
    remote.close()
    with pytest.raises(StopAsyncIteration):
        await take(events)


@pytest.mark.every_transport
def test_node_parameter_methods_declare_get_set_and_undeclare(world: World) -> None:
    node = world.node("n", parameter_overrides={"given": 5})
    assert node.declare_parameter("given", 1) == 5
    assert node.declare_parameter("empty", [], ParameterDescriptor(type=ParameterType.STRING_ARRAY)) == ()
    assert node.set_parameters({"empty": [], "given": 6}) == [SetResult(True)] * 2
    assert node.get_parameter("given", int) == 6 and node.get_parameter("empty", list[str]) == []
    with pytest.raises(WrongParameterTypeError, match="'given' is of type INTEGER, expected DOUBLE"):
        node.get_parameter("given", float)
    with pytest.raises(ParameterNotDeclaredError):
        node.get_parameter("nope", float)
    with pytest.raises(InvalidParameterValueError, match="Wrong parameter type"):
        node.set_parameter("given", "text")
    with pytest.raises(TypeError, match="is not a parameter type"):
        node.get_parameter("given", dict)
    node.declare_parameter("unset", None, ParameterDescriptor(type=ParameterType.DOUBLE))
    assert node.get_parameter("unset", float) is None and node.get_parameter("unset", float, 2.5) == 2.5
    node.undeclare_parameter("unset")
    assert not node.has_parameter("unset") and node.list_parameters().prefixes == ()
    assert node.get_parameters(["given", "empty"]) == [6, ()]


def test_command_line_overrides_yield_to_constructor_overrides(world: World) -> None:
    node = world.node(
        "n",
        args="--ros-args -p a:=1 -p b:=2 -p other:c:=3 -p use_sim_time:=true",
        parameter_overrides={"a": 9},
        automatically_declare_parameters_from_overrides=True,
    )
    assert {n: node.get_parameter(n) for n in ("a", "b", "use_sim_time")} == {"a": 9, "b": 2, "use_sim_time": True}
    assert not node.has_parameter("c")
    refused = SetResult(False, "Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'")
    assert node.set_parameters({"b": "text"}) == [refused]


@pytest.mark.every_transport
@pytest.mark.real_time("an error has the whole timeout, not the rest of it")
async def test_parameter_client_times_out_without_remote_node(world: World) -> None:
    remote = world.node("other").create_parameter_client("/gone")
    with pytest.raises(WaitTimeoutError, match=r"does not serve its parameters: no server of .* appeared in 0.05 s"):
        await remote.wait_for_services(timeout_s=0.05)
    for method in (remote.get, remote.get_types, remote.describe):
        with pytest.raises(CallTimeoutError, match=r"no server of .* appeared in 0\.05 s"):
            await method("a", timeout_s=0.05)


def policies(qos: QoSProfile) -> tuple[History, int, Reliability, Durability]:
    return qos.history, qos.depth, qos.reliability, qos.durability


def test_parameter_qos_profiles_match_ros() -> None:
    expected = (History.KEEP_LAST, 1000, Reliability.RELIABLE, Durability.VOLATILE)
    assert policies(PARAMETERS) == policies(PARAMETER_EVENTS) == expected


@pytest.mark.every_transport
@pytest.mark.without_zenoh("it announces a depth for endpoints that keep all, too")
async def test_parameter_endpoints_are_announced_with_types_and_qos(world: World) -> None:
    """History does not affect matching; our endpoints keep all, rclpy keeps 1000, so that no call is overwritten."""
    node, other = world.node("n"), world.node("other")
    other.create_parameter_client("/n")
    other.parameter_events()
    await until(lambda: len(other.get_publishers_info_by_topic("/parameter_events")) == 2)
    await until(lambda: len(node.get_subscriptions_info_by_topic("/parameter_events")) == 1)
    for info in [
        *other.get_publishers_info_by_topic("/parameter_events"),
        *node.get_subscriptions_info_by_topic("/parameter_events"),
    ]:
        assert policies(info.qos_profile) == (History.KEEP_LAST, 1000, Reliability.RELIABLE, Durability.VOLATILE)
        assert info.topic_type == "rcl_interfaces/msg/ParameterEvent"

    def endpoints() -> list[QoSProfile]:
        scope_of(other).discovery.refresh()
        found = graph_of(other).endpoints.values()
        names = {f"/n/{service}" for service in SERVICES}
        return [one.qos for one in found if one.topic_key.kind != "topic" and one.topic_key.name in names]

    await until(lambda: len(endpoints()) == 4 * len(SERVICES))  # two of each server, two of each client
    expected = (History.KEEP_ALL, 0, Reliability.RELIABLE, Durability.VOLATILE)
    assert {policies(qos) for qos in endpoints()} == {expected}


AB = "03 00 00 00  61 62 00"  # "ab" with its NUL
ONE = "01 00 00 00"
NONE = "00 00 00 00"


def wire(*parts: str) -> str:
    text = "".join(parts).replace(" ", "")
    return text + "0" * (-len(text) % 8)


async def test_bytes_of_set_parameters_and_its_event_match_ros(dds: World) -> None:
    watcher, node, remote = dds.node("watcher"), dds.node("n"), dds.node("other").create_parameter_client("/n")
    node.declare_parameter("ab", 1)
    kind = "rcl_interfaces::srv::dds_::SetParameters_"
    requests = raw_endpoints.reader(watcher, request_name("/n/set_parameters"), f"{kind}Request_").queue.items
    replies = raw_endpoints.reader(watcher, reply_name("/n/set_parameters"), f"{kind}Response_").queue.items
    kind = "rcl_interfaces::msg::dds_::ParameterEvent_"
    events = raw_endpoints.reader(watcher, "rt/parameter_events", kind).queue.items
    node.clock.enable_ros_time_override()
    node.clock.set_ros_time_override(Time(seconds=10, nanoseconds=5, clock_type=ClockType.ROS_TIME))
    sets = 0
    while not (requests and replies and events):  # until all are matched
        await remote.set({"ab": 7}, 20)
        await asyncio.sleep(0.05)
        sets += 1
    assert len(requests) <= sets and len(replies) <= sets
    # One parameter: its name ends at 11; type, bool; pad to 16; integer 7, double 0, an empty string, no arrays.
    value = ("02 00", "00" * 7, "07 00 00 00 00 00 00 00", "00" * 8, "01 00 00 00  00", "00 00 00", NONE * 5)
    request = wire(ONE, AB, "02 00", "00 00 00", *value[2:])
    # One result: successful, pad to 4, an empty reason.
    reply = wire(ONE, "01", "00 00 00", "01 00 00 00  00")
    # Stamp 0-8, node "/n" 8-15, pad to 16; no new ones; one changed: name ends at 31, pad to 40; no deleted ones.
    event = wire("0a 00 00 00  05 00 00 00", "03 00 00 00  2f 6e 00", "00", NONE, ONE, AB, *value, NONE)
    for samples, header, expected in ((requests, 20, request), (replies, 20, reply), (events, 4, event)):
        data = bytes(samples[-1][0])
        assert (data[:4].hex(), data[header:].hex()) == ("00010000", expected)


def broken(*_: object) -> Any:
    raise KeyError("gone")


@pytest.mark.parametrize(
    ("kind", "callback", "reason"),
    [
        ("pre", broken, "the pre-set callback 'broken' raised KeyError: 'gone'"),
        ("on", broken, "the on-set callback 'broken' raised KeyError: 'gone'"),
        ("pre", lambda ps: None, "'<lambda>' returned None, expected a list of Parameter objects"),
        ("on", lambda ps: "no", "returned 'no', expected a SetResult"),
        ("on", lambda ps: SetResult(False, "caf\udce9 \U0001f916"), "caf? \U0001f916"),
    ],
)
async def test_failing_set_callback_refuses_remote_sets_with_reason(
    world: World, kind: str, callback: Any, reason: str
) -> None:
    node = world.node("n")
    node.declare_parameter("a", 1)
    getattr(node, f"add_{kind}_set_callback")(callback)
    remote = world.node("other").create_parameter_client("/n")
    (first,) = await remote.set({"a": 2}, timeout_s=5)
    second = await remote.set_atomically({"a": 2}, timeout_s=5)
    assert first == second and not first.successful and reason in first.reason
    assert node.get_parameter("a", int) == 1
