"""Deferred sending after a response: order, and threads."""

from __future__ import annotations

import asyncio
import threading

from rosidl_py_gen.runtime import Context, MemoryTransport, Node
from rosidl_py_gen.runtime.loop.deferred_send import DeferredSender


def test_it_is_sent_when_the_loop_comes_round_and_at_once_elsewhere() -> None:
    sent: list[str] = []

    async def main() -> None:
        with Context(transport=MemoryTransport(), args=["p"]) as context:
            Node("n", context=context)
            context._core.loop_binding.running_loop()
            later = DeferredSender(context._core.loop_binding, sent.append)
            later.add("first")
            assert sent == []
            await asyncio.sleep(0)
            assert sent == ["first"]
            later.add("second")
            await asyncio.to_thread(later.add, "third")  # takes along what waits
            assert sent == ["first", "second", "third"]
            later.add("fourth")
            later.flush()
            assert sent[-1] == "fourth"

    asyncio.run(main())


def test_threads_send_one_after_the_other_each_in_its_order() -> None:
    sent: list[tuple[int, int]] = []
    with Context(transport=MemoryTransport(), args=["p"]) as context:
        later = DeferredSender(context._core.loop_binding, sent.append)
        threads = [
            threading.Thread(target=lambda n=number: [later.add((n, count)) for count in range(500)])
            for number in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(sent) == 2000
    for number in range(4):
        assert [count for who, count in sent if who == number] == list(range(500))
