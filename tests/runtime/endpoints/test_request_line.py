"""When a request may be sent to a server that keeps few of them."""

from __future__ import annotations

import asyncio
import time

from rosidl_py_gen.runtime.endpoints.window import RequestLine


def test_the_next_burst_begins_when_the_last_one_is_answered() -> None:
    async def main() -> None:
        line, sent = RequestLine(), []

        async def call(number: int) -> None:
            assert await line.take_turn(asyncio.get_running_loop().create_future(), 3)
            sent.append(number)

        tasks = [asyncio.ensure_future(call(number)) for number in range(7)]
        started = time.monotonic()
        await asyncio.sleep(0)
        assert sent == [0, 1, 2]
        line.over()
        line.over()
        await asyncio.sleep(0.01)
        assert sent == [0, 1, 2]
        line.over()
        await asyncio.wait(tasks[3:6], timeout=0.05)
        assert sent == [0, 1, 2, 3, 4, 5]
        assert time.monotonic() - started < 0.1
        for _ in range(3):
            line.over()
        await asyncio.gather(*tasks)

    asyncio.run(main())


def test_without_answers_it_begins_after_a_pause() -> None:
    async def main() -> None:
        line = RequestLine()
        started = time.monotonic()
        for _ in range(3):
            assert await line.take_turn(asyncio.get_running_loop().create_future(), 2)
        assert time.monotonic() - started >= 0.095

    asyncio.run(main())


def test_a_call_whose_time_is_over_leaves_the_line_and_takes_nobodys_place() -> None:
    async def main() -> None:
        line, loop = RequestLine(), asyncio.get_running_loop()
        assert await line.take_turn(loop.create_future(), 1)
        expired = loop.create_future()
        waiting = asyncio.ensure_future(line.take_turn(expired, 1))
        after = asyncio.ensure_future(line.take_turn(loop.create_future(), 1))
        await asyncio.sleep(0)
        expired.set_result(None)
        assert await asyncio.wait_for(waiting, 0.05) is False
        line.over()
        assert await asyncio.wait_for(after, 0.05)

    asyncio.run(main())
