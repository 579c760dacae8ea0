"""Flow control of requests to a server with a short queue."""

from __future__ import annotations

import asyncio
import logging
from functools import partial
from typing import TYPE_CHECKING

import pytest
from example_interfaces.srv import AddTwoInts
from support.node_fixtures import until

from rosidl_py_gen.runtime.entities import flow_control as windows
from rosidl_py_gen.runtime.entities import service_common as service
from rosidl_py_gen.runtime.entities.flow_control import RequestFlowControl
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Iterable

    from support.node_fixtures import World


def enter(window: RequestFlowControl, numbers: Iterable[int], kept: int, sent: list[int]) -> None:
    """Enqueue requests; `sent` gets the numbers of those that are sent."""

    def send(number: int, turn: int) -> bool:
        sent.append(number)
        assert turn == len(sent)
        return True

    for number in numbers:
        window.acquire(partial(send, number), kept)


async def test_an_answer_makes_room_for_as_many_as_were_sent_before_it() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enter(window, range(10), 3, sent)
    assert sent == [0, 1, 2]
    window.on_response(1)
    assert sent == [0, 1, 2, 3]
    window.on_response(3)  # so the one between them has been taken, too
    assert sent == [0, 1, 2, 3, 4, 5]
    window.on_response(2)
    assert sent == [0, 1, 2, 3, 4, 5]
    window.on_response(6)
    assert sent == list(range(9))


async def test_an_answer_says_nothing_of_what_others_sent() -> None:
    window, sent = RequestFlowControl("/add"), list[str]()
    for client in ("a", "b"):
        for number in range(3):

            def send(turn: int, name: str = f"{client}{number}") -> bool:
                sent.append(name)
                return True

            window.acquire(send, 3, client)
    assert sent == ["a0", "a1", "a2"]
    window.on_response(2, "a")
    assert sent[3:] == ["b0", "b1"]
    window.on_response(5, "b")  # b1, and b0 before it, but not a2
    assert sent[5:] == ["b2"]
    window.acquire(lambda turn: sent.append("b3") is None, 3, "b")
    window.acquire(lambda turn: sent.append("b4") is None, 3, "b")
    assert sent[6:] == ["b3"]
    window.on_response(3, "a")
    assert sent[7:] == ["b4"]


async def test_what_is_given_up_makes_room_for_one() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enter(window, range(6), 3, sent)
    window.release(2)
    assert sent == [0, 1, 2, 3]
    window.release(2)
    window.on_response(2)
    assert sent == [0, 1, 2, 3, 4]


async def test_without_any_answer_one_more_is_sent_after_long_and_a_warning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(windows, "STALL_TIMEOUT_S", 0.2)
    window, sent = RequestFlowControl("/add"), list[int]()
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    enter(window, range(6), 3, sent)
    with caplog.at_level(logging.WARNING):
        await until(lambda: len(sent) == 5)
    assert loop.time() - began_s >= 0.6 and sent == list(range(5)), "each takes twice as long as the last"
    assert "no server of /add replied for 0.2 s; 3 calls are waiting" in caplog.text
    window.on_response(5)
    assert sent == list(range(6)) and window.stall_timeout_s == 0.2


async def test_answers_make_a_slow_server_one_that_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enter(window, range(9), 3, sent)
    loop, passed_s = asyncio.get_running_loop(), 0.0
    now = loop.time
    monkeypatch.setattr(loop, "time", lambda: now() + passed_s)
    for number in (1, 2, 3):
        passed_s += 9
        window.on_response(number)
        await asyncio.sleep(0)
        assert len(sent) == 3 + number


async def test_servers_that_only_note_requests_get_them_after_a_pause() -> None:
    window, sent = RequestFlowControl("/result", 0.02), list[int]()
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    enter(window, range(5), 2, sent)
    assert sent == [0, 1]
    await until(lambda: len(sent) == 5)
    assert loop.time() - began_s >= 0.039


async def test_a_request_that_nobody_wants_any_more_takes_nobodys_place() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()

    def send(number: int, turn: int) -> bool:
        sent.append(turn)
        return number != 1

    for number in range(4):
        window.acquire(partial(send, number), 1)
    window.on_response(sent[-1])
    assert sent == [1, 2, 3]
    window.on_response(sent[-1])
    assert sent == [1, 2, 3, 4]


def test_what_waited_on_a_loop_that_ended_stands_in_nobodys_way() -> None:
    window, sent = RequestFlowControl("/add"), list[int]()

    async def two(number: int) -> None:
        enter(window, [number] * 2, 1, sent)

    asyncio.run(two(0))
    asyncio.run(two(1))
    assert sent == [0, 1]


@pytest.mark.every_transport
async def test_what_a_server_keeps_is_shared_by_all_who_have_clients(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(service, "service_endpoint_qos", lambda qos: SERVICES_DEFAULT.keep_last(10))
        server = world.node("server").create_service(AddTwoInts, "add")
    nodes = [world.node() for _ in range(3)]
    clients = [node.create_client(AddTwoInts, "add") for node in (*nodes, nodes[0])]
    for client in clients:
        assert await client.wait_for_service(timeout_s=5)
    depths = lambda: [c.service_is_available() and c._transport_client.servers().request_queue_depth for c in clients]  # noqa: E731
    await until(lambda: depths() == [3] * 4)
    nodes[2].close()
    del clients[2:]
    await until(lambda: depths() == [5] * 2)
    server.close()


async def test_room_grows_with_answers_once_others_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    window, sent = RequestFlowControl("/add"), list[int]()
    enter(window, range(40), 10, sent)
    assert len(sent) == 3
    window.on_response(1)
    assert len(sent) - 1 == 3
    monkeypatch.setattr(windows, "DISCOVERY_SETTLE_S", 0.0)
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
