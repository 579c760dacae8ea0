"""Parts of ``rosidl-py foxglove``: the protocol, access, limits of viewers, and names that ROS refuses."""

from __future__ import annotations

import asyncio
import gc
import json
import socket
import struct
import threading
import time
from collections import deque
from time import time_ns
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from support.foxglove_viewer import foxglove_options, served, viewer
from support.inner_state import scope_of
from support.waiting import until
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rosidl_py_gen import compile_definition, encode, get_message, get_service
from rosidl_py_gen.command_support import CommandError, graph_lookup
from rosidl_py_gen.command_support.command_node import CommandNode
from rosidl_py_gen.foxglove import limits, protocol
from rosidl_py_gen.foxglove.serve import addresses
from rosidl_py_gen.foxglove.server import AdvertisedChannel, Handlers, RateLimit, Server, Viewer
from rosidl_py_gen.foxglove.services import ServiceBridge
from rosidl_py_gen.foxglove.tasks import Decoder, Worker
from rosidl_py_gen.foxglove.topics import TopicBridge
from rosidl_py_gen.runtime import CallTimeoutError

if TYPE_CHECKING:
    from support.worlds import World

    from rosidl_py_gen.runtime import Node


String: Any = get_message("std_msgs/msg/String")
Trigger: Any = get_service("std_srvs/srv/Trigger")


@pytest.mark.parametrize(
    ("error", "reported_text"),
    [(CallTimeoutError("no response from /x in 10 s"), "no response from /x"), (asyncio.CancelledError(), "is closed")],
)
async def test_reason_of_failed_call_is_sent_to_viewer(error: BaseException, reported_text: str) -> None:
    async def fail(_: bytes) -> bytes:
        raise error

    async with served() as (server, address), viewer(address) as seen:
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), fail)
        assert reported_text in str(await seen.call("/x", b""))


@pytest.mark.parametrize("name", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
async def test_server_accepts_both_subprotocol_names(name: Any) -> None:
    async with served() as (_, address), connect(address, subprotocols=[name], proxy=None) as connection:
        assert connection.subprotocol == name and "serverInfo" in str(await connection.recv())


async def test_viewer_that_never_reads_is_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_parameter_values_have_type_if_json_is_ambiguous() -> None:
    values = {"a": 1, "b": 2.0, "c": b"\1\2", "d": (1.0, float("nan")), "e": float("inf"), "f": None, "g": ("x",)}
    document = json.loads(protocol.parameter_values(values, "7"))
    assert document == {
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


def test_graph_update_contains_only_differences() -> None:
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


@pytest.mark.parametrize(("message", "reported_text"), WRONG)
def test_invalid_messages_raise_protocol_error(message: str | bytes, reported_text: str) -> None:
    with pytest.raises(protocol.ProtocolError, match=r"^Invalid message: ") as refused:
        protocol.read(message)
    assert reported_text in str(refused.value)


_GOOD = """http://localhost http://localhost:8080 https://127.0.0.1:3000 http://[::1]:8080 https://app.foxglove.dev
https://lichtblick-suite.github.io file://"""
_HOSTILE = """https://evil.example http://app.foxglove.dev https://app.foxglove.dev.evil.example
https://evil.example/https://app.foxglove.dev https://app.foxglove.dev:444 http://localhost.evil.example
http://localhost@evil.example http://user@localhost http://127.0.0.1.evil.example ftp://localhost localhost null
http://[::1 * file:///home/x.html"""
GOOD, HOSTILE = [None, *_GOOD.split()], ["", *_HOSTILE.split()]


async def visit(address: str, origin: str | None, **how: Any) -> str:
    protocols: Any = ["foxglove.sdk.v1"]
    how.setdefault("additional_headers", {} if origin is None else {"Origin": origin})
    try:
        async with connect(address, subprotocols=protocols, proxy=None, **how) as connection:
            return str(json.loads(await connection.recv())["op"])
    except InvalidStatus as refused:
        return f"{refused.response.status_code} {refused.response.body.decode()}"


async def test_connection_requires_local_known_or_permitted_origin() -> None:
    async with served() as (_, address):
        for origin in GOOD:
            assert await visit(address, origin) == "serverInfo", origin
        for origin in HOSTILE:
            assert (await visit(address, origin)).startswith(f"403 pages of {origin} must not connect"), origin
        twice = [("Origin", "http://localhost"), ("Origin", "https://evil.example")]
        assert (await visit(address, None, additional_headers=twice)).startswith("403")
    async with served(origins=["https://one.example/", "null"]) as (_, address):
        assert await visit(address, "https://one.example") == "serverInfo"
        assert await visit(address, "null") == "serverInfo"
        assert (await visit(address, "https://two.example")).startswith("403")
    async with served(origins=["*"]) as (_, address):
        assert await visit(address, "https://two.example") == "serverInfo"


async def test_connection_requires_configured_token() -> None:
    async with served(token="let me/in&é") as (_, address):
        assert await visit(f"{address}/?token=let%20me/in%26%C3%A9", None) == "serverInfo"
        right = "token=let%20me/in%26%C3%A9"
        for wrong in ("", "?token=", "?token=let", "?TOKEN=let%20me/in%26%C3%A9", f"?{right}&{right}", f"?{right}x",
                      "?" + "a=1&" * 100 + right, "?token=%ff"):  # fmt: skip
            assert (await visit(f"{address}/{wrong}", None)).startswith("401"), wrong
        assert (await visit(f"{address}/?{right}", "https://evil.example")).startswith("403")


async def test_too_large_message_disconnects_only_its_viewer() -> None:
    async with served() as (_, address), viewer(address) as good:
        for sent in (b"\1" * ((1 << 20) + 1), [b"\1" * 600_000, b"\1" * 600_000]):
            async with viewer(address) as bad:
                await bad.connection.send(sent)
                await bad.until(lambda bad=bad: not bad.is_open)
                assert bad.connection.close_code == 1009
        await good.send("subscribe", subscriptions=[{"id": 1, "channelId": 77}])
        await good.until(lambda: "Unknown channel ID: 77" in good.warnings())


async def test_rate_limit_slows_flooding_viewer_but_not_others() -> None:
    async with served(per_s=50) as (_, address), viewer(address) as good, viewer(address) as flood:
        start = time.monotonic()
        for _ in range(150):
            await flood.connection.send("{")
        await flood.send("subscribe", subscriptions=[{"id": 1, "channelId": 88}])
        await good.send("subscribe", subscriptions=[{"id": 1, "channelId": 77}])
        await good.until(lambda: "Unknown channel ID: 77" in good.warnings())
        assert "Unknown channel ID: 88" not in flood.warnings()
        await flood.until(lambda: "Unknown channel ID: 88" in flood.warnings())
        assert time.monotonic() - start > 1.8


async def test_number_of_viewers_is_limited() -> None:
    async with served() as (_, address):
        held = [connect(address, proxy=None, subprotocols=["foxglove.sdk.v1"]) for _ in range(64)]  # type: ignore[list-item]
        connections = [await one for one in held]
        assert (await visit(address, None)).startswith("503 there are 64 viewers already")
        await connections.pop().close()
        while (await visit(address, None)).startswith("503"):
            await asyncio.sleep(0.01)
        await asyncio.gather(*(one.close() for one in connections))


async def test_connection_without_valid_http_is_refused() -> None:
    async with served() as (_, address):
        host, port = address.removeprefix("ws://").split(":")
        for reported_text in (b"\0" * 100, b"GET / HTTP/1.1", b"GET /" + b"a" * 20_000, b"POST / HTTP/1.1"):
            reader, writer = await asyncio.open_connection(host, int(port))
            writer.write(reported_text + b"\r\n\r\n")
            assert not (await asyncio.wait_for(reader.read(), 10)).startswith(b"HTTP/1.1 101")
            writer.close()
        assert await visit(address, None) == "serverInfo"


async def test_large_service_responses_arrive_complete() -> None:
    async def call(data: bytes) -> bytes:
        return data * 3

    async with served() as (server, address), viewer(address) as seen:
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), call)
        for number in range(1, 20):
            data = bytes([number]) * 40_000
            assert await seen.call("/x", data, number) == data * 3
    with pytest.raises((OSError, ConnectionClosed)):
        await visit(address, None)


def test_rate_limit_permits_burst_then_steady_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("rosidl_py_gen.foxglove.server.monotonic", lambda: now)
    pace = RateLimit(10)
    assert [pace.wait_s() for _ in range(10)] == [0.0] * 10
    assert pace.wait_s() == pytest.approx(0.1)
    now += 0.1
    assert pace.wait_s() == pytest.approx(0.1)
    now += 1000
    assert [pace.wait_s() for _ in range(10)] == [0.0] * 10
    assert pace.wait_s() > 0


class _Messages:
    """A connection on which a viewer sends these messages."""

    def __init__(self, *messages: str | bytes) -> None:
        self._messages = deque(messages)
        self.is_aborted = False
        self.transport = SimpleNamespace(abort=self._abort)

    def _abort(self) -> None:
        self.is_aborted = True

    def __aiter__(self) -> _Messages:
        return self

    async def __anext__(self) -> str | bytes:
        if not self._messages:
            raise StopAsyncIteration
        return self._messages.popleft()

    async def send(self, message: Any) -> None:
        pass


class _NoPace:
    def wait_s(self) -> float:
        return 0.0


async def _nothing(*_: Any) -> dict[str, Any]:
    return {}


def _viewer(connection: Any) -> Viewer:
    server = Server(foxglove_options())
    server.handlers = Handlers(lambda: None, _nothing, _nothing, _nothing)  # type: ignore[arg-type]
    return Viewer(connection, server, 1)


# ------------------------------------------------------------------------------------------------- one message


def test_entries_of_every_message_list_are_limited() -> None:
    entries: dict[str, Any] = {"subscriptions": {"id": 1, "channelId": 1}, "channels": {}, "parameters": {"name": "x"}}
    for op, (key, _) in protocol.OPERATIONS.items():
        if key:
            text = json.dumps({"op": op, key: [entries.get(key, 7)] * (limits.MAX_ENTRIES + 1)})
            with pytest.raises(protocol.ProtocolError, match=f"got 8193 {key}, expected at most 8192"):
                protocol.read(text)


def test_oversized_message_values_are_refused_with_their_limit() -> None:
    def set_(value: str) -> str:
        return '{"op": "setParameters", "parameters": [{"name": "/x.y", "value": ' + value + "}]}"

    wrong: list[tuple[str | bytes, str]] = [
        ('{"op":"nothing","x":[' + "7," * limits.MAX_TEXT + "7]}", "characters, expected at most 1048576"),
        (set_("1" + "0" * 400), "of 401 digits, expected -2^63 to 2^63 - 1"),
        (set_("[1, -9223372036854775809]"), "expected -2^63"),
        (set_("9" * 900_000), "of 900000 digits"),
        (set_("1e400"), "beyond the range of a double"),
        (set_("[-1e400]"), "beyond the range of a double"),
        (set_("[" + "7," * limits.MAX_VALUES + "7]"), "got 16385 values in lists, expected at most 16384"),
        (json.dumps({"op": "x" * 500_000}), "there is no 'xxx"),
        (json.dumps({"op": "getParameters", "parameterNames": ["x" * 1025]}), "1025 characters, expected at most 1024"),
        (json.dumps({"op": "getParameters", "parameterNames": [], "id": "x" * 9999}), "expected at most 1024"),
        (b"\2" + struct.pack("<III", 1, 1, 4000) + b"c" * 4000, "an encoding of 4000 bytes"),
    ]
    for message, reported_text in wrong:
        with pytest.raises(protocol.ProtocolError) as refused:
            protocol.read(message)
        assert reported_text in str(refused.value) and len(str(refused.value)) < 300, message[:60]
    assert protocol.read(set_("-9223372036854775808")).what == [("/x.y", -(1 << 63))]


# --------------------------------------------------------------------------------------------- what is retained


async def test_further_refused_entries_of_a_message_are_only_counted() -> None:
    async with served() as (_, address), viewer(address) as seen:
        await seen.send("subscribe", subscriptions=[{"id": 1, "channelId": 0}] * 100)
        reported_text = await seen.handled()
    assert (
        reported_text.count("Unknown channel ID: 0") == 8
        and "92 further entries of the message are refused" in reported_text
    )


async def test_subscribed_parameters_of_a_viewer_are_limited() -> None:
    def names(tag: str, length: int = 1) -> list[str]:
        return [f"{tag}{n}" + "x" * length for n in range(5000)]

    async def warnings_after(*requests: list[str]) -> str:
        async with served() as (_, address), viewer(address) as seen:
            for names in requests:
                await seen.send("subscribeParameterUpdates", parameterNames=names)
            return await seen.handled()

    assert "would be 10000 names" in await warnings_after(names("/a."), names("/a."), names("/b."))
    most = "expected at most 8192 names with 524288 characters; an empty list follows all"
    assert most in await warnings_after(names("/a.", 110))
    assert await warnings_after([], names("/a.", 110)) == ""


async def test_definitions_of_a_viewer_are_limited_each_and_in_total() -> None:
    def channels(numbers: range, size: int) -> list[dict[str, Any]]:
        channel = {"encoding": "cdr", "schemaName": "q/msg/Q", "schema": "#" * size}
        return [{"id": number, "topic": f"/q{number}", **channel} for number in numbers]

    most, total = limits.MAX_SCHEMA_BYTES, limits.MAX_VIEWER_SCHEMA_BYTES
    full = total // most
    async with served() as (server, address), viewer(address) as seen:
        await seen.send("advertise", channels=channels(range(1), most + 1))
        assert f"its definition has {most + 1} bytes, expected at most {most}" in await seen.handled()
        assert server.offers == {}
        await seen.send("advertise", channels=channels(range(full + 2), most))
        refused = f"/q{full} cannot be published: with its definition there are {total + most} bytes"
        assert refused in await seen.handled() and len(server.offers) == full
        await seen.send("unadvertise", channelIds=[0, 0, 99])
        await seen.handled()
        assert len(server.offers) == full - 1
    async with served() as (_, address), viewer(address) as seen:
        await seen.send("advertise", channels=channels(range(100), 0))
        reported_text = await seen.handled()
    assert reported_text.count("64 topics are published already") == 8 and "28 further entries" in reported_text


async def test_number_and_size_of_pending_calls_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    async def wait(_: bytes) -> bytes:
        await asyncio.Event().wait()
        return b""

    async def send(seen: Any, number: int, size: int) -> None:
        known = await seen.until(lambda: seen.services.get("/x"))
        await seen.connection.send(struct.pack("<BIII", 2, known["id"], number, 3) + b"cdr" + bytes(size))

    async with served() as (server, address):
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), wait)
        async with viewer(address) as seen:
            for number in range(65):
                await send(seen, number, 0)
            await seen.until(lambda: "64 calls and parameter requests are in flight already" in seen.warnings())
        monkeypatch.setattr(limits, "MAX_JOB_BYTES", 1000)
        async with viewer(address) as seen:
            for number in (1, 2):  # the first is larger, but alone
                await send(seen, number, 5000)
            failed = await seen.until(lambda: seen.of("serviceCallFailure"))
            assert failed[0]["callId"] == 2 and "expected at most 1000 at a time" in failed[0]["message"]


async def test_viewer_queue_drops_oldest_messages_and_aborts_on_control_overflow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(limits, "MAX_CONTROL_BYTES", 1000)
    connection: Any = _Messages()
    one = _viewer(connection)
    channel = AdvertisedChannel({"id": 5})
    channel.watchers[one] = 7
    one.watched[7] = channel
    for number in range(50):
        channel.send(bytes([number]) * 300, number)
    assert [time_ns for _, time_ns, _ in one._messages] == [47, 48, 49]
    channel.send(bytes(5000), 50)
    assert [time_ns for _, time_ns, _ in one._messages] == [50]
    for number in range(4):
        one.send_control("x" * 400)
        assert connection.is_aborted == (number == 3)
    channel.close()
    assert one.watched == {}


async def test_number_and_length_of_warnings_are_limited() -> None:
    async with served() as (server, address), viewer(address) as seen:
        await seen.until(lambda: seen.of("serverInfo"))
        for number in range(500):
            server.send_control(f"node{number}", f"node{number}: " + "x" * 10_000)
        await seen.until(lambda: "further warnings" in seen.warnings())
        assert len(seen.of("status")) == limits.MAX_WARNINGS + 1
        assert max(len(reported_text["message"]) for reported_text in seen.of("status")) <= limits.MAX_STATUS_LENGTH


# ---------------------------------------------------------------------------------------------------- the loop


@pytest.mark.real_time("threads")
async def test_other_tasks_run_between_the_messages_of_a_viewer() -> None:
    heavy = json.dumps({"op": "unsubscribe", "subscriptionIds": [7] * 8000, "x": [7] * 200_000})
    connection: Any = _Messages(*[heavy] * 5, *["{}"] * 50)
    running = asyncio.ensure_future(_viewer(connection).run(_NoPace()))  # type: ignore[arg-type]
    turns = 0
    while not running.done():
        await asyncio.sleep(0)
        turns += 1
    assert turns >= 55


@pytest.mark.real_time("threads")
async def test_large_messages_are_decoded_in_a_thread_and_small_ones_on_the_loop() -> None:
    worker, text = Worker(), get_message("std_msgs/msg/String")
    threads = []

    def convert(message: Any) -> bytes:
        threads.append(threading.current_thread())
        return encode(message)

    for data in (b"x", b"x" * limits.MAX_INLINE):
        message: Any = text(data=data.decode())
        assert await Decoder(text).run(encode(message), worker, convert) == encode(message)
    as_json = json.dumps({"data": "y" * limits.MAX_INLINE}).encode()
    assert b"yyy" in await Decoder(text, "json").run(as_json, worker, convert)
    assert threads[0] is threading.current_thread() and threads[1] is threads[2] is not threads[0]
    assert threads[1].daemon
    worker.close()


@pytest.mark.real_time("threads")
async def test_worker_skips_cancelled_function() -> None:
    worker, go, done = Worker(), threading.Event(), []
    first = asyncio.ensure_future(worker.run(go.wait, 10))
    await asyncio.sleep(0)
    second = asyncio.ensure_future(worker.run(done.append, 2))
    await asyncio.sleep(0)
    second.cancel()
    await asyncio.wait([second])
    await asyncio.sleep(0)
    go.set()
    assert await first
    await worker.run(done.append, 3)
    assert done == [3]
    worker.close()


async def test_messages_that_would_become_many_objects_are_refused() -> None:
    line = "=" * 80
    nested = compile_definition("own_msgs/msg/Nested", f"own_msgs/Part[] x\n{line}\nMSG: own_msgs/Part\nuint8[] a\n")
    plain = compile_definition(
        "own_msgs/msg/Plain", f"own_msgs/Pair[] x\n{line}\nMSG: own_msgs/Pair\nuint8 a\nuint8 b\n"
    )
    wide = compile_definition("own_msgs/msg/Wide", f"own_msgs/Row[] x\n{line}\nMSG: own_msgs/Row\nfloat64[100000] a\n")
    names = compile_definition("own_msgs/msg/Names", "string[] x\n")
    large = b"\0\1\0\0" + struct.pack("<I", 1 << 20) + bytes(2 << 20)
    worker = Worker()
    for cls, encoding, data, reported_text in (
        (nested, "cdr", large, "a type with a sequence of strings, or of messages that vary in size"),
        (names, "cdr", large, "expected at most 1048576"),
        (plain, "json", b'{"x": [' + b"{}," * 400_000 + b"{}]}", "bytes of JSON, expected at most 1048576"),
        (wide, "json", b'{"x": [' + b"{}," * 100 + b"{}]}", "values, expected at most 1048576; use CDR"),
    ):
        with pytest.raises(CommandError) as refused:
            await Decoder(cls, encoding).run(data, worker, encode)
        assert reported_text in str(refused.value)
    assert await Decoder(plain).run(large, worker, encode) == large
    worker.close()


# ----------------------------------------------------------------------------------------------------------- the graph


def command_node_of(node: Node) -> CommandNode:
    """Return the node of a command that is an existing node."""
    command_node = object.__new__(CommandNode)
    command_node.node = node
    return command_node


async def test_topics_of_node_with_same_name_are_advertised_but_own_topics_are_not(memory: World) -> None:
    ours, namesake = memory.node("same"), memory.node("same")
    scope_of(ours).discovery.announce_delay_s = 5.0  # our endpoints are of no node yet
    async with served() as (server, _):
        topics = TopicBridge(command_node_of(ours), server, time_ns, paths=(), hidden=False)
        await asyncio.sleep(0)
        namesake.create_publisher(String, "theirs")
        ours.create_publisher(String, "ours")
        await until(lambda: {"/ours", "/theirs"} <= {*dict(ours.get_topic_names_and_types())})
        topics.refresh()
        await until(lambda: "/theirs" in {one.advertisement["topic"] for one in server.channels.values()})
        assert "/ours" not in {one.advertisement["topic"] for one in server.channels.values()}
        await topics.close()
        assert server.channels == {}


async def test_call_of_disappeared_service_fails_without_creating_client(memory: World) -> None:
    robot, ours = memory.pair()
    service = robot.create_service(Trigger, "trigger", lambda request: Trigger.Response())
    async with served() as (server, _):
        services = ServiceBridge(command_node_of(ours), server, paths=(), hidden=False)
        services.refresh()
        names = lambda: {one.advertisement["name"]: one.call for one in server.services.values()}  # noqa: E731
        await until(lambda: "/trigger" in names())
        call = names()["/trigger"]
        service.close()
        await until(lambda: ours.count_services("/trigger") == 0)
        services.refresh()
        await until(lambda: "/trigger" not in names())
        with pytest.raises(CommandError, match=r"^service /trigger has disappeared$"):
            await call(Trigger.Request().encode())
        assert ours.count_clients("/trigger") == 0
        await services.close()


async def test_compiler_is_preloaded_only_during_a_real_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, loaded, times = asyncio.get_running_loop(), asyncio.Event(), []

    def load() -> None:
        times.append(loop.time())
        loop.call_soon_threadsafe(loaded.set)

    monkeypatch.setattr(graph_lookup, "load_compiler", load)
    await graph_lookup.preload_while_waiting(asyncio.sleep(0))
    began = loop.time()
    await asyncio.wait_for(graph_lookup.preload_while_waiting(loaded.wait()), 10)
    assert [time > began for time in times] == [True]


async def test_failed_preload_of_compiler_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, failed = asyncio.get_running_loop(), asyncio.Event()

    def fail() -> None:
        loop.call_soon_threadsafe(failed.set)
        raise ImportError("broken")

    monkeypatch.setattr(graph_lookup, "load_compiler", fail)
    complaints: list[Any] = []
    loop.set_exception_handler(lambda _, context: complaints.append(context))
    await asyncio.wait_for(graph_lookup.preload_while_waiting(failed.wait()), 20)
    await loop.run_in_executor(None, print)
    for _ in range(10):
        await asyncio.sleep(0)
        gc.collect()
    assert complaints == []


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_address_contains_host_name_if_listening_on_all_interfaces(host: str) -> None:
    address, app = addresses(host, 8765, "a&b")
    assert address == f"ws://{socket.gethostname()}:8765/?token=a%26b"
    assert app.endswith("&ds.url=ws%3A%2F%2Flocalhost%3A8765%2F%3Ftoken%3Da%2526b")
