"""Blocking calls in threads, several loops in sequence, and bursts of calls."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String
from std_srvs.srv import SetBool
from support.inner_state import participant_of
from support.waiting import until, wait_until

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import CallTimeoutError, WaitTimeoutError
from rosidl_py_gen.runtime.loop.event_loop import end_tasks
from rosidl_py_gen.runtime.node.context import core_of
from rosidl_py_gen.runtime.transport.dds.discovery_info import DISCOVERY_TOPIC
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World

    from rosidl_py_gen.runtime import Node

pytestmark = pytest.mark.on_zenoh


def is_loop_running(node: Node) -> bool:
    shared = core_of(node.context).loop_binding.shared
    return shared is not None and shared.loop.is_running()


@contextlib.contextmanager
def blocking_call(client: Any) -> Iterator[None]:
    with ThreadPoolExecutor() as pool:
        call = pool.submit(client.call_sync, SetBool.Request(), timeout_s=60)
        yield
        client.close()
        with pytest.raises(ClosedError):
            call.result(10)


@pytest.mark.every_transport
def test_blocking_calls_of_several_threads_wait_in_parallel_without_a_loop(world: World) -> None:
    server, caller = world.pair()
    stop, serving = threading.Event(), threading.Event()
    arrived: list[int] = []

    async def serve() -> None:
        async def handler(request: AddTwoInts.Request) -> AddTwoInts.Response:
            arrived.append(request.a)
            await until(lambda: request.a == 0 or {1, 2, 3} <= {*arrived}, 60)  # all three are waited for at once
            if request.a == 4:
                await asyncio.Event().wait()
            return AddTwoInts.Response(sum=request.a)

        server.create_service(AddTwoInts, "slow", handler)
        serving.set()
        while not stop.is_set():
            await asyncio.sleep(0.01)

    client = caller.create_client(AddTwoInts, "slow")

    def call(number: int, timeout_s: float) -> int:
        return int(client.call_sync(AddTwoInts.Request(a=number), timeout_s).sum)

    with ThreadPoolExecutor(5) as pool:
        pool.submit(asyncio.run, serve())
        assert serving.wait(20)
        assert call(0, 20) == 0  # the first call makes the private loop
        *calls, late = [pool.submit(call, *args) for args in ((1, 30), (2, 30), (3, 30), (4, 0.3))]
        assert [one.result(40) for one in calls] == [1, 2, 3]
        with pytest.raises(CallTimeoutError):
            late.result(40)
        stop.set()


@pytest.mark.every_transport
def test_message_published_between_two_loops_does_not_stop_delivery(world: World) -> None:
    node = world.node("both")
    client = node.create_client(SetBool, "set")
    with pytest.raises(CallTimeoutError):
        client.call_sync(SetBool.Request(), timeout_s=0.05)
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    publisher.publish(String(data="between"))

    async def main() -> None:
        node.create_service(SetBool, "set", lambda request: SetBool.Response(success=True))
        assert (await client.call(SetBool.Request(), timeout_s=10)).success
        assert (await subscription.receive(timeout_s=10)).data == "between"

    asyncio.run(main())


@pytest.mark.every_transport
def test_client_can_be_used_on_consecutive_loops(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    # Server with a short request queue, as on rmw_cyclonedds.
    from rosidl_py_gen.runtime.entities import services

    server, caller = world.pair()
    client = caller.create_client(AddTwoInts, "add")
    monkeypatch.setattr(services, "service_endpoint_qos", lambda qos: SERVICES_DEFAULT.keep_last(5))

    async def burst() -> None:
        made = server.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a))
        calls = (client.call(AddTwoInts.Request(a=number), timeout_s=20) for number in range(40))
        assert [answer.sum for answer in await asyncio.gather(*calls)] == list(range(40))
        assert client.in_flight_count == 0
        made.close()
        await until(lambda: not client.service_is_available())

    asyncio.run(burst())
    asyncio.run(burst())


@pytest.mark.every_transport
def test_publishing_on_a_loop_attaches_the_node_to_it(world: World) -> None:
    node = world.node("early")
    received: list[str] = []
    ticked: list[int] = []
    node.create_subscription(String, "t", lambda message: received.append(message.data))
    node.create_timer(0.01, lambda: ticked.append(1))
    publisher = node.create_publisher(String, "t")

    async def main() -> None:
        publisher.publish(String(data="x"))
        await until(lambda: received and ticked)

    asyncio.run(main())
    received.clear()
    asyncio.run(main())  # and again on the next loop


def test_plain_script_discovers_nodes_of_other_contexts_in_its_process(dds: World) -> None:
    one, other = dds.node("one"), dds.node("other")
    deadline = time.monotonic() + 20
    while set(one.get_node_names()) != {"/one", "/other"}:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    while set(other.get_node_names()) != {"/one", "/other"}:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    for number in range(50):
        other.create_publisher(String, f"t{number}")
    one.get_node_names()
    participant: Any = participant_of(one)
    assert [len(reader.queue.items) for reader in participant.readers.values() if reader.topic == DISCOVERY_TOPIC] == [
        0
    ]


@pytest.mark.every_transport
def test_blocking_calls_of_several_threads_can_alternate(world: World) -> None:
    client = world.node("caller").create_client(SetBool, "s")

    def calls(times: int) -> None:
        for _ in range(times):
            with pytest.raises(CallTimeoutError):
                client.call_sync(SetBool.Request(), timeout_s=0.02)

    calls(1)
    with ThreadPoolExecutor(4) as pool:
        others = [pool.submit(calls, 10) for _ in range(4)]
        calls(10)
        for other in others:
            other.result(60)


@pytest.mark.every_transport
@pytest.mark.parametrize("style", ["paused", "ended"])
def test_blocking_call_raises_closed_error_when_its_loop_stops(world: World, style: str) -> None:
    client = world.node("caller").create_client(SetBool, "s")
    loop = asyncio.new_event_loop()

    async def begin() -> Future[Any]:
        with pytest.raises(WaitTimeoutError):
            await client.wait_for_service(timeout_s=0.01)  # attaches the loop
        call = pool.submit(client.call_sync, SetBool.Request(), timeout_s=30)
        await until(lambda: len(asyncio.all_tasks()) == 2)  # this one and the call
        return call

    with ThreadPoolExecutor() as pool:
        call = asyncio.run(begin()) if style == "ended" else loop.run_until_complete(begin())
        with pytest.raises(ClosedError):
            call.result(20)
    with pytest.raises(CallTimeoutError):
        client.call_sync(SetBool.Request(), timeout_s=0.05)
    end_tasks(loop)
    loop.close()


@pytest.mark.every_transport
def test_event_loop_can_start_during_blocking_calls_of_other_threads(world: World) -> None:
    node = world.node("caller")
    client, stop = node.create_client(SetBool, "s"), threading.Event()
    outcomes: list[object] = []

    def calls() -> None:
        while not stop.is_set():
            try:
                outcomes.append(client.call_sync(SetBool.Request(data=True), timeout_s=0.3).success)
            except BaseException as error:
                outcomes.append(type(error))

    async def main() -> None:
        async with node:
            node.create_service(SetBool, "s", lambda request: SetBool.Response(success=request.data))
            await until(lambda: True in outcomes)
            stop.set()
            await asyncio.to_thread(wait, waiting, 60)

    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(calls) for _ in range(2)]
        wait_until(lambda: is_loop_running(node))
        asyncio.run(main())
    assert set(outcomes) <= {CallTimeoutError, True}


@pytest.mark.every_transport
def test_blocking_call_between_two_runs_of_a_loop_returns_the_context_to_it(world: World) -> None:
    node = world.node("n")
    client, ticks = node.create_client(SetBool, "s"), []
    loop = asyncio.new_event_loop()

    async def begin() -> None:
        node.create_timer(0.01, lambda: ticks.append(1))
        await until(lambda: ticks)

    async def tick_again() -> None:
        ticks.clear()
        await until(lambda: ticks)

    def call(timeout_s: float) -> None:
        with pytest.raises((CallTimeoutError, ClosedError)):
            client.call_sync(SetBool.Request(), timeout_s)

    loop.run_until_complete(begin())
    call(0.05)
    loop.run_until_complete(tick_again())
    with ThreadPoolExecutor() as pool:
        # The thread that took the context from the loop is not the last one that needs it.
        calls = []
        for timeout_s in (0.2, 0.5):
            calls.append(pool.submit(call, timeout_s))
            wait_until(lambda: is_loop_running(node) or calls[-1].done())
        for one in calls:
            one.result(20)
        loop.run_until_complete(tick_again())
        # Nothing can be given back once the context is closed.
        last = pool.submit(call, 60)
        wait_until(lambda: is_loop_running(node))
        node.context.close()
        last.result(10)
    loop.close()


@pytest.mark.every_transport
async def test_no_request_of_three_clients_is_lost_by_a_slow_server_with_short_queue(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosidl_py_gen.runtime.entities import services

    server, caller = world.pair()

    def handler(request: AddTwoInts.Request) -> AddTwoInts.Response:
        time.sleep(0.003)  # blocks the loop, which is the condition under test
        return AddTwoInts.Response(sum=request.a)

    with monkeypatch.context() as patched:
        patched.setattr(services, "service_endpoint_qos", lambda qos: SERVICES_DEFAULT.keep_last(10))
        server.create_service(AddTwoInts, "add", handler)
    clients = [caller.create_client(AddTwoInts, "add") for _ in range(3)]
    assert await clients[0].wait_for_service(timeout_s=20)
    calls = [client.call(AddTwoInts.Request(a=number), timeout_s=10) for number in range(50) for client in clients]
    answers = await asyncio.gather(*calls)
    assert [answer.sum for answer in answers] == [number for number in range(50) for _ in clients]
    assert clients[0]._window is clients[2]._window
    assert not clients[0]._window.waiting and not clients[0]._window._in_flight


@pytest.mark.every_transport
def test_blocking_call_runs_callbacks_and_stops_the_loop_when_it_ends(world: World) -> None:
    node = world.node("n")
    client, received = node.create_client(SetBool, "s"), []
    node.create_subscription(String, "t", received.append)
    node.create_publisher(String, "t").publish(String())

    with blocking_call(client):
        wait_until(lambda: received)  # callbacks run during a call
        assert is_loop_running(node)
    assert len(received) == 1
    assert not is_loop_running(node)


@pytest.mark.every_transport
def test_async_callback_continues_in_next_blocking_call_and_is_cancelled_on_close(
    world: World,
) -> None:
    context = world.context()
    node = world.node("n", context=context)
    steps: list[int] = []

    async def callback(_: String) -> None:
        try:
            while True:
                steps.append(1)
                await asyncio.sleep(0.01)
        finally:
            steps.append(-1)

    node.create_subscription(String, "t", callback)
    node.create_publisher(String, "t").publish(String())
    for _ in range(2):
        before = len(steps)
        with blocking_call(node.create_client(SetBool, "s")):
            wait_until(lambda before=before: len(steps) > before + 2)
    context.close()
    assert steps[-1] == -1
