"""Flow control of requests to a server with a short queue."""

from __future__ import annotations

import asyncio
import logging
from functools import partial
from typing import TYPE_CHECKING

import pytest
from example_interfaces.srv import AddTwoInts
from support.inner_state import transport_end_of
from support.waiting import until

from rosidl_py_gen.runtime.entities import services
from rosidl_py_gen.runtime.transport import flow_control
from rosidl_py_gen.runtime.transport.flow_control import RequestFlowControl
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Iterable

    from support.worlds import World


def enqueue(window: RequestFlowControl, numbers: Iterable[int], depth: int, sent: list[int]) -> None:
    """Enqueue requests and append the numbers of sent requests to `sent`."""

    def send(number: int, sequence_number: int) -> bool:
        sent.append(number)
        assert sequence_number == len(sent)
        return True

    for number in numbers:
        window.acquire(partial(send, number), depth)


async def test_reply_frees_window_slots_of_its_request_and_all_earlier_ones() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enqueue(window, range(10), 3, sent)
    assert sent == [0, 1, 2]
    window.on_response(1)
    assert sent == [0, 1, 2, 3]
    window.on_response(3)  # so the server has taken request 2, too
    assert sent == [0, 1, 2, 3, 4, 5]
    window.on_response(2)
    assert sent == [0, 1, 2, 3, 4, 5]
    window.on_response(6)
    assert sent == list(range(9))


async def test_reply_frees_only_window_slots_of_its_own_client() -> None:
    window, sent = RequestFlowControl("/add"), list[str]()
    for client in ("a", "b"):
        for number in range(3):

            def send(sequence_number: int, name: str = f"{client}{number}") -> bool:
                sent.append(name)
                return True

            window.acquire(send, 3, client)
    assert sent == ["a0", "a1", "a2"]
    window.on_response(2, "a")
    assert sent[3:] == ["b0", "b1"]
    window.on_response(5, "b")  # b1, and b0 before it, but not a2
    assert sent[5:] == ["b2"]
    window.acquire(lambda sequence_number: sent.append("b3") is None, 3, "b")
    window.acquire(lambda sequence_number: sent.append("b4") is None, 3, "b")
    assert sent[6:] == ["b3"]
    window.on_response(3, "a")
    assert sent[7:] == ["b4"]


async def test_released_request_frees_one_window_slot_only_once() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enqueue(window, range(6), 3, sent)
    window.release(2)
    assert sent == [0, 1, 2, 3]
    window.release(2)
    window.on_response(2)
    assert sent == [0, 1, 2, 3, 4]


async def test_stalled_window_sends_one_more_request_and_warns(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(flow_control, "STALL_TIMEOUT_S", 0.2)
    window, sent = RequestFlowControl("/add"), list[int]()
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    enqueue(window, range(6), 3, sent)
    with caplog.at_level(logging.WARNING):
        await until(lambda: len(sent) == 5)
    assert loop.time() - began_s >= 0.6 and sent == list(range(5)), "each takes twice as long as the last"
    assert "no server of /add replied for 0.2 s; 3 calls are waiting" in caplog.text
    window.on_response(5)
    assert sent == list(range(6)) and window.stall_timeout_s == 0.2


async def test_slow_replies_reset_the_stall_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enqueue(window, range(9), 3, sent)
    loop, passed_s = asyncio.get_running_loop(), 0.0
    now = loop.time
    monkeypatch.setattr(loop, "time", lambda: now() + passed_s)
    for number in (1, 2, 3):
        passed_s += 9
        window.on_response(number)
        await asyncio.sleep(0)
        assert len(sent) == 3 + number


async def test_window_with_interval_sends_waiting_requests_without_replies() -> None:
    window, sent = RequestFlowControl("/result", 0.02), list[int]()
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    enqueue(window, range(5), 2, sent)
    assert sent == [0, 1]
    await until(lambda: len(sent) == 5)
    assert loop.time() - began_s >= 0.039


async def test_cancelled_request_frees_its_window_slot() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()

    def send(number: int, sequence_number: int) -> bool:
        sent.append(sequence_number)
        return number != 1

    for number in range(4):
        window.acquire(partial(send, number), 1)
    window.on_response(sent[-1])
    assert sent == [1, 2, 3]
    window.on_response(sent[-1])
    assert sent == [1, 2, 3, 4]


def test_requests_of_ended_loop_do_not_block_the_window() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()

    async def two(number: int) -> None:
        enqueue(window, [number] * 2, 1, sent)

    asyncio.run(two(0))
    asyncio.run(two(1))
    assert sent == [0, 1]


@pytest.mark.every_transport
async def test_request_queue_of_server_is_shared_between_client_nodes(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(services, "service_endpoint_qos", lambda qos: SERVICES_DEFAULT.keep_last(10))
        server = world.node("server").create_service(AddTwoInts, "add")
    nodes = [world.node() for _ in range(3)]
    clients = [node.create_client(AddTwoInts, "add") for node in (*nodes, nodes[0])]
    for client in clients:
        assert await client.wait_for_service(timeout_s=20)
    depths = lambda: [c.service_is_available() and transport_end_of(c).servers().request_queue_depth for c in clients]  # noqa: E731
    await until(lambda: depths() == [3] * 4)
    nodes[2].close()
    del clients[2:]
    await until(lambda: depths() == [5] * 2)
    server.close()


async def test_window_grows_with_replies_after_discovery_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enqueue(window, range(40), 10, sent)
    assert len(sent) == 3
    window.on_response(1)
    assert len(sent) - 1 == 3
    monkeypatch.setattr(flow_control, "DISCOVERY_SETTLE_S", 0.0)
    for number in range(2, 6):
        window.on_response(number)
    assert len(sent) - 5 == 7
    for number in range(6, 21):
        window.on_response(number)
    assert len(sent) - 20 == 10
    window.server_queue_depth = 4
    window.on_response(23)
    assert len(sent) == 30
    window.on_response(27)
    assert len(sent) == 31
