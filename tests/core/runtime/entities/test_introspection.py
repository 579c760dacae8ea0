"""Service introspection: docs/internals/protocol.md 12.1."""

from __future__ import annotations

from typing import Any

import pytest
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import compile_definition, get_service
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.clocks import Clock
from rosidl_py_gen.runtime.entities.introspection import IntrospectionState
from rosidl_py_gen.runtime.time_values import ClockType, Time
from rosidl_py_gen.runtime.transport.qos import SYSTEM_DEFAULT, InvalidQoSError

pytestmark = pytest.mark.on_zenoh

AddTwoInts: Any = get_service("example_interfaces/srv/AddTwoInts")
STATE = IntrospectionState


async def exchange(world: World, client_state: IntrospectionState, server_state: IntrospectionState) -> Any:
    """Make one call; return the introspection events, the client and the server."""
    events: list[Any] = []
    world.node("listener").create_subscription(AddTwoInts.Event, "/add/_service_event", events.append, 100)
    node = world.node("n")
    server = node.create_service(AddTwoInts, "add", lambda r: AddTwoInts.Response(sum=r.a + r.b))
    caller = world.node("caller")
    client = caller.create_client(AddTwoInts, "add")
    topic = "/add/_service_event"
    await until(lambda: node.count_subscribers(topic) == caller.count_subscribers(topic) == 1)
    node.clock.enable_ros_time_override()
    node.clock.set_ros_time_override(Time(seconds=77, clock_type=ClockType.ROS_TIME))
    server.configure_introspection(node.clock, SYSTEM_DEFAULT, server_state)
    client.configure_introspection(caller.clock, SYSTEM_DEFAULT, client_state)
    assert (await client.call(AddTwoInts.Request(a=2, b=3), timeout_s=20)).sum == 5
    return events, client, server, node, caller


@pytest.mark.every_transport
async def test_introspection_contents_publish_all_four_events(world: World) -> None:
    events, *_ = await exchange(world, STATE.CONTENTS, STATE.CONTENTS)
    await until(lambda: len(events) == 4)
    by_type = {event.info.event_type: event for event in events}
    assert sorted(by_type) == [0, 1, 2, 3]
    assert len({event.info.sequence_number for event in events}) == 1
    for kind in (0, 1):
        assert [(r.a, r.b) for r in by_type[kind].request] == [(2, 3)] and by_type[kind].response == []
    for kind in (2, 3):
        assert [r.sum for r in by_type[kind].response] == [5] and by_type[kind].request == []
    gids = [bytes(by_type[kind].info.client_gid) for kind in range(4)]
    # Client and server report different client GIDs, as under rmw_cyclonedds; on Zenoh the request contains it.
    assert gids[0] == gids[3] != bytes(16) and gids[1] == gids[2] != bytes(16)
    assert (gids[0] == gids[1]) is (world.kind == "zenoh")
    assert by_type[1].info.stamp.sec == 77 and by_type[0].info.stamp.sec > 1_000_000_000


async def test_introspection_metadata_omits_contents(world: World) -> None:
    events, *_ = await exchange(world, STATE.OFF, STATE.METADATA)
    await until(lambda: len(events) == 2)
    assert [event.info.event_type for event in events] == [1, 2]
    assert all(event.request == [] and event.response == [] for event in events)


async def test_introspection_state_can_be_changed_and_switched_off(world: World) -> None:
    events, client, server, node, caller = await exchange(world, STATE.METADATA, STATE.METADATA)
    server.configure_introspection(node.clock, SYSTEM_DEFAULT, STATE.OFF)
    client.configure_introspection(caller.clock, SYSTEM_DEFAULT, STATE.CONTENTS)
    await until(lambda: len(events) == 4)
    await client.call(AddTwoInts.Request(a=1), timeout_s=5)
    await until(lambda: len(events) == 6)
    assert [len(event.request) for event in events[4:]] == [1, 0]
    client.configure_introspection(caller.clock, SYSTEM_DEFAULT, STATE.OFF)
    client.configure_introspection(caller.clock, SYSTEM_DEFAULT, STATE.OFF)
    assert (await client.call(AddTwoInts.Request(a=1), timeout_s=5)).sum == 1
    assert len(events) == 6


async def test_invalid_introspection_arguments_raise_and_change_no_state(world: World) -> None:
    events, client, server, node, _ = await exchange(world, STATE.OFF, STATE.METADATA)
    await until(lambda: len(events) == 2)
    wrong: Any
    for endpoint in (client, server):
        for wrong in (0, 1, 3, "METADATA", None, True):
            with pytest.raises(TypeError, match=r"^state must be one of IntrospectionState.OFF, .*, got "):
                endpoint.configure_introspection(node.clock, SYSTEM_DEFAULT, wrong)
        for wrong in (None, 5, "ros", ClockType.ROS_TIME):
            with pytest.raises(TypeError, match=r"^clock must be a Clock such as node.clock, got "):
                endpoint.configure_introspection(wrong, SYSTEM_DEFAULT, STATE.OFF)
    with pytest.raises(InvalidQoSError):
        client.configure_introspection(Clock(), "deep", STATE.METADATA)
    assert (await client.call(AddTwoInts.Request(a=1), timeout_s=5)).sum == 1
    await until(lambda: len(events) == 4)  # the server keeps its state
    assert all(event.request == [] for event in events)
    for endpoint in (client, server):
        endpoint.close()
        with pytest.raises(ClosedError):
            endpoint.configure_introspection(node.clock, SYSTEM_DEFAULT, STATE.METADATA)


@pytest.mark.every_transport
async def test_introspection_publisher_closes_with_its_client_or_server(world: World) -> None:
    _, client, server, node, caller = await exchange(world, STATE.CONTENTS, STATE.METADATA)
    topic = "/add/_service_event"
    await until(lambda: node.count_publishers(topic) == caller.count_publishers(topic) == 2)
    client.close()
    await until(lambda: node.count_publishers(topic) == caller.count_publishers(topic) == 1)
    server.close()
    await until(lambda: node.count_publishers(topic) == caller.count_publishers(topic) == 0)


async def test_new_introspection_clock_stamps_later_events(world: World) -> None:
    events, client, server, *_ = await exchange(world, STATE.OFF, STATE.METADATA)
    await until(lambda: len(events) == 2)
    later = Clock(system_ns=lambda: 99_000_000_000)
    server.configure_introspection(later, SYSTEM_DEFAULT, STATE.METADATA)
    await client.call(AddTwoInts.Request(a=1), timeout_s=5)
    await until(lambda: len(events) == 4)
    assert [event.info.stamp.sec for event in events] == [77, 77, 99, 99]


async def test_introspection_works_for_services_compiled_from_text(world: World) -> None:
    ask: Any = compile_definition("my_pkg/srv/Ask", "string question\n---\nint8 answer")
    events: list[Any] = []
    node = world.node("n")
    node.create_subscription(ask.Event, "/ask/_service_event", events.append, 10)
    node.create_service(ask, "ask", lambda request: ask.Response(answer=42))
    client = node.create_client(ask, "ask")
    client.configure_introspection(node.clock, SYSTEM_DEFAULT, STATE.CONTENTS)
    await client.call(ask.Request(question="?"), timeout_s=5)
    await until(lambda: len(events) == 2)
    assert events[0].request[0].question == "?" and events[1].response[0].answer == 42
