"""What users do by mistake, or cannot help: other threads, second loops, cancelled futures, closed things."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String, UInt8MultiArray
from std_srvs.srv import SetBool

from rosidl_py_gen import compile_text
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import CallTimeoutError, Context, Node, TransportError
from rosidl_py_gen.runtime.qos import SERVICES_DEFAULT, QoSProfile

if TYPE_CHECKING:
    from .conftest import World

ROOT = Path(__file__).parents[2]


async def eventually(condition: Any, timeout_s: float = 5) -> None:
    """Wait until `condition()` holds."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it never happened"
        await asyncio.sleep(0.01)


def cancelled_future() -> asyncio.Future[None]:
    """What is left of a task that was cancelled."""
    future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    future.cancel()
    return future


# ------------------------------------------------------------------------------------------------- threads and loops


def test_two_threads_may_wait_for_services_without_a_loop(world: World) -> None:
    server, caller = world.pair()
    stop, serving = threading.Event(), threading.Event()

    async def serve() -> None:
        async def handler(request: AddTwoInts.Request) -> AddTwoInts.Response:
            await asyncio.sleep(request.a / 1000)
            return AddTwoInts.Response(sum=request.a)

        server.create_service(AddTwoInts, "slow", handler)
        serving.set()
        while not stop.is_set():
            await asyncio.sleep(0.01)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert serving.wait(5)
    client = caller.create_client(AddTwoInts, "slow")
    sums: dict[int, object] = {}

    def call(milliseconds: int, timeout_s: float) -> None:
        try:
            sums[milliseconds] = client.call_sync(AddTwoInts.Request(a=milliseconds), timeout_s).sum
        except CallTimeoutError as error:
            sums[milliseconds] = error

    call(0, 5)  # the first call makes the private loop
    started = time.monotonic()
    threads = [threading.Thread(target=call, args=args) for args in ((100, 3), (400, 3), (700, 3), (5000, 0.9))]
    for one in threads:
        one.start()
    for one in threads:
        one.join(10)
        assert not one.is_alive()
    took = time.monotonic() - started
    stop.set()
    thread.join()
    assert isinstance(sums.pop(5000), CallTimeoutError)
    assert sums == {0: 0, 100: 100, 400: 400, 700: 700}
    assert took < 3


def test_what_was_published_between_two_loops_does_not_stop_delivery(world: World) -> None:
    node = world.node("both")
    client = node.create_client(SetBool, "set")
    with pytest.raises(CallTimeoutError):
        client.call_sync(SetBool.Request(), timeout_s=0.05)
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    publisher.publish(String(data="between"))

    async def main() -> None:
        node.create_service(SetBool, "set", lambda request: SetBool.Response(success=True))
        assert (await client.call(SetBool.Request(), timeout_s=3)).success
        assert (await subscription.receive(timeout_s=3)).data == "between"

    asyncio.run(main())


def test_a_client_may_be_used_on_one_loop_after_the_other(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    # A server that keeps few requests, as on rmw_cyclonedds: bursts are spread over time.
    from rosidl_py_gen.runtime import service

    monkeypatch.setattr(service, "carrier_qos", lambda qos: SERVICES_DEFAULT.keep_last(5))
    server, caller = world.pair()
    client = caller.create_client(AddTwoInts, "add")

    async def burst() -> None:
        made = server.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a))
        calls = (client.call(AddTwoInts.Request(a=number), timeout_s=5) for number in range(40))
        assert [answer.sum for answer in await asyncio.gather(*calls)] == list(range(40))
        assert client.pending_count == 0
        made.close()

    asyncio.run(burst())
    asyncio.run(burst())


def test_publishing_on_a_loop_is_enough_to_bring_a_node_to_life(world: World) -> None:
    node = world.node("early")
    heard: list[str] = []
    node.create_subscription(String, "t", lambda message: heard.append(message.data))
    publisher = node.create_publisher(String, "t")

    async def main() -> None:
        publisher.publish(String(data="x"))
        await eventually(lambda: heard)

    asyncio.run(main())
    heard.clear()
    asyncio.run(main())  # and again on the next loop


def test_plain_scripts_see_the_nodes_of_other_contexts_of_their_process(world: World) -> None:
    one, other = world.node("one"), world.node("other")
    deadline = time.monotonic() + 5
    while set(one.get_node_names()) != {"/one", "/other"}:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    while set(other.get_node_names()) != {"/one", "/other"}:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    for number in range(50):
        other.create_publisher(String, f"t{number}")
    one.get_node_names()
    assert len(one.context.discovery._reader.queue.items) == 0


# ------------------------------------------------------------------------------------------------------ closed things


async def test_waiting_on_something_closed_is_an_error_and_costs_nothing(world: World) -> None:
    context = world.context()
    node = world.node("gone", context=context)
    publisher, client = node.create_publisher(String, "t"), node.create_client(SetBool, "s")
    context.close()
    for attempt in (
        publisher.wait_for_subscribers(timeout_s=1),
        client.wait_for_service(timeout_s=1),
        node.wait_for_node("other", timeout_s=1),
        node.__aenter__(),
        context.__aenter__(),
    ):
        with pytest.raises(ClosedError):
            await attempt
    busy = time.process_time()
    await asyncio.sleep(0.5)
    assert time.process_time() - busy < 0.2


async def test_entering_a_closed_node_of_an_open_context_is_an_error(memory: World) -> None:
    node = memory.node("gone")
    node.close()
    with pytest.raises(ClosedError):
        async with node:
            pass
    with pytest.raises(ClosedError), node:
        pass


def test_the_garbage_collector_may_close_a_node_during_a_take(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    from rosidl_py_gen.runtime import transport

    context = dds.context()
    node = dds.node("stays", context=context)
    subscription, publisher = node.create_subscription(String, "t"), node.create_publisher(String, "t")
    original, closed = transport.ReceiveQueue.push, []

    def collecting(self: transport.ReceiveQueue, sample: transport.Sample) -> None:
        if self is subscription._reader.queue and not closed:
            forgotten = Node("forgotten", context=context)
            forgotten.create_subscription(String, "t")
            forgotten.cycle = forgotten  # type: ignore[attr-defined]
            del forgotten
            with pytest.warns(ResourceWarning, match="forgotten"):
                gc.collect()
            closed.append(True)
        original(self, sample)

    subscription._reader._push = lambda sample: collecting(subscription._reader.queue, sample)  # type: ignore[attr-defined]
    thread = threading.Thread(target=lambda: [publisher.publish(String(data=text)) for text in "abc"], daemon=True)
    thread.start()
    thread.join(10)
    assert not thread.is_alive(), "deadlock"
    assert closed
    assert [String.decode(subscription._items.popleft()[0]).data for _ in range(3)] == ["a", "b", "c"]


def test_a_node_forgotten_while_its_loop_runs_is_closed_by_the_loop(world: World) -> None:
    context = world.context()

    async def main() -> None:
        watcher = world.node("watcher", context=context)
        forgotten = Node("forgotten", context=context)
        await watcher.wait_for_node("forgotten", timeout_s=5)
        with pytest.warns(ResourceWarning, match="forgotten"):
            del forgotten
            gc.collect()
        await eventually(lambda: watcher.get_node_names() == ["/watcher"])

    asyncio.run(main())


# --------------------------------------------------------------------------------------------------------- time limits


async def test_calls_to_a_stopped_server_end_in_time(dds: World, caplog: pytest.LogCaptureFixture) -> None:
    program = (
        "import asyncio\nfrom rosidl_py_gen.runtime import Node\n"
        "async def main():\n    async with Node('stalled') as node:\n"
        "        node.create_service('rcl_interfaces/srv/DescribeParameters', 'd', lambda r: {})\n"
        "        print(flush=True)\n        await asyncio.sleep(60)\n"
        "asyncio.run(main())\n"
    )
    from rosidl_py_gen.msgs.rcl_interfaces.srv import DescribeParameters

    command, environment = [sys.executable, "-c", program], {**os.environ, "PYTHONPATH": str(ROOT)}
    server = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE)
    try:
        assert server.stdout is not None
        server.stdout.readline()
        client = dds.node("caller").create_client(DescribeParameters, "d")
        assert await client.wait_for_service(timeout_s=10)
        server.send_signal(signal.SIGSTOP)
        request = DescribeParameters.Request(names=["x" * 1_000_000])
        started = time.monotonic()
        calls = [asyncio.ensure_future(client.call(request, timeout_s=1)) for _ in range(6)]
        outcomes = await asyncio.gather(*calls, return_exceptions=True)
        assert time.monotonic() - started < 2
        assert all(isinstance(outcome, CallTimeoutError) for outcome in outcomes)
        pending = [asyncio.ensure_future(client.call(request, timeout_s=5)) for _ in range(3)]
        await asyncio.sleep(0.1)
        client.close()
        ends = await asyncio.gather(*pending, return_exceptions=True)
        assert all(isinstance(end, ClosedError) for end in ends)
        assert client.pending_count == 0
    finally:
        server.kill()
        server.wait()
    gc.collect()
    assert not [record for record in caplog.records if "never retrieved" in record.getMessage()]


@pytest.mark.parametrize(("timeout", "error"), [("1", TypeError), (float("nan"), ValueError), ([], TypeError)])
async def test_a_time_limit_that_is_none_is_refused(memory: World, timeout: Any, error: type[Exception]) -> None:
    node = memory.node("n")
    client, subscription = node.create_client(SetBool, "s"), node.create_subscription(String, "t")
    publisher = node.create_publisher(String, "t")
    for attempt in (
        client.call(SetBool.Request(), timeout_s=timeout),
        client.wait_for_service(timeout),
        subscription.receive(timeout),
        subscription.wait_for_publishers(timeout),
        publisher.wait_for_acknowledged(timeout),
        node.wait_for_node("x", timeout),
    ):
        with pytest.raises(error, match="timeout_s must be a number of seconds"):
            await attempt
    assert client.pending_count == 0


async def test_a_file_descriptor_that_is_always_ready_does_not_starve_messages(dds: World) -> None:
    alice, bob = dds.pair()
    publisher, heard = alice.create_publisher(String, "t"), []
    bob.create_subscription(String, "t", heard.append)
    await publisher.wait_for_subscribers(timeout_s=5)
    readable, writable = os.pipe()
    os.write(writable, b"x")
    loop = asyncio.get_running_loop()
    loop.add_reader(readable, lambda: None)
    try:
        for number in range(5):
            await asyncio.to_thread(publisher.publish, String(data=str(number)))
        await eventually(lambda: len(heard) == 5)
    finally:
        loop.remove_reader(readable)
        os.close(readable)
        os.close(writable)


# ------------------------------------------------------------------------------------------------ callbacks that fail


async def test_a_cancelled_future_in_a_plain_callback_changes_nothing_else(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    future, seen = cancelled_future(), []

    def callback(message: String) -> None:
        seen.append(message.data)
        if message.data == "bad":
            future.result()

    bob.create_subscription(String, "t", callback)
    publisher = alice.create_publisher(String, "t")
    await publisher.wait_for_subscribers(timeout_s=5)
    for text in ("bad", "good"):
        publisher.publish(String(data=text))
    await eventually(lambda: seen == ["bad", "good"])
    assert "the callback of /t failed" in caplog.text


async def test_a_cancelled_future_in_an_async_callback_changes_nothing_else(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    future, seen = cancelled_future(), []

    async def callback(message: String) -> None:
        seen.append(message.data)
        if message.data == "bad":
            await future

    bob.create_subscription(String, "t", callback)
    publisher = alice.create_publisher(String, "t")
    await publisher.wait_for_subscribers(timeout_s=5)
    for text in ("bad", "good"):
        publisher.publish(String(data=text))
    await eventually(lambda: seen == ["bad", "good"])
    assert "the callback of /t failed" in caplog.text


@pytest.mark.parametrize("style", ["plain", "async"])
async def test_a_cancelled_future_in_a_handler_changes_nothing_else(
    world: World, caplog: pytest.LogCaptureFixture, style: str
) -> None:
    alice, bob = world.pair()
    future = cancelled_future()

    def plain(request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(success=True) if request.data else future.result()  # type: ignore[return-value]

    async def waiting(request: SetBool.Request) -> SetBool.Response:
        if not request.data:
            await future
        return SetBool.Response(success=True)

    alice.create_service(SetBool, "s", plain if style == "plain" else waiting)
    client = bob.create_client(SetBool, "s")
    with pytest.raises(CallTimeoutError):
        await client.call(SetBool.Request(data=False), timeout_s=0.5)
    assert (await client.call(SetBool.Request(data=True), timeout_s=5)).success
    assert "the handler of service /s failed" in caplog.text


async def test_a_lambda_that_returns_a_coroutine_is_an_async_callback(world: World) -> None:
    alice, bob = world.pair()
    seen: list[str] = []

    async def slow(message: String, suffix: str) -> None:
        await asyncio.sleep(0.01)
        seen.append(message.data + suffix)

    async def answer(request: SetBool.Request) -> SetBool.Response:
        await asyncio.sleep(0)
        return SetBool.Response(success=request.data)

    bob.create_subscription(String, "t", lambda message: slow(message, "!"), QoSProfile().keep_all())
    bob.create_service(SetBool, "s", lambda request: answer(request))
    publisher = alice.create_publisher(String, "t")
    await publisher.wait_for_subscribers(timeout_s=5)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    await eventually(lambda: len(seen) == 5)
    assert seen == ["0!", "1!", "2!", "3!", "4!"]
    assert (await alice.create_client(SetBool, "s").call(SetBool.Request(data=True), timeout_s=5)).success


def test_what_is_no_function_is_refused_with_a_hint(memory: World) -> None:
    node = memory.node("n")
    with pytest.raises(TypeError, match=r"the callback of /t must be a function, got 10; QoS is given as qos="):
        node.create_subscription(String, "t", 10)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="the handler of service /s must be a function, got 5"):
        node.create_service(SetBool, "s", 5)  # type: ignore[call-overload]
    assert node.get_topic_names_and_types() == memory.node("other").get_topic_names_and_types()
    publisher = node.create_publisher(UInt8MultiArray, "raw")
    for wrong in (None, "hi", 5, [0, 1, 0, 0, 5]):
        with pytest.raises(TypeError, match="publish_raw takes bytes"):
            publisher.publish_raw(wrong)  # type: ignore[arg-type]


def test_a_type_name_that_crashes_the_library_is_refused(dds: World) -> None:
    node = dds.node("n")
    for length, fits in ((230, True), (240, False), (1000, False)):
        message = compile_text(f"my_pkg/msg/L{'o' * (length - 1)}", "int32 x")
        if fits:
            node.create_publisher(message, "long").publish(message())
        else:
            with pytest.raises(TransportError, match="the DDS name of a type may have 255 characters, found"):
                node.create_publisher(message, "long")


def test_a_context_that_is_closed_runs_nothing(memory: World) -> None:
    context = memory.context()
    node = memory.node("n", context=context)
    client = node.create_client(SetBool, "s")
    context.close()
    with pytest.raises(ClosedError):
        client.call_sync(SetBool.Request(), timeout_s=1)
    assert Context is type(context)


def test_threads_may_take_turns_in_waiting_calls(world: World) -> None:
    client = world.node("caller").create_client(SetBool, "s")
    outcomes: list[BaseException | None] = []

    def calls(times: int) -> None:
        for _ in range(times):
            try:
                client.call_sync(SetBool.Request(), timeout_s=0.02)
            except BaseException as error:
                outcomes.append(error)

    calls(1)
    threads = [threading.Thread(target=calls, args=(10,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    calls(10)
    for thread in threads:
        thread.join(10)
    assert len(outcomes) == 51
    assert {type(outcome) for outcome in outcomes} == {CallTimeoutError}


@pytest.mark.parametrize("style", ["paused", "ended"])
def test_a_waiting_call_ends_when_the_loop_that_serves_it_stops(world: World, style: str) -> None:
    client = world.node("caller").create_client(SetBool, "s")
    outcomes: list[BaseException] = []

    def call() -> None:
        try:
            client.call_sync(SetBool.Request(), timeout_s=0.5)
        except BaseException as error:
            outcomes.append(error)

    async def begin() -> threading.Thread:
        await client.wait_for_service(timeout_s=0.01)  # attaches the loop
        thread = threading.Thread(target=call)
        thread.start()
        await asyncio.sleep(0.1)
        return thread

    if style == "ended":
        thread = asyncio.run(begin())
    else:
        loop = asyncio.new_event_loop()
        thread = loop.run_until_complete(begin())
    thread.join(5)
    assert not thread.is_alive()
    assert [type(outcome) for outcome in outcomes] == [ClosedError]
    with pytest.raises(CallTimeoutError):
        client.call_sync(SetBool.Request(), timeout_s=0.05)
    if style == "paused":
        loop.close()


def test_a_loop_may_start_while_threads_wait_for_services(world: World) -> None:
    node = world.node("caller")
    client, stop = node.create_client(SetBool, "s"), threading.Event()
    outcomes: list[object] = []

    def calls() -> None:
        while not stop.is_set():
            try:
                outcomes.append(client.call_sync(SetBool.Request(data=True), timeout_s=0.3).success)
            except BaseException as error:
                outcomes.append(type(error))

    threads = [threading.Thread(target=calls) for _ in range(2)]
    for thread in threads:
        thread.start()
    time.sleep(0.1)

    async def main() -> None:
        async with node:
            node.create_service(SetBool, "s", lambda request: SetBool.Response(success=request.data))
            await eventually(lambda: True in outcomes)
            stop.set()
            await asyncio.to_thread(lambda: [thread.join(5) for thread in threads])

    asyncio.run(main())
    assert set(outcomes) <= {CallTimeoutError, True}


def test_a_waiting_call_between_two_runs_of_a_loop_gives_the_context_back(world: World) -> None:
    node = world.node("n")
    client, ticks = node.create_client(SetBool, "s"), []
    loop = asyncio.new_event_loop()

    async def begin() -> None:
        node.create_timer(0.01, lambda: ticks.append(1))
        await eventually(lambda: ticks)

    async def go_on() -> None:
        ticks.clear()
        await eventually(lambda: ticks)

    loop.run_until_complete(begin())
    with pytest.raises(CallTimeoutError):
        client.call_sync(SetBool.Request(), timeout_s=0.05)
    loop.run_until_complete(go_on())
    node.close()
    loop.close()


def test_what_threads_make_while_a_node_closes_is_closed_too(world: World) -> None:
    watcher = world.node("watcher")
    context = world.context()
    for number in range(10):
        node = world.node(f"n{number}", context=context)

        def make(node: Node = node, number: int = number) -> None:
            try:
                for index in range(1000):
                    node.create_publisher(String, f"left_{number}_{threading.get_ident()}_{index}")
            except ClosedError:
                pass

        threads = [threading.Thread(target=make) for _ in range(3)]
        for thread in threads:
            thread.start()
        time.sleep(0.005)
        node.close()
        for thread in threads:
            thread.join(20)
    deadline = time.monotonic() + 5
    while left := [name for name, _ in watcher.get_topic_names_and_types() if name.startswith("/left_")]:
        assert time.monotonic() < deadline, f"{len(left)} topics are left"
        time.sleep(0.05)


async def test_three_clients_of_a_slow_server_that_keeps_little_lose_nothing(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosidl_py_gen.runtime import service

    monkeypatch.setattr(service, "carrier_qos", lambda qos: SERVICES_DEFAULT.keep_last(10))
    server, caller = world.pair()

    def handler(request: AddTwoInts.Request) -> AddTwoInts.Response:
        time.sleep(0.003)
        return AddTwoInts.Response(sum=request.a)

    server.create_service(AddTwoInts, "add", handler)
    clients = [caller.create_client(AddTwoInts, "add") for _ in range(3)]
    assert await clients[0].wait_for_service(timeout_s=5)
    calls = [client.call(AddTwoInts.Request(a=number), timeout_s=10) for number in range(50) for client in clients]
    answers = await asyncio.gather(*calls)
    assert [answer.sum for answer in answers] == [number for number in range(50) for _ in clients]
    assert clients[0]._line is clients[2]._line
    assert not clients[0]._line._line
