"""The server of ``rosidl-py foxglove`` without the rest of the command."""

from __future__ import annotations

import asyncio
import json
import struct
from contextlib import suppress
from typing import Any

import pytest
from support.foxglove_viewer import served, viewer
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from rosidl_py_gen.ros_cli.foxglove import limits, protocol
from rosidl_py_gen.runtime import CallTimeoutError


@pytest.mark.parametrize(
    ("error", "said"),
    [(CallTimeoutError("no response from /x in 10 s"), "no response from /x"), (asyncio.CancelledError(), "is closed")],
)
async def test_why_a_call_failed_is_told(error: BaseException, said: str) -> None:
    async def fail(_: bytes) -> bytes:
        raise error

    async with served() as (server, address), viewer(address) as seen:
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), fail)
        assert said in str(await seen.call("/x", b""))


@pytest.mark.parametrize("name", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
async def test_both_names_of_the_protocol_are_known(name: Any) -> None:
    async with served() as (_, address), connect(address, subprotocols=[name], proxy=None) as connection:
        assert connection.subprotocol == name and "serverInfo" in str(await connection.recv())


async def test_who_has_too_many_questions_is_told() -> None:
    never = asyncio.Event()

    async def wait(_: bytes) -> bytes:
        await never.wait()
        return b""

    async with served() as (server, address), viewer(address) as seen:
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), wait)
        known = await seen.until(lambda: seen.services.get("/x"))
        for number in range(65):
            await seen.connection.send(struct.pack("<BIII", 2, known["id"], number, 3) + b"cdr")
        await seen.until(lambda: "64 calls and parameter requests are in flight already" in seen.warnings())


async def test_who_takes_nothing_of_what_it_is_told_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_CONTROL_MESSAGES", 100)
    protocols: Any = ["foxglove.sdk.v1"]
    async with (
        served() as (server, address),
        viewer(address) as good,
        connect(address, subprotocols=protocols, proxy=None, max_queue=1) as deaf,
    ):
        for number in range(3000):
            server.open_channel(f"/topic{number}", "std_msgs/msg/String", "string data\n" * 1000)
            await good.until(lambda known=number: f"/topic{known}" in good.channels)
        with pytest.raises(ConnectionClosed):
            while True:
                await asyncio.wait_for(deaf.recv(), 10)
        assert good.is_open


# --------------------------------------------------------------------------------------------------------- the protocol


def test_values_say_their_type_where_json_does_not() -> None:
    values = {"a": 1, "b": 2.0, "c": b"\1\2", "d": (1.0, float("nan")), "e": float("inf"), "f": None, "g": ("x",)}
    told = json.loads(protocol.parameter_values(values, "7"))
    assert told == {
        "op": "parameterValues",
        "id": "7",
        "parameters": [
            {"name": "a", "value": 1},
            {"name": "b", "type": "float64", "value": 2.0},
            {"name": "c", "type": "byte_array", "value": "AQI="},
            {"name": "d", "type": "float64_array", "value": [1.0, None]},
            {"name": "e", "type": "float64", "value": None},
            {"name": "g", "value": ["x"]},
        ],
    }


def test_of_a_graph_the_difference_is_told() -> None:
    before: protocol.Graph = {"/a": ["/x"], "/b": ["/x"]}, {"/b": ["/y"]}, {"/s": ["/x"]}
    now: protocol.Graph = {"/a": ["/x", "/z"]}, {"/b": ["/y"]}, {}
    assert json.loads(protocol.graph_update(before, now)) == {
        "op": "connectionGraphUpdate",
        "publishedTopics": [{"name": "/a", "publisherIds": ["/x", "/z"]}, {"name": "/b", "publisherIds": []}],
        "subscribedTopics": [],
        "advertisedServices": [{"name": "/s", "providerIds": []}],
        "removedTopics": [],
        "removedServices": ["/s"],
    }


WRONG = [
    ("{", "Expecting property name"),
    ("[]", "list indices"),
    ('{"op": "nothing"}', "there is no 'nothing'"),
    ('{"op": "subscribe"}', "there is no 'subscriptions'"),
    ('{"op": "subscribe", "subscriptions": [{"id": true, "channelId": 1}]}', "expected a number"),
    ('{"op": "unsubscribe", "subscriptionIds": [4294967296]}', "from 0 to 4294967295"),
    ('{"op": "setParameters", "parameters": [{"name": "x", "value": NaN}]}', "NaN is not a number of JSON"),
    ('{"op": "setParameters", "parameters": [{"name": "x", "value": {"a": 1}}]}', "not {'a': 1}"),
    ('{"op": "setParameters", "parameters": [{"name": "x", "value": "!", "type": "byte_array"}]}', "is not base64"),
    ("[" * 100_000, "Invalid message"),
    (b"", "Invalid message"),
    (b"\x07", "no opcode 7"),
    (b"\1\0", "Invalid message"),
    (b"\2" + bytes(8) + b"\1\0\0\0\xff", "Invalid message"),
]


def test_what_is_odd_is_read_or_refused() -> None:
    odd: list[Any] = [None, 1, -1, 1 << 32, 1.5, True, "", "\ud800", [], {}, [[]], {"id": 1}, {"name": "x"}]
    odd += [{"id": 1, "channelId": value} for value in odd] + [{"name": "x", "value": value} for value in odd]
    odd += [{"name": "x", "type": "byte_array", "value": value} for value in odd]
    keys = (
        "subscriptions subscriptionIds channels channelIds parameterNames parameters uri id topic encoding schemaName"
    )
    for op in protocol._READ:
        for value in odd:
            for wrapped in (value, [value]):
                with suppress(protocol.ProtocolError):
                    protocol.read(json.dumps({"op": op, **dict.fromkeys(keys.split(), wrapped)}))


@pytest.mark.parametrize(("message", "said"), WRONG)
def test_what_is_no_message_is_refused(message: str | bytes, said: str) -> None:
    with pytest.raises(protocol.ProtocolError, match=r"^Invalid message: ") as refused:
        protocol.read(message)
    assert said in str(refused.value)
