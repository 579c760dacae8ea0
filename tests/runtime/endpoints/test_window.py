"""When a request may be sent to a server that keeps few of them."""

from __future__ import annotations

import asyncio
import time
from functools import partial

from rosidl_py_gen.runtime.endpoints.window import RequestWindow


def send(sent: list[int], number: int) -> bool:
    """A request that is wanted."""
    sent.append(number)
    return True


def test_the_next_burst_begins_when_the_last_one_is_answered() -> None:
    async def main() -> None:
        window, sent = RequestWindow(5), []
        for number in range(7):
            window.enter(partial(send, sent, number), 3)
        assert sent == [0, 1, 2]
        window.leave()
        window.leave()
        await asyncio.sleep(0.01)
        assert sent == [0, 1, 2]
        window.leave()
        assert sent == [0, 1, 2, 3, 4, 5]
        for _ in range(3):
            window.leave()
        assert sent == list(range(7))

    asyncio.run(main())


def test_without_answers_it_begins_after_a_pause() -> None:
    async def main() -> None:
        window, sent = RequestWindow(0.1), []
        started = time.monotonic()
        for number in range(5):
            window.enter(partial(send, sent, number), 2)
        while len(sent) < 5:
            await asyncio.sleep(0.001)
        assert sent == list(range(5)) and time.monotonic() - started >= 0.195

    asyncio.run(main())


def test_a_request_that_nobody_wants_any_more_takes_nobodys_place() -> None:
    async def main() -> None:
        window, sent = RequestWindow(5), []
        for number in range(4):
            window.enter(partial(send, sent, number) if number != 1 else lambda: False, 1)
        window.leave()
        assert sent == [0, 2]
        window.leave()
        assert sent == [0, 2, 3]

    asyncio.run(main())


def test_what_waited_on_a_loop_that_ended_stands_in_nobodys_way() -> None:
    window, sent = RequestWindow(5), []

    async def enter(number: int) -> None:
        for _ in range(2):
            window.enter(partial(send, sent, number), 1)

    asyncio.run(enter(0))
    asyncio.run(enter(1))
    assert sent == [0, 1]
