"""Bytes of the parameter services and events (docs/internals/protocol.md 5.1, 9.2 to 9.5)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from support import raw_endpoints
from support.node_fixtures import World, until
from support.raw_endpoints import reply_name, request_name

from rosidl_py_gen.runtime import (
    ClockType,
    IntRange,
    Node,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    SetResult,
    Time,
    parameter_value,
)
from rosidl_py_gen.runtime.parameters.client import ParameterClient

AB = "03 00 00 00  61 62 00"  # "ab" with its NUL
ONE = "01 00 00 00"
NONE = "00 00 00 00"


class Wiretap:
    def __init__(self, dds: World, service: str, type_name: str) -> None:
        watcher = dds.node("watcher")
        kind = f"rcl_interfaces::srv::dds_::{type_name}_"
        self._requests = raw_endpoints.reader(watcher, request_name(f"/n/{service}"), f"{kind}Request_")
        self._replies = raw_endpoints.reader(watcher, reply_name(f"/n/{service}"), f"{kind}Response_")
        self.node: Node = dds.node("n")
        self.remote: ParameterClient = dds.node("other").create_parameter_client("/n")

    async def exchange(self, call: Callable[[], Awaitable[Any]]) -> tuple[str, str, Any]:
        requests, replies, calls = self._requests.queue.items, self._replies.queue.items, 0
        while True:
            result, calls = await call(), calls + 1
            try:
                await until(lambda: bool(requests and replies), timeout_s=0.5)
            except AssertionError:
                continue  # not discovered yet; the test's own time limit ends this
            assert len(requests) <= calls and len(replies) <= calls
            return self._plain(requests[-1]), self._plain(replies[-1]), result

    @staticmethod
    def _plain(sample: Any) -> str:
        data = bytes(sample[0])
        assert data[:4].hex() == "00010000"
        return data[20:].hex()


def wire(*parts: str) -> str:
    text = "".join(parts).replace(" ", "")
    return text + "0" * (-len(text) % 8)


async def test_describe_parameters(dds: World) -> None:
    tap = Wiretap(dds, "describe_parameters", "DescribeParameters")
    tap.node.declare_parameter("ab", 3, ParameterDescriptor(description="d", integer_range=IntRange(1, 9, 2)))
    request, reply, found = await tap.exchange(lambda: tap.remote.describe(["ab"], 5))
    assert request == wire(ONE, AB)
    # Name ends at 11, type; description 12-18, pad to 20; no constraints 20-25; read_only, dynamic_typing, pad to
    # 28; no float range; one integer range, its numbers at 40 (8-byte aligned).
    assert reply == wire(
        *(ONE, AB, "02"),
        *("02 00 00 00  64 00", "00 00", "01 00 00 00  00", "00 00", "00"),
        *(NONE, ONE, NONE),
        *("01 00 00 00 00 00 00 00", "09 00 00 00 00 00 00 00", "02 00 00 00 00 00 00 00"),
    )
    assert found == [ParameterDescriptor("ab", ParameterType.INTEGER, "d", integer_range=IntRange(1, 9, 2))]


async def test_get_parameter_types(dds: World) -> None:
    tap = Wiretap(dds, "get_parameter_types", "GetParameterTypes")
    tap.node.declare_parameter("ab", 3)
    tap.node.declare_parameter("c", ["x"])
    request, reply, found = await tap.exchange(lambda: tap.remote.get_types(["ab", "c"], 5))
    assert request == wire("02 00 00 00", AB, "00", "02 00 00 00  63 00")
    assert reply == wire("02 00 00 00", "02 09")
    assert found == [ParameterType.INTEGER, ParameterType.STRING_ARRAY]


async def test_list_parameters(dds: World) -> None:
    tap = Wiretap(dds, "list_parameters", "ListParameters")
    tap.node.declare_parameter("g.b", 3)
    request, reply, found = await tap.exchange(lambda: tap.remote.list(["g"], 1, 5))
    # One prefix, which ends at 10; the depth is a uint64 at 16.
    assert request == wire(ONE, "02 00 00 00  67 00", "00 00 00 00 00 00", "01 00 00 00 00 00 00 00")
    # Names, then prefixes.
    assert reply == wire(ONE, "04 00 00 00  67 2e 62 00", ONE, "02 00 00 00  67 00")
    assert (found.names, found.prefixes) == (("g.b",), ("g",))


async def test_get_parameters(dds: World) -> None:
    tap = Wiretap(dds, "get_parameters", "GetParameters")
    tap.node.declare_parameter("ab", 0.5)
    tap.node.declare_parameter("c", ["x"])
    request, reply, found = await tap.exchange(lambda: tap.remote.get(["ab", "c"], 5))
    assert request == wire("02 00 00 00", AB, "00", "02 00 00 00  63 00")
    assert reply == wire(
        "02 00 00 00",
        # The first: type 3, bool; pad to 8; integer 0; double 0.5; string "" 24-29, pad to 32; no arrays, to 52.
        *("03 00", "00 00", "00" * 8, "00 00 00 00 00 00 e0 3f", "01 00 00 00  00", "00 00 00", NONE * 5),
        # The second: type 9, bool; pad to 56; integer 0; double 0; string "" 72-77, pad to 80; no arrays but one
        # of texts.
        *("09 00", "00 00", "00" * 16, "01 00 00 00  00", "00 00 00", NONE * 4, ONE, "02 00 00 00  78 00"),
    )
    assert found == [0.5, ("x",)]


def integer(number: str) -> str:
    return wire(AB, "02 00", "00 00 00", number, "00" * 8, "01 00 00 00  00", "00 00 00", NONE * 5)


async def test_set_parameters_atomically(dds: World) -> None:
    tap = Wiretap(dds, "set_parameters_atomically", "SetParametersAtomically")
    tap.node.declare_parameter("ab", 3)
    request, reply, found = await tap.exchange(lambda: tap.remote.set_atomically({"ab": 7}, 5))
    assert request == wire(ONE, integer("07 00 00 00 00 00 00 00"))
    # A single result: successful, pad to 4, an empty reason.
    assert reply == wire("01", "00 00 00", "01 00 00 00  00")
    assert found == SetResult(True)


async def test_a_refusal_carries_its_reason(dds: World) -> None:
    tap = Wiretap(dds, "set_parameters", "SetParameters")
    tap.node.declare_parameter("ab", 3, ParameterDescriptor(read_only=True))
    request, reply, found = await tap.exchange(lambda: tap.remote.set({"ab": -1}, 5))
    assert request == wire(ONE, integer("ff ff ff ff ff ff ff ff"))
    text = wire(
        "54 72 79 69 6e 67 20 74 6f 20 73 65 74 20 61 20",  # "Trying to set a "
        "72 65 61 64 2d 6f 6e 6c 79 20 70 61 72 61 6d 65",  # "read-only parame"
        "74 65 72 3a 20 61 62 2e",  # "ter: ab."
    )
    assert reply == wire(ONE, "00", "00 00 00", "29 00 00 00", text, "00")
    assert found == [SetResult(False, "Trying to set a read-only parameter: ab.")]
    assert tap.node.get_parameter("ab") == parameter_value(3).value


async def test_a_set_and_the_event_it_causes(dds: World) -> None:
    tap = Wiretap(dds, "set_parameters", "SetParameters")
    tap.node.declare_parameter("ab", 1)
    kind = "rcl_interfaces::msg::dds_::ParameterEvent_"
    events = raw_endpoints.reader(dds.node("event_watcher"), "rt/parameter_events", kind)
    tap.node.clock.enable_ros_time_override()
    tap.node.clock.set_ros_time_override(Time(seconds=10, nanoseconds=5, clock_type=ClockType.ROS_TIME))
    request, reply, _ = await tap.exchange(lambda: tap.remote.set({"ab": 7}, 5))
    assert request == wire(ONE, integer("07 00 00 00 00 00 00 00"))
    # One result: successful, pad to 4, an empty reason.
    assert reply == wire(ONE, "01", "00 00 00", "01 00 00 00  00")
    await until(lambda: bool(events.queue.items))
    # Stamp 0-8, node "/n" 8-15, pad to 16; no new ones; one changed: name ends at 31; type, bool; pad to 40; integer 7,
    # double 0, an empty string, no arrays; no deleted ones.
    value = ("02 00", "00" * 7, "07 00 00 00 00 00 00 00", "00" * 8, "01 00 00 00  00", "00 00 00", NONE * 5)
    expected = wire("0a 00 00 00  05 00 00 00", "03 00 00 00  2f 6e 00", "00", NONE, ONE, AB, *value, NONE)
    assert bytes(events.queue.items[0][0]).hex() == "00010000" + expected


async def test_an_unknown_parameter_gets_an_empty_response(dds: World) -> None:
    tap = Wiretap(dds, "get_parameters", "GetParameters")

    async def call() -> None:
        with pytest.raises(ParameterNotDeclaredError):
            await tap.remote.get(["use_sim_time", "nope"], 5)

    _, reply, _ = await tap.exchange(call)
    assert reply == wire(NONE)
