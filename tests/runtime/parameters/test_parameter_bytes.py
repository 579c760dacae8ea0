"""Bytes that parameters send (docs/internals/protocol.md 5.1, 9.2 to 9.5)."""

from __future__ import annotations

import pytest
from support import raw_endpoints
from support.node_fixtures import World, until
from support.raw_endpoints import reply_name, request_name

from rosidl_py_gen.runtime.parameters.values import ParameterNotDeclaredError
from rosidl_py_gen.runtime.time.values import ClockType, Time

HEADER = "00 01 00 00"


def wire(*parts: str) -> str:
    return "".join((HEADER, *parts)).replace(" ", "")


async def test_setting_one_integer_and_the_event_it_causes(dds: World) -> None:
    watcher = dds.node("watcher")
    kind = "rcl_interfaces::srv::dds_::SetParameters_"
    requests = raw_endpoints.reader(watcher, request_name("/n/set_parameters"), f"{kind}Request_")
    replies = raw_endpoints.reader(watcher, reply_name("/n/set_parameters"), f"{kind}Response_")
    node = dds.node("n")
    node.declare_parameter("ab", 1)
    remote = dds.node("other").create_parameter_client("/n")
    events = raw_endpoints.reader(watcher, "rt/parameter_events", "rcl_interfaces::msg::dds_::ParameterEvent_")
    node.clock.enable_ros_time_override()
    node.clock.set_ros_time_override(Time(seconds=10, nanoseconds=5, clock_type=ClockType.ROS_TIME))
    await remote.set({"ab": 7}, timeout_s=5)
    await until(lambda: bool(events.queue.items))
    name = "03 00 00 00  61 62 00"  # "ab" with its NUL
    empties = "00 00 00 00" * 5  # byte, bool, integer, double, string arrays
    # type 2, bool; pad to 8; integer 7; double 0; string ""; pad to 4; the arrays
    value = "02 00", "{}", "07 00 00 00 00 00 00 00", "00" * 8, "01 00 00 00  00 00 00 00", empties
    (request,) = [bytes(item[0]) for item in requests.queue.items]
    # One parameter; name ends at offset 11, so type and bool are at 11 and 12, and 3 bytes pad to 16.
    expected = wire("01 00 00 00", name, *value).format("000000")
    assert (request[:4] + request[20:]).hex() == expected
    (reply,) = [bytes(item[0]) for item in replies.queue.items]
    # One result: successful, 3 pad bytes, empty reason; and up to a multiple of four.
    assert (reply[:4] + reply[20:]).hex() == wire("01 00 00 00", "01 00 00 00", "01 00 00 00  00", "000000")
    (event,) = [bytes(item[0]) for item in events.queue.items]
    stamp = "0a 00 00 00  05 00 00 00"
    fqn = "03 00 00 00  2f 6e 00"  # "/n"
    # Stamp 0-8, node 8-15, pad to 16; no new ones; one changed: name ends at 31; type, bool; 7 pad bytes to 40;
    # no deleted ones at the end.
    head = (stamp, fqn, "00", "00 00 00 00", "01 00 00 00", name)
    assert event.hex() == wire(*head, *value).format("00" * 7) + "00000000"


async def test_asking_for_an_unknown_parameter_is_answered_with_nothing(dds: World) -> None:
    kind = "rcl_interfaces::srv::dds_::GetParameters_Response_"
    replies = raw_endpoints.reader(dds.node("watcher"), reply_name("/n/get_parameters"), kind)
    dds.node("n")
    remote = dds.node("other").create_parameter_client("/n")
    with pytest.raises(ParameterNotDeclaredError):
        await remote.get(["use_sim_time", "nope"], timeout_s=5)
    (reply,) = [bytes(item[0]) for item in replies.queue.items]
    assert (reply[:4] + reply[20:]).hex() == wire("00 00 00 00")
