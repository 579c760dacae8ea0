"""Services and clients on every transport."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_srvs.srv import Empty, SetBool
from support.inner_state import graph_of, transport_end_of
from support.waiting import until

from rosidl_py_gen import type_hash
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import CallTimeoutError, TransportError, WaitTimeoutError
from rosidl_py_gen.runtime.entities import services
from rosidl_py_gen.runtime.entities.services import AlreadyRespondedError, ServiceRequest
from rosidl_py_gen.runtime.transport.dds.services import add_request_header
from rosidl_py_gen.runtime.transport.flow_control import TimeoutTable

if TYPE_CHECKING:
    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

Request, Response = AddTwoInts.Request, AddTwoInts.Response


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return Response(sum=request.a + request.b)


async def add_slowly(request: AddTwoInts.Request) -> AddTwoInts.Response:
    """Reply faster to bigger numbers, so that responses arrive in another order than the requests."""
    await asyncio.sleep(0.05 - request.a * 0.001)  # simulates work; the duration does not matter
    return add(request)


@pytest.mark.parametrize("late_s", [3.0, 8.0])
async def test_response_is_delayed_until_client_reader_is_matched(
    memory: World, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, late_s: float
) -> None:
    alice, bob = memory.pair()
    server: Any = alice.create_service(AddTwoInts, "add", add)
    client = bob.create_client(AddTwoInts, "add")
    time_s = asyncio.get_running_loop().time
    reachable_s = time_s() + late_s
    monkeypatch.setattr(transport_end_of(server), "can_reach_client", lambda _: time_s() >= reachable_s)
    call = client.call(Request(a=1, b=2), timeout_s=10)
    if late_s < 5:
        assert (await call).sum == 3 and time_s() >= reachable_s and not caplog.records
        return
    with pytest.raises(CallTimeoutError):
        await call
    assert "dropped a response of /add: its client's reader never appeared" in caplog.text


@pytest.mark.every_transport
async def test_each_of_many_parallel_calls_receives_its_own_response(world: World) -> None:
    alice, bob = world.pair()
    alice.create_service(AddTwoInts, "add", add_slowly)
    clients = [bob.create_client(AddTwoInts, "add") for _ in range(3)]
    calls = [clients[i % 3].call(Request(a=i % 50, b=1000 * i), timeout_s=10) for i in range(300)]
    assert [response.sum for response in await asyncio.gather(*calls)] == [i % 50 + 1000 * i for i in range(300)]
    assert [client.in_flight_count for client in clients] == [0, 0, 0]


@pytest.mark.every_transport
async def test_requests_can_be_answered_out_of_order_from_another_task(world: World) -> None:
    alice, bob = world.pair()
    server = alice.create_service(AddTwoInts, "add")
    waiting: list[ServiceRequest[AddTwoInts.Request, AddTwoInts.Response]] = []

    async def collect() -> None:
        async for request in server:
            waiting.append(request)

    collecting = asyncio.create_task(collect())
    client = bob.create_client(AddTwoInts, "add")
    calls = [asyncio.create_task(client.call(Request(a=i), timeout_s=20)) for i in range(3)]
    while len(waiting) < 3:
        await asyncio.sleep(0.01)
    for request in reversed(waiting):
        request.respond(add(request.message))
    assert [response.sum for response in await asyncio.gather(*calls)] == [0, 1, 2]
    with pytest.raises(AlreadyRespondedError):
        waiting[0].respond(Response())
    server.close()
    await asyncio.wait_for(collecting, 10)


async def test_delayed_replies_are_sent_when_their_server_closes(memory: World, monkeypatch: Any) -> None:
    server, client = memory.node().create_service(AddTwoInts, "add"), memory.node().create_client(AddTwoInts, "add")
    transport_server, is_released = transport_end_of(server), False

    def release() -> None:
        nonlocal is_released
        is_released = True

    send = transport_server.send
    monkeypatch.setattr(transport_server, "release", release)
    monkeypatch.setattr(transport_server, "send", lambda to, data: is_released and send(to, data))
    await client.wait_for_service(timeout_s=5)
    call = asyncio.ensure_future(client.call(AddTwoInts.Request(), timeout_s=5))
    (await anext(server)).respond(AddTwoInts.Response(sum=7))
    server.close()
    assert (await call).sum == 7


async def test_call_that_cannot_be_sent_leaves_no_timeout(memory: World, monkeypatch: Any) -> None:
    alice, bob = memory.pair()
    alice.create_service(AddTwoInts, "add", add)
    client = bob.create_client(AddTwoInts, "add")
    await client.wait_for_service(timeout_s=5)

    def refuse(*_: object) -> None:
        raise TransportError("no memory")

    timeouts: list[float] = []

    class RecordingTable(TimeoutTable[Any]):
        def add(self, operation: Any, timeout_s: float) -> None:
            timeouts.append(timeout_s)
            super().add(operation, timeout_s)

    monkeypatch.setattr(services, "TimeoutTable", RecordingTable)

    with monkeypatch.context() as patched:
        patched.setattr(transport_end_of(client), "send", refuse)
        with pytest.raises(TransportError, match="no memory"):
            await client.call(Request(), timeout_s=60)
    assert timeouts == [] and client.in_flight_count == 0
    assert (await client.call(Request(a=1, b=2), timeout_s=60)).sum == 3
    assert timeouts == [60]


async def test_a_call_without_server_times_out(world: World) -> None:
    _, bob = world.pair()
    client = bob.create_client(AddTwoInts, "nobody")
    assert not client.service_is_available()
    with pytest.raises(WaitTimeoutError, match=r"no server of /nobody \(.*AddTwoInts\) appeared in 0.05 s"):
        await client.wait_for_service(timeout_s=0.05)
    with pytest.raises(CallTimeoutError, match="/nobody"):
        await client.call(Request(), timeout_s=0.1)


def test_call_timeout_is_measured_on_the_loop_that_made_the_call(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    alice, bob = world.pair()
    alice.create_service(AddTwoInts, "silent")  # never answers
    client = bob.create_client(AddTwoInts, "silent")
    loop = asyncio.new_event_loop()

    async def begin() -> asyncio.Task[AddTwoInts.Response]:
        assert await client.wait_for_service(timeout_s=20)
        return asyncio.create_task(client.call(Request(), timeout_s=60))

    async def end(call: asyncio.Task[AddTwoInts.Response]) -> None:
        await asyncio.wait((call,), timeout=60)

    call = loop.run_until_complete(begin())
    loop.run_until_complete(until(lambda: client.in_flight_count == 1))
    with pytest.raises(CallTimeoutError, match=r"/silent .*in 0\.05 s"):  # on a separate loop
        client.call_sync(Request(), timeout_s=0.05)
    assert client.in_flight_count == 1
    now = loop.time
    monkeypatch.setattr(loop, "time", lambda: now() + 60)
    loop.run_until_complete(end(call))
    assert isinstance(call.exception(), CallTimeoutError)
    assert client.in_flight_count == 0
    loop.close()


@pytest.mark.parametrize("held_up_s", [0, 0.3])
async def test_calls_time_out_in_order_of_their_timeouts(
    world: World, monkeypatch: pytest.MonkeyPatch, held_up_s: float
) -> None:
    _, client = await world.served(AddTwoInts, "silent")
    ended: list[float] = []

    async def call(limit_s: float) -> None:
        with pytest.raises(CallTimeoutError, match=f"in {limit_s} s"):
            await client.call(Request(), timeout_s=limit_s)
        ended.append(limit_s)

    loop = asyncio.get_running_loop()
    loop.call_later(0.01, time.sleep, held_up_s)
    now_s, now_ns = loop.time(), time.monotonic_ns()
    with monkeypatch.context() as stopped:  # all start at the same time
        stopped.setattr(loop, "time", lambda: now_s)
        stopped.setattr(time, "monotonic_ns", lambda: now_ns)
        calls = [asyncio.ensure_future(call(limit_s)) for limit_s in (0.2, 0.05, 0, 0.1)]
        await asyncio.sleep(0)
    await asyncio.gather(*calls)
    assert ended == [0, 0.05, 0.1, 0.2]


@pytest.mark.every_transport
async def test_pending_calls_are_freed_by_timeout_cancellation_and_close(world: World) -> None:
    _, client = await world.served(AddTwoInts, "silent")
    with pytest.raises(TimeoutError):
        await client.call(Request(), timeout_s=0.05)
    assert client.in_flight_count == 0
    cancelled = asyncio.create_task(client.call(Request()))
    closed = asyncio.create_task(client.call(Request()))
    await until(lambda: client.in_flight_count == 2)
    cancelled.cancel()
    await asyncio.gather(cancelled, return_exceptions=True)
    assert client.in_flight_count == 1
    client.close()
    with pytest.raises(ClosedError, match="/silent"):
        await closed
    assert client.in_flight_count == 0
    with pytest.raises(ClosedError):
        await client.call(Request())


async def test_late_and_foreign_replies_are_ignored(dds: World, caplog: pytest.LogCaptureFixture) -> None:
    alice, bob = dds.pair()
    server = alice.create_service(AddTwoInts, "add")
    client = bob.create_client(AddTwoInts, "add")
    task = asyncio.create_task(anext(aiter(server)))
    first = asyncio.create_task(client.call(Request(), timeout_s=20))
    (await task).respond(Response())  # from here on requests are sent at once
    await first
    with pytest.raises(CallTimeoutError):
        task = asyncio.create_task(anext(aiter(server)))
        await client.call(Request(a=1), timeout_s=0.2)
    (await task).respond(Response(sum=1))  # late
    task = asyncio.create_task(anext(aiter(server)))
    call = asyncio.create_task(client.call(Request(a=3), timeout_s=20))
    request = await task
    number = request.info.sequence_number
    replies: Any = transport_end_of(server)
    replies._writer.write(add_request_header(Response(sum=2).encode(), 12345, number))  # of another client
    replies._writer.write(b"\0\1\0\0\7\7\7\7")  # nonsense
    request.respond(Response(sum=3))
    assert (await call).sum == 3 and "failed" not in caplog.text


async def test_a_service_can_be_called_inside_callbacks(world: World) -> None:
    alice, bob = world.pair()
    alice.create_service(AddTwoInts, "add", add)
    client = bob.create_client(AddTwoInts, "add")
    results: asyncio.Queue[int] = asyncio.Queue()

    async def through(request: SetBool.Request) -> SetBool.Response:
        response = await client.call(Request(a=20, b=22), timeout_s=5)
        results.put_nowait(response.sum)
        return SetBool.Response(success=request.data)

    bob.create_service(SetBool, "chain", through)
    chain = alice.create_client(SetBool, "chain")
    assert (await chain.call(SetBool.Request(data=True), timeout_s=5)).success
    assert await results.get() == 42
    assert (await asyncio.to_thread(client.call_sync, Request(a=1, b=1), 5)).sum == 2


@pytest.mark.every_transport
async def test_service_named_by_text_uses_dicts(world: World) -> None:
    alice, bob = world.pair()
    alice.create_service("example_interfaces/srv/AddTwoInts", "add", lambda request: {"sum": request["a"]})
    client = bob.create_client("example_interfaces/srv/AddTwoInts", "add")
    assert await client.call({"a": 5}, timeout_s=20) == {"sum": 5}


@pytest.mark.every_transport
async def test_empty_requests_and_responses_work(world: World) -> None:
    alice, bob = world.pair()
    alice.create_service(Empty, "reset", lambda request: Empty.Response())
    assert await bob.create_client(Empty, "reset").call(Empty.Request(), timeout_s=20) == Empty.Response()


@pytest.mark.every_transport
async def test_call_waits_for_a_server_created_later(world: World) -> None:
    alice, bob = world.pair()
    client = bob.create_client(AddTwoInts, "add")
    waiting = asyncio.create_task(client.call(Request(a=1, b=2), timeout_s=20))
    await asyncio.sleep(0)  # the call is waiting now
    server = alice.create_service(AddTwoInts, "add", add)
    assert (await waiting).sum == 3
    server.close()
    await until(lambda: not client.service_is_available())
    alice.create_service(AddTwoInts, "add", add)
    assert (await client.call(Request(a=1, b=2), timeout_s=20)).sum == 3


@pytest.mark.every_transport
@pytest.mark.without_zenoh("there clients and servers announce their service, not its messages")
async def test_service_endpoints_announce_service_id_and_type_hashes(world: World) -> None:
    alice, bob = world.pair()
    server = alice.create_service(AddTwoInts, "add", add)
    client = bob.create_client(AddTwoInts, "add")
    assert await client.wait_for_service(timeout_s=20)
    graph = graph_of(bob)
    await until(
        lambda: graph.endpoints.keys() >= {*transport_end_of(server).endpoints, *transport_end_of(client).endpoints}
    )
    reads, writes = (graph.endpoints[guid] for guid in transport_end_of(server).endpoints)
    assert reads.service_id == writes.service_id != ""
    assert reads.type_hash == type_hash(AddTwoInts.Request)
    assert writes.type_hash == type_hash(AddTwoInts.Response)
    own = {graph.endpoints[guid].service_id for guid in transport_end_of(client).endpoints}
    assert len(own) == 1 and own.isdisjoint({"", reads.service_id})
