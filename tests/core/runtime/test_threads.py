"""Nodes, entities and contexts that eight threads use at once; exact results, also without the GIL."""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotDoneError
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import Int32, String
from support.inner_state import participant_of, scope_of
from support.local_network import domain_id
from support.parallel_threads import THREADS, in_threads
from support.processes import python_process
from support.waiting import wait_until

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import LoopRunner, Node, QoSProfile, get_logger
from rosidl_py_gen.runtime.node.context import core_of
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, ReceiveQueue, TopicKey
from rosidl_py_gen.runtime.transport.cyclone import domain
from rosidl_py_gen.runtime.transport.dds import services
from rosidl_py_gen.runtime.transport.dds.services import ClientCorrelation
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex, MatchCache

if TYPE_CHECKING:
    from collections.abc import Hashable
    from pathlib import Path

    from support.worlds import World

RELIABLE = QoSProfile().keep_all().reliable()
MESSAGES = 25
"""Messages, and calls, of each thread."""


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return AddTwoInts.Response(sum=request.a + request.b)


def exchange(node: Node, number: int, barrier: threading.Barrier) -> None:
    """Publish, call and receive; every message of every thread arrives once and in order, every call gets its reply."""
    publisher = node.create_publisher(String, "t", RELIABLE)
    subscription = node.create_subscription(String, "t", qos=RELIABLE)
    client = node.create_client(AddTwoInts, "add")
    client.wait_for_service_sync(timeout_s=20)
    barrier.wait(30)
    publisher.wait_for_subscribers_sync(timeout_s=20, count=THREADS)
    subscription.wait_for_publishers_sync(timeout_s=20, count=THREADS)
    barrier.wait(30)
    for count in range(MESSAGES):
        publisher.publish(String(data=f"{number} {count}"))
        response = client.call_sync(AddTwoInts.Request(a=1000 * number, b=count), timeout_s=20)
        assert response.sum == 1000 * number + count
    received: dict[int, list[int]] = {thread: [] for thread in range(THREADS)}
    for _ in range(THREADS * MESSAGES):
        thread, count = map(int, subscription.receive_sync(timeout_s=20).data.split())
        received[thread].append(count)
    assert received == {thread: list(range(MESSAGES)) for thread in range(THREADS)}
    assert subscription.take() is None and subscription.dropped == 0
    barrier.wait(30)  # the others have received, too


@pytest.mark.every_transport
def test_eight_threads_publish_receive_and_call_without_loss(world: World) -> None:
    context, barrier = world.context(), threading.Barrier(THREADS)
    world.node("server", context=context).create_service(AddTwoInts, "add", add)

    def work(number: int) -> None:
        with Node(f"worker{number}", context=context) as node:
            exchange(node, number, barrier)

    in_threads(work)


@pytest.mark.every_transport
def test_eight_threads_and_a_running_event_loop_exchange_without_loss(world: World) -> None:
    barrier = threading.Barrier(THREADS)
    server, context = world.node("server"), world.context()

    async def main() -> None:
        async def add_later(request: AddTwoInts.Request) -> AddTwoInts.Response:
            await asyncio.sleep(0)
            return add(request)

        async with server:
            server.create_service(AddTwoInts, "add", add_later)
            await asyncio.to_thread(in_threads, work)

    def work(number: int) -> None:
        with Node(f"worker{number}", context=context) as node:
            exchange(node, number, barrier)

    asyncio.run(main())


@pytest.mark.every_transport
def test_eight_threads_can_share_publisher_client_and_subscription(world: World) -> None:
    with LoopRunner() as runner:
        context = world.context(loop_runner=runner)
        node = world.node("n", context=context)
        node.create_service(AddTwoInts, "add", add)
        publisher, client = node.create_publisher(String, "t", RELIABLE), node.create_client(AddTwoInts, "add")
        subscription = node.create_subscription(String, "t", qos=RELIABLE)
        client.wait_for_service_sync(timeout_s=20)
        publisher.wait_for_subscribers_sync(timeout_s=20)
        taken: list[list[str]] = [[] for _ in range(THREADS)]
        total = THREADS * MESSAGES

        def take(number: int) -> bool:
            while (message := subscription.take()) is not None:
                taken[number].append(message.data)
            return sum(map(len, taken)) >= total

        def work(number: int) -> None:
            futures = []
            for count in range(MESSAGES):
                publisher.publish(String(data=f"{number} {count}"))
                futures.append(client.send_request(AddTwoInts.Request(a=1000 * number, b=count)))
            for count, future in enumerate(futures):
                runner.wait(future.done, timeout_s=30)
                assert future.result(timeout=0).sum == 1000 * number + count
            assert runner.wait(lambda: take(number), timeout_s=30)

        in_threads(work)
        expected = Counter(f"{number} {count}" for number in range(THREADS) for count in range(MESSAGES))
        assert Counter(data for each in taken for data in each) == expected
        assert client.in_flight_count == 0 and subscription.dropped == 0
        context.close()


@pytest.mark.slow
@pytest.mark.every_transport
def test_nodes_created_and_closed_by_eight_threads_leave_no_endpoints(world: World) -> None:
    context, observer = world.context(), world.node("observer")
    rounds = 2 if world.kind == "zenoh" else 5

    def work(number: int) -> None:
        for count in range(rounds):
            node = Node(f"n{number}", context=context)
            publisher = node.create_publisher(Int32, f"t{number}")
            subscription = node.create_subscription(Int32, f"t{number}", lambda _: None)
            node.create_client(AddTwoInts, "add")
            node.create_timer(1.0, lambda: None)
            publisher.publish(Int32(data=count))
            node.logger.debug("closing")
            if count % 2:
                subscription.close()
            node.close()
            with pytest.raises(ClosedError):
                publisher.publish(Int32())

    in_threads(work)
    assert core_of(context).scopes == []
    wait_until(lambda: observer.get_node_names() == ["/observer"])
    numbered = {f"/t{number}" for number in range(THREADS)}
    wait_until(lambda: not numbered & {name for name, _ in observer.get_topic_names_and_types()})


@pytest.mark.every_transport
def test_entities_closed_by_eight_threads_at_once_are_closed_once(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    world.context()  # its log file must stay open
    context = world.context()
    node = world.node("n", context=context)
    entities: list[Any] = [
        *(node.create_publisher(Int32, f"t{number}") for number in range(10)),
        *(node.create_subscription(Int32, f"t{number}") for number in range(10)),
        *(node.create_client(AddTwoInts, f"s{number}") for number in range(5)),
        *(node.create_service(AddTwoInts, f"s{number}", add) for number in range(5)),
        node.create_timer(1.0, lambda: None),
    ]

    def work(number: int) -> None:
        for entity in entities[number % 2 :]:
            entity.close()
        node.close()
        context.close()

    in_threads(work)
    assert scope_of(node).owned == {} and scope_of(node).with_callbacks == {}
    get_logger("after").warning("the file is open")
    assert "the file is open" in "".join(file.read_text() for file in tmp_path.iterdir())


def test_outdated_servers_found_by_a_thread_do_not_overwrite_newer_ones(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = memory.node("client").create_client(AddTwoInts, "add")
    memory.node("first").create_service(AddTwoInts, "add", add)
    found, may_store, stored = threading.Event(), threading.Event(), []
    find, update, ours = services.find_servers, ClientCorrelation.update_servers, threading.get_ident()

    def find_slowly(*arguments: Any) -> Any:
        result = find(*arguments)
        if threading.get_ident() != ours and not found.is_set():
            found.set()
            assert may_store.wait(10)
        return result

    def record(self: ClientCorrelation, readers: set[bytes], *, uses_sample_identity: bool) -> None:
        stored.append(len(readers))
        update(self, readers, uses_sample_identity=uses_sample_identity)

    monkeypatch.setattr(services, "find_servers", find_slowly)
    monkeypatch.setattr(ClientCorrelation, "update_servers", record)
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(client.service_is_available)
        assert found.wait(10)
        memory.node("second").create_service(AddTwoInts, "add", add)
        assert client.service_is_available()
        may_store.set()
        assert asked.result(10) and stored[-1] == 2


def test_participant_is_deleted_after_an_endpoint_that_another_thread_deletes(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    dds.context()  # uses the domain, so the domain stays
    context = dds.context()
    node = dds.node("n", context=context)
    publisher = node.create_publisher(Int32, "t")
    api = participant_of(node).api
    delete, deleting, may_delete = api.delete, threading.Event(), threading.Event()

    def delete_slowly(entity: int) -> int:
        if not deleting.is_set():  # the publisher, not what the context closes
            deleting.set()
            assert may_delete.wait(10)
        return int(delete(entity))

    monkeypatch.setattr(api, "delete", delete_slowly)
    with ThreadPoolExecutor(2) as pool:
        publisher_closed = pool.submit(publisher.close)
        assert deleting.wait(10)
        context_closed = pool.submit(context.close)
        with pytest.raises(NotDoneError):
            context_closed.result(0.2)
        assert not publisher_closed.done()
        may_delete.set()
        publisher_closed.result(10), context_closed.result(10)


def test_ctrl_c_while_a_participant_waits_for_another_thread_is_raised_after_its_deletion(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    dds.context()  # uses the domain, so the domain stays
    context = dds.context()
    participant = participant_of(dds.node("n", context=context))
    participant.deleting.append(-1)  # another thread

    def interrupt(_: float) -> None:
        signal.raise_signal(signal.SIGINT)
        participant.deleting.clear()

    monkeypatch.setattr(domain, "time", SimpleNamespace(monotonic=time.monotonic, sleep=interrupt))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            context.close()
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(participant.domain.fast_dds.members) == 1  # the other context


DEFAULT_CONTEXT = """
import sys, threading
sys.setswitchinterval(1e-6)
from concurrent.futures import ThreadPoolExecutor
from rosidl_py_gen.runtime import Node
barrier = threading.Barrier(8)

def work(number):
    barrier.wait()
    for count in range(10):
        with Node(f"n{number}") as node:
            node.create_publisher("std_msgs/msg/Int32", "t").publish({"data": count})

with ThreadPoolExecutor(8) as pool:
    list(pool.map(work, range(8)))
"""


@pytest.mark.slow
def test_default_context_of_a_process_is_open_for_nodes_of_eight_threads() -> None:
    environment = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with python_process(DEFAULT_CONTEXT, **environment) as process:
        assert process.communicate(timeout=60) == ("", "") and process.returncode == 0


# --- queues and indexes -----------------------------------------------------------------------------------------------


def test_full_receive_queue_counts_every_dropped_message_across_threads() -> None:
    queue = ReceiveQueue(QoSProfile().keep_last(3))
    pushed, lock = 4000, threading.Lock()

    def work(number: int) -> int:
        taken = 0
        for count in range(pushed):
            if number < 2:
                with lock:  # as the transports do
                    queue.push((b"", count, number, 0, None))
            elif queue.items:
                try:
                    queue.items.popleft()
                except IndexError:
                    continue
                taken += 1
        return taken

    taken = sum(in_threads(work))
    assert taken + queue.dropped + len(queue.items) == 2 * pushed and len(queue.items) <= 3


def test_latest_returns_a_message_that_arrives_during_an_earlier_call(memory: World) -> None:
    node = memory.node("n")
    publisher = node.create_publisher(Int32, "t", RELIABLE)
    subscription = node.create_subscription(Int32, "t", qos=RELIABLE)

    def work(number: int) -> None:
        for count in range(1, 500):
            if number == 0:
                publisher.publish(Int32(data=count))
            else:
                subscription.latest()

    in_threads(work, 2)
    latest = subscription.latest()
    assert latest is not None and latest.data == 499


def endpoint(number: int, topic: int) -> DiscoveredEndpoint:
    key = TopicKey("topic", f"/t{topic}")
    return DiscoveredEndpoint(number.to_bytes(16, "big"), bytes(16), number % 2 == 0, key, "a/msg/B", QoSProfile())


def test_endpoint_index_is_consistent_after_changes_by_eight_threads() -> None:
    index, key = EndpointIndex(), TopicKey("topic", "/t0")
    cache = MatchCache(index, [key], lambda _: tuple(index.endpoints_on(key, writers=True)))

    def work(number: int) -> None:
        for count in range(200):
            one = endpoint(1000 * number + count, count % 3)
            index.add(one)
            cache[None]
            list(index.endpoints.values())
            if count % 4:
                index.remove(one.guid)

    in_threads(work)
    remaining = {endpoint(1000 * number + count, count % 3).guid for number in range(8) for count in range(0, 200, 4)}
    found = [
        one.guid
        for topic in range(3)
        for writers in (True, False)
        for one in index.endpoints_on(TopicKey("topic", f"/t{topic}"), writers=writers)
    ]
    assert index.endpoints.keys() == remaining == set(found) and len(found) == len(remaining)
    assert index.version == 8 * (200 + 150)
    assert cache[None] == tuple(index.endpoints_on(key, writers=True))


def test_match_cache_does_not_store_results_of_an_older_version() -> None:
    index, new = EndpointIndex(), endpoint(2, 0)

    def check(_: Hashable) -> int:
        seen = index.version
        if seen == 0:  # another thread changes the endpoints and reads the newer result during this check
            index.add(new)
            assert cache[None] == 11
        return seen + 10

    cache: MatchCache[int] = MatchCache(index, [new.topic_key], check)
    assert cache[None] == 10
    assert cache[None] == 11
