"""Limits for viewers of ``rosidl-py foxglove``: entries, sizes, what is retained, and how long the loop is occupied."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from collections import deque
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from support.foxglove_viewer import served, viewer

from rosidl_py_gen import compile_definition, encode, get_message
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.foxglove import limits, protocol
from rosidl_py_gen.ros_cli.foxglove.decoding import Decoder, Worker
from rosidl_py_gen.ros_cli.foxglove.protocol import ClientAdvertisement
from rosidl_py_gen.ros_cli.foxglove.publishing import ClientPublishing
from rosidl_py_gen.ros_cli.foxglove.viewer import AdvertisedChannel, Handlers, ServerState, Viewer

if TYPE_CHECKING:
    from support.node_fixtures import World


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


def _viewer(connection: Any, shown: ServerState | None = None, queue: int = 256) -> Viewer:
    handlers = Handlers(lambda: None, _nothing, _nothing, _nothing)  # type: ignore[arg-type]
    return Viewer(connection, 1, shown or ServerState(), handlers, queue, may_publish=True)


async def _statuses(*messages: dict[str, Any], shown: ServerState | None = None) -> tuple[Viewer, str]:
    """Return a viewer that has sent these messages, and the statuses it got."""
    connection: Any = _Messages()
    one = _viewer(connection, shown)
    for message in messages:
        await one._handle(json.dumps(message), _NoPace())  # type: ignore[arg-type]
    told = [json.loads(text) for text in one._control if isinstance(text, str)]
    return one, "\n".join(said["message"] for said in told if said["op"] == "status")


# ------------------------------------------------------------------------------------------------- one message


def test_every_list_of_a_message_has_a_limit_of_entries() -> None:
    entries: dict[str, Any] = {"subscriptions": {"id": 1, "channelId": 1}, "channels": {}, "parameters": {"name": "x"}}
    for op, (key, _) in protocol._READ.items():
        if key:
            text = json.dumps({"op": op, key: [entries.get(key, 7)] * (limits.MAX_ENTRIES + 1)})
            with pytest.raises(protocol.ProtocolError, match=f"got 8193 {key}, expected at most 8192"):
                protocol.read(text)


def test_large_and_odd_texts_are_refused_with_the_limit() -> None:
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
    for message, said in wrong:
        with pytest.raises(protocol.ProtocolError) as refused:
            protocol.read(message)
        assert said in str(refused.value) and len(str(refused.value)) < 300, message[:60]
    assert protocol.read(set_("-9223372036854775808")).what == [("/x.y", -(1 << 63))]


async def test_refused_entries_of_one_message_are_counted() -> None:
    one, said = await _statuses({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 0}] * 100})
    assert said.count("Unknown channel ID: 0") == 8 and "92 further entries of the message are refused" in said
    assert one.watched == {}


# --------------------------------------------------------------------------------------------- what is retained


async def test_a_viewer_follows_so_many_parameters_and_no_more() -> None:
    def names(tag: str, length: int = 1) -> dict[str, Any]:
        return {"op": "subscribeParameterUpdates", "parameterNames": [f"{tag}{n}" + "x" * length for n in range(5000)]}

    one, said = await _statuses(names("/a."), names("/a."), names("/b."))
    assert "would be 10000 names" in said and len(one.followed or ()) == 5000
    one, said = await _statuses(names("/a.", 110))
    assert "expected at most 8192 names with 524288 characters; an empty list follows all" in said
    assert one.followed == set()
    one, said = await _statuses({"op": "subscribeParameterUpdates", "parameterNames": []}, names("/a."))
    assert one.followed is None and said == ""


async def test_definitions_of_a_viewer_have_limits_each_and_in_total() -> None:
    def channel(number: int, size: int) -> dict[str, Any]:
        return {"id": number, "topic": f"/q{number}", "encoding": "cdr", "schemaName": "q/msg/Q", "schema": "#" * size}

    most = limits.MAX_SCHEMA_BYTES
    shown = ServerState()
    _, said = await _statuses({"op": "advertise", "channels": [channel(1, most + 1)]}, shown=shown)
    assert f"its definition has {most + 1} bytes, expected at most {most}" in said and shown.offers == {}
    full, total = limits.MAX_VIEWER_SCHEMA_BYTES // most, limits.MAX_VIEWER_SCHEMA_BYTES
    channels = [channel(number, most) for number in range(full + 2)]
    one, said = await _statuses({"op": "advertise", "channels": channels}, shown=shown)
    refused = f"/q{full} cannot be published: with its definition there are {total + most} bytes"
    assert refused in said and len(shown.offers) == full
    await one._handle('{"op": "unadvertise", "channelIds": [0, 0, 99]}', _NoPace())  # type: ignore[arg-type]
    assert len(shown.offers) == full - 1
    many = [channel(number, 0) for number in range(100)]
    _, said = await _statuses({"op": "advertise", "channels": many})
    assert said.count("64 topics are published already") == 8 and "28 further entries" in said


async def test_definitions_of_all_viewers_have_a_limit_and_equal_ones_count_once(memory: World) -> None:
    told: Any = SimpleNamespace(offers={}, send_control=lambda *_: None)
    publisher = ClientPublishing(SimpleNamespace(node=memory.node()), told, paths=())  # type: ignore[arg-type]
    comments = "#" * 500_000
    one, same = [await publisher._compile("own_msgs/msg/One", f"int8 x\n{comments}".encode()) for _ in range(2)]
    assert one is same
    await publisher._compile("own_msgs/msg/Two", f"int8 y\n{comments}".encode())
    with pytest.raises(CommandError, match=r"3 \(1500021 bytes\); expected at most 256 \(1048576 bytes\)"):
        await publisher._compile("own_msgs/msg/Three", f"int8 z\n{comments}".encode())
    await publisher.close()


async def test_messages_that_wait_for_their_type_have_a_limit_for_all_topics(memory: World) -> None:
    warnings: list[str] = []
    offers = {(1, n): ClientAdvertisement(f"/q{n}", "cdr", "nobody/msg/Knows", "", b"") for n in range(4)}
    told: Any = SimpleNamespace(offers=offers, send_control=lambda _, text: warnings.append(text))
    command_node: Any = SimpleNamespace(node=memory.node())
    publisher = ClientPublishing(command_node, told, paths=())
    for key in offers:
        await publisher.publish_from_viewer(key, bytes(400_000))
    waiting = [len(one.waiting) for one in publisher._publishers.values()]
    assert waiting == [1, 1, 0, 0] and "messages for /q2 are dropped" in "".join(warnings)
    await publisher.close()


async def test_pending_calls_have_a_limit_of_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_JOB_BYTES", 1000)
    never = asyncio.Event()

    async def wait(_: bytes) -> bytes:
        await never.wait()
        return b""

    async with served() as (server, address), viewer(address) as seen:
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), wait)
        known = await seen.until(lambda: seen.services.get("/x"))
        for number in (1, 2):  # the first is larger, but alone
            await seen.connection.send(struct.pack("<BIII", 2, known["id"], number, 3) + b"cdr" + bytes(5000))
        failed = await seen.until(lambda: seen.of("serviceCallFailure"))
        assert failed[0]["callId"] == 2 and "expected at most 1000 at a time" in failed[0]["message"]


async def test_what_waits_for_a_viewer_has_a_limit_of_size(monkeypatch: pytest.MonkeyPatch) -> None:
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


async def test_warnings_to_all_viewers_have_a_limit() -> None:
    async with served() as (server, address), viewer(address) as seen:
        await seen.until(lambda: seen.of("serverInfo"))
        for number in range(500):
            server.send_control(f"node{number}", f"node{number}: " + "x" * 10_000)
        await seen.until(lambda: "further warnings" in seen.warnings())
        assert len(seen.of("status")) == limits.MAX_WARNINGS + 1
        assert max(len(said["message"]) for said in seen.of("status")) <= limits.MAX_STATUS_LENGTH


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
async def test_a_cancelled_function_is_skipped_by_the_worker() -> None:
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
    for cls, encoding, data, said in (
        (nested, "cdr", large, "a type with a sequence of strings, or of messages that vary in size"),
        (names, "cdr", large, "expected at most 1048576"),
        (plain, "json", b'{"x": [' + b"{}," * 400_000 + b"{}]}", "bytes of JSON, expected at most 1048576"),
        (wide, "json", b'{"x": [' + b"{}," * 100 + b"{}]}", "values, expected at most 1048576; use CDR"),
    ):
        with pytest.raises(CommandError) as refused:
            await Decoder(cls, encoding).run(data, worker, encode)
        assert said in str(refused.value)
    assert await Decoder(plain).run(large, worker, encode) == large
    worker.close()
