"""Send queues: samples that DDS does not accept at once, and samples that are sent after a reply."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rosidl_py_gen.runtime import Context, MemoryTransport
from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop
from rosidl_py_gen.runtime.loop.queues import DeferredSender, SendQueue
from rosidl_py_gen.runtime.node.context import core_of
from rosidl_py_gen.runtime.transport.api import TransportError


class Line:
    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self.is_full = False
        self.sent: list[int] = []

    def call_soon(self, function: Callable[[], None]) -> None:
        if self.loop is not None:
            self.loop.call_soon(function)

    def write(self, number: int) -> Callable[[], bool]:
        def write() -> bool:
            if not self.is_full:
                if number == 13:
                    raise TransportError("no thirteen")
                self.sent.append(number)
            return not self.is_full

        return write


def send_queue_of(line: Line, depth: int | None = None) -> tuple[SendQueue, list[str]]:
    reports: list[str] = []
    loop_binding: Any = line
    return SendQueue(loop_binding, depth, reports.append), reports


def test_queued_samples_are_sent_in_order_by_the_loop() -> None:
    async def main() -> None:
        line = Line()
        line.loop = asyncio.get_running_loop()
        send_queue, reports = send_queue_of(line)
        for number in (1, 2, 13, 3):
            line.is_full = number > 1
            send_queue.send(line.write(number))
        assert line.sent == [1] and len(send_queue.waiting) == 3
        await asyncio.sleep(0.01)
        line.is_full = False
        send_queue.send(line.write(4))  # queued after the others although the writer has room
        await asyncio.sleep(0.02)
        assert line.sent == [1, 2, 3, 4] and reports == ["sending a delayed sample"] and send_queue.dropped == 1

    VirtualTimeLoop().run(main())


def test_full_send_queue_drops_oldest_and_closed_queue_drops_all() -> None:
    line = Line()
    line.is_full = True
    send_queue, _ = send_queue_of(line, 2)
    for number in range(5):
        send_queue.send(line.write(number))
    line.is_full = False
    assert send_queue.dropped == 3 and send_queue.flush() and line.sent == [3, 4]
    line.is_full = True
    send_queue.send(line.write(5))
    send_queue.close()
    line.is_full = False
    assert send_queue.flush() and line.sent == [3, 4]


def test_samples_left_by_an_ended_loop_are_sent_on_the_next_loop() -> None:
    line = Line()
    send_queue, _ = send_queue_of(line)

    async def send(number: int, *, is_full: bool) -> None:
        line.loop, line.is_full = asyncio.get_running_loop(), is_full
        send_queue.send(line.write(number))
        await asyncio.sleep(0.01)

    VirtualTimeLoop().run(send(1, is_full=True))
    VirtualTimeLoop().run(send(2, is_full=False))
    assert line.sent == [1, 2]


def test_deferred_sender_preserves_the_order_of_each_thread() -> None:
    sent: list[tuple[int, int]] = []
    with Context(transport=MemoryTransport(), args=["p"]) as context:
        later = DeferredSender(core_of(context).loop_binding, sent.append)
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda number: [later.add((number, count)) for count in range(500)], range(4)))
    assert len(sent) == 2000
    for number in range(4):
        assert [count for thread_number, count in sent if thread_number == number] == list(range(500))
