"""Non-blocking `take()` of subscriptions, services and timers, from any thread."""

from __future__ import annotations

import asyncio
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String
from support.waiting import until, wait_until

from rosidl_py_gen.base.callbacks import CallbackSignatureError
from rosidl_py_gen.errors import ClosedError, EncodeError
from rosidl_py_gen.runtime import (
    AlreadyRespondedError,
    CallbackInUseError,
    LoopRunner,
    MessageInfo,
    RequestInfo,
    ServerLostError,
    ServiceServer,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

Server = ServiceServer[AddTwoInts.Request, AddTwoInts.Response]


@pytest.fixture
def runner() -> Iterator[LoopRunner]:
    with LoopRunner() as made:
        yield made


@pytest.mark.every_transport
def test_take_returns_received_messages_without_event_loop(world: World) -> None:
    node = world.node("polled")
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t", qos=3)
    assert subscription.take() is None
    wait_until(lambda: publisher.subscription_count and subscription.publisher_count)
    for number in range(2):
        publisher.publish(String(data=str(number)))
    taken: list[str] = []

    def take() -> bool:
        message = subscription.take()
        taken.extend([] if message is None else [message.data])
        return len(taken) == 2

    wait_until(take)
    assert taken == ["0", "1"]
    assert subscription.take() is None
    assert subscription.latest() == String(data="1")
    for number in range(5):
        publisher.publish(String(data=str(number)))
    wait_until(lambda: subscription.latest() == String(data="4"))
    assert subscription.take() is None  # `latest` skipped the others


@pytest.mark.every_transport
def test_take_with_info_returns_publisher_gid_and_timestamps(world: World) -> None:
    node = world.node("polled")
    publishers = [node.create_publisher(String, "t") for _ in range(2)]
    subscription = node.create_subscription(String, "t")
    wait_until(lambda: all(one.subscription_count for one in publishers) and subscription.publisher_count == 2)
    before_ns, infos = time.time_ns(), list[MessageInfo]()

    def take() -> bool:
        found = subscription.take_with_info()
        infos.extend([] if found is None else [found[1]])
        return found is not None

    for publisher in (*publishers, publishers[0]):
        publisher.publish(String())
        wait_until(take)
    assert [info.publisher_gid for info in infos] == [one.gid for one in (*publishers, publishers[0])]
    for info in infos:
        assert before_ns <= info.source_timestamp_ns <= info.received_timestamp_ns <= time.time_ns()
    numbers = [info.publication_sequence_number for info in infos]
    assert numbers == ([None] * 3 if world.kind == "dds" else [1, 1, 2])
    assert subscription.take_with_info() is None


async def test_take_and_receive_deliver_each_message_once(memory: World) -> None:
    node = memory.node("n")
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    receiving = asyncio.ensure_future(subscription.receive())
    await asyncio.sleep(0)
    for number in range(2):
        publisher.publish(String(data=str(number)))
    taken = subscription.take()
    assert {taken.data if taken else "", (await receiving).data} == {"0", "1"}


@pytest.mark.every_transport
@pytest.mark.parametrize("ends", ["endpoint", "node", "context"])
def test_take_in_another_thread_raises_closed_error_after_close(world: World, ends: str, runner: LoopRunner) -> None:
    context = world.context(loop_runner=runner)
    node = world.node("n", context=context)
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    server, timer = node.create_service(AddTwoInts, "add"), node.create_timer(0.0)
    taken: list[Any] = []
    outcomes: list[BaseException] = []

    def take(one: Any) -> None:
        try:
            while True:
                if (item := one.take()) is not None:
                    taken.append(item)
        except BaseException as error:
            outcomes.append(error)

    threads = [threading.Thread(target=take, args=(one,)) for one in (subscription, subscription, server, timer)]
    for thread in threads:
        thread.start()
    runner.wait(lambda: publisher.subscription_count, timeout_s=10)
    publisher.publish(String())
    runner.wait(lambda: String() in taken, timeout_s=10)
    for one in {"endpoint": (subscription, server, timer), "node": (node,), "context": (context,)}[ends]:
        one.close()
    for thread in threads:
        thread.join(10)
    assert [type(outcome) for outcome in outcomes] == [ClosedError] * 4


@pytest.mark.every_transport
def test_requests_are_sent_taken_and_answered_without_asyncio_code(world: World, runner: LoopRunner) -> None:
    nodes = [world.node(name, context=world.context(loop_runner=runner)) for name in ("server", "caller")]
    server, client = nodes[0].create_service(AddTwoInts, "add"), nodes[1].create_client(AddTwoInts, "add")
    assert server.take() is None
    assert runner.wait(client.service_is_available, timeout_s=10)
    before_ns = time.time_ns()
    futures = [client.send_request(AddTwoInts.Request(a=number, b=1)) for number in range(2)]
    requests = [runner.wait(server.take, timeout_s=10) for _ in futures]
    infos = [request.info for request in requests if request is not None]
    assert [info.sequence_number for info in infos] == [1, 2]
    assert len({info.client_gid for info in infos}) == 1
    for info in infos:
        assert isinstance(info, RequestInfo)
        assert before_ns <= info.source_timestamp_ns <= info.received_timestamp_ns <= time.time_ns()
    assert client.in_flight_count == 2
    threads: list[int] = []
    futures[0].add_done_callback(lambda _: threads.append(threading.get_ident()))
    for request in requests:
        assert request is not None
        request.respond(AddTwoInts.Response(sum=request.message.a + request.message.b))
    assert requests[0] is not None
    with pytest.raises(AlreadyRespondedError, match="/add"):
        requests[0].respond(AddTwoInts.Response())
    runner.wait(lambda: all(future.done() for future in futures), timeout_s=10)
    assert [future.result().sum for future in futures] == [1, 2]
    assert threads == [threading.get_ident()]
    assert client.in_flight_count == 0


@pytest.mark.every_transport
async def test_send_request_works_from_the_loop_and_from_another_thread(world: World) -> None:
    server, caller = world.pair()
    server.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a))
    client = caller.create_client(AddTwoInts, "add")
    await client.wait_for_service(timeout_s=10)
    assert (await asyncio.wrap_future(client.send_request(AddTwoInts.Request(a=1)))).sum == 1
    future = await asyncio.to_thread(client.send_request, AddTwoInts.Request(a=2))
    assert (await asyncio.wrap_future(future)).sum == 2


def test_response_to_send_request_arrives_during_a_later_blocking_call(memory: World) -> None:
    node = memory.node("both")
    node.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a))
    future = node.create_client(AddTwoInts, "add").send_request(AddTwoInts.Request(a=5))
    node.create_client(AddTwoInts, "add").call_sync(AddTwoInts.Request(), timeout_s=10)
    assert future.result(timeout=0).sum == 5


@pytest.mark.every_transport
def test_send_request_does_not_wait_for_a_server(world: World, runner: LoopRunner) -> None:
    node = world.node("n", context=world.context(loop_runner=runner))
    client = node.create_client(AddTwoInts, "add")
    lost = client.send_request(AddTwoInts.Request(a=1))
    given_up = client.send_request(AddTwoInts.Request(a=2))
    assert client.in_flight_count == 2
    assert given_up.cancel()
    runner.wait(lambda: client.in_flight_count == 1, timeout_s=10)
    server: Server = node.create_service(AddTwoInts, "add")
    assert runner.wait(client.service_is_available, timeout_s=10)
    last = client.send_request(AddTwoInts.Request(a=3))
    arrived: list[int] = []
    while not arrived or arrived[-1] != 3:
        request = runner.wait(server.take, timeout_s=10)
        assert request is not None
        arrived.append(request.message.a)
        request.respond(AddTwoInts.Response(sum=request.message.a))
    runner.wait(last.done, timeout_s=10)
    assert last.result().sum == 3
    assert arrived == ([1, 3] if world.kind == "zenoh" else [3])  # on Zenoh the request waits for the first server
    if world.kind == "zenoh":
        assert lost.result().sum == 1
    client.close()
    assert world.kind == "zenoh" or isinstance(lost.exception(timeout=0), ClosedError)
    with pytest.raises(ClosedError):
        client.send_request(AddTwoInts.Request())


@pytest.mark.every_transport
def test_send_request_failures_are_raised_or_set_in_its_future(world: World, runner: LoopRunner) -> None:
    nodes = [world.node(name, context=world.context(loop_runner=runner)) for name in ("server", "caller")]
    server: Server = nodes[0].create_service(AddTwoInts, "add")
    client = nodes[1].create_client(AddTwoInts, "add")
    assert runner.wait(client.service_is_available, timeout_s=10)
    with pytest.raises(TypeError, match="expected a AddTwoInts_Request"):
        client.send_request(String())  # type: ignore[arg-type]
    with pytest.raises(EncodeError):
        client.send_request(AddTwoInts.Request(a=2**70))
    assert client.in_flight_count == 0
    future = client.send_request(AddTwoInts.Request(a=1))
    request = runner.wait(server.take, timeout_s=10)
    assert request is not None
    server.close()
    with pytest.raises(ClosedError):
        request.respond(AddTwoInts.Response())
    runner.wait(future.done, timeout_s=10)
    assert isinstance(future.exception(), ServerLostError)


async def test_timer_take_returns_elapsed_time_only_when_due(memory: World) -> None:
    timer = memory.node("n").create_timer(0.5)
    assert timer.take() is None
    await asyncio.sleep(0.5)
    assert (tick := timer.take()) is not None
    assert tick.nanoseconds == 500_000_000
    assert timer.take() is None
    await asyncio.sleep(1.6)
    assert (tick := timer.take()) is not None
    assert tick.nanoseconds == 1_600_000_000
    assert (timer.call_count, timer.missed) == (2, 2)
    timer.cancel()
    await asyncio.sleep(1.0)
    assert timer.take() is None
    timer.close()
    with pytest.raises(ClosedError):
        timer.take()


def test_concurrent_takes_return_each_timer_tick_once(memory: World) -> None:
    timer = memory.node("n").create_timer(0.001)
    ticks: list[int] = []
    threads = [threading.Thread(target=lambda: wait_until(lambda: take_tick(timer, ticks))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert timer.call_count == len(ticks)
    assert sum(ticks) <= (timer.call_count + timer.missed + 1) * 1_000_000 + 500_000


def take_tick(timer: Any, ticks: list[int]) -> bool:
    if (tick := timer.take()) is not None:
        ticks.append(tick.nanoseconds)
    return len(ticks) >= 20


@pytest.mark.every_transport
def test_on_ready_is_called_when_an_item_is_available(world: World, runner: LoopRunner) -> None:
    node = world.node("n", context=world.context(loop_runner=runner))
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    server, client = node.create_service(AddTwoInts, "add"), node.create_client(AddTwoInts, "add")
    timer = node.create_timer(0.01)
    ready: list[Any] = []

    def register(one: Any) -> Any:
        def notify() -> None:
            ready.append(one)
            runner.wake()

        return one.on_ready(notify)

    registrations = [register(one) for one in (subscription, server)]
    runner.wait(lambda: publisher.subscription_count and client.service_is_available(), timeout_s=10)
    assert not subscription.is_ready and not server.is_ready
    publisher.publish(String(data="a"))
    runner.wait(lambda: ready, timeout_s=10)
    assert ready == [subscription] and subscription.is_ready
    assert subscription.take() == String(data="a") and not subscription.is_ready
    ready.clear()
    client.send_request(AddTwoInts.Request())
    runner.wait(lambda: ready, timeout_s=10)
    assert ready == [server] and server.is_ready
    assert server.take() is not None and not server.is_ready
    ready.clear()
    timer.cancel()  # a timer that is already due would notify at once, and again when the loop handles it
    registrations.append(register(timer))
    assert ready == []
    timer.reset()
    runner.wait(lambda: ready, timeout_s=10)
    assert ready == [timer]  # the timer stays due and calls only once
    runner.wait(timeout_s=0.03)
    assert ready == [timer]
    assert timer.take() is not None
    runner.wait(lambda: len(ready) == 2, timeout_s=10)
    assert ready == [timer, timer]
    for one in registrations:
        one.close()
    ready.clear()
    assert timer.take() is not None
    publisher.publish(String(data="b"))
    client.send_request(AddTwoInts.Request())
    runner.wait(server.take, timeout_s=10)
    runner.wait(timer.take, timeout_s=10)
    assert runner.wait(subscription.take, timeout_s=10) == String(data="b")
    assert ready == []
    publisher.publish(String(data="c"))
    assert runner.wait(lambda: subscription.is_ready, timeout_s=10)
    subscription.close()
    assert not subscription.is_ready


@pytest.mark.every_transport
async def test_on_ready_is_called_on_an_asyncio_loop(world: World) -> None:
    node = world.node("n")
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    calls = threading.Event()
    subscription.on_ready(calls.set)
    await publisher.wait_for_subscribers(timeout_s=10)
    await subscription.wait_for_publishers(timeout_s=10)
    publisher.publish(String(data="a"))
    await until(calls.is_set)
    assert subscription.is_ready
    assert await asyncio.to_thread(subscription.take) == String(data="a") and not subscription.is_ready
    publisher.publish(String())
    message, info = await subscription.receive_with_info(timeout_s=10)
    assert (message, info.publisher_gid) == (String(), publisher.gid)
    assert info.publication_sequence_number == (None if world.kind == "dds" else 2)
    assert [endpoint.endpoint_gid for endpoint in node.get_publishers_info_by_topic("t")] == [publisher.gid]


async def test_take_is_refused_for_entities_with_a_callback(memory: World) -> None:
    node = memory.node("n")
    timer, subscription = node.create_timer(1.0, print), node.create_subscription(String, "t", print)
    server: Any = node.create_service(AddTwoInts, "add", print)
    uses = [timer.take, subscription.take, subscription.take_with_info, server.take]
    for use in (*uses, subscription.__aiter__, server.__aiter__):
        with pytest.raises(CallbackInUseError, match=r"has a (callback|handler)"):
            use()
    for one in (timer, subscription, server):
        with pytest.raises(CallbackInUseError):
            one.on_ready(print)
    for waiting in (subscription.receive(timeout_s=0), timer.tick()):
        with pytest.raises(CallbackInUseError):
            await waiting


async def test_on_ready_is_called_at_once_for_existing_items(memory: World) -> None:
    node = memory.node("n")
    publisher, subscription, calls = node.create_publisher(String, "t"), node.create_subscription(String, "t"), []
    with subscription.on_ready(lambda: calls.append(1)):
        assert calls == []
        publisher.publish(String())
        await until(lambda: calls)
        subscription.on_ready(lambda: calls.append(2))
    assert calls == [1, 2]
    publisher.publish(String())
    await until(lambda: len(calls) == 3)
    assert calls == [1, 2, 2]


async def test_failing_on_ready_function_is_logged_and_others_are_called(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("n")
    publisher, subscription, calls = node.create_publisher(String, "t"), node.create_subscription(String, "t"), []
    subscription.on_ready(lambda: 1 / 0)
    subscription.on_ready(lambda: calls.append(1))
    publisher.publish(String())
    await until(lambda: calls)
    assert "the on_ready function of the subscription on /t" in caplog.text
    for wrong in (None, 3):
        with pytest.raises(TypeError, match="the on_ready function of the subscription on /t must be a function"):
            subscription.on_ready(wrong)  # type: ignore[arg-type]
    with pytest.raises(CallbackSignatureError):
        subscription.on_ready(lambda message: None)  # type: ignore[misc,arg-type]
    node.close()
    with pytest.raises(ClosedError):
        subscription.on_ready(print)
