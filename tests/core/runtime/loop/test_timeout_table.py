"""Many timeouts with one timer."""

from __future__ import annotations

import asyncio
from typing import Any

from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop
from rosidl_py_gen.runtime.transport.flow_control import TimeoutTable


class CountingLoop(VirtualTimeLoop):
    timers = 0

    def call_at(self, *args: Any, **kwargs: Any) -> asyncio.TimerHandle:  # type: ignore[override]
        self.timers += 1
        return super().call_at(*args, **kwargs)


def run_timeouts(seconds: float, limits_s: dict[int, float], remove: tuple[int, ...] = ()) -> tuple[list[int], int]:
    """Return the numbers that expired in a time, and the number of timers."""
    loop, expired = CountingLoop(), list[int]()
    limits = TimeoutTable(loop, expired.append)
    for number, left_s in limits_s.items():
        limits.add(number, left_s)
    for number in remove:
        limits.remove(number)
    loop.run(asyncio.sleep(seconds))
    return expired, loop.timers - (seconds > 0)  # the sleep uses one timer


def test_timeouts_expire_once_in_order_of_time() -> None:
    assert run_timeouts(0.15, {1: 0.1, 2: 0.05, 3: 0.0, 4: 10.0})[0] == [3, 2, 1]


def test_removed_timeouts_never_expire() -> None:
    assert run_timeouts(0.1, {1: 0.02, 2: 0.04, 3: 0.06}, remove=(2, 7)) == ([1, 3], 2)


def test_a_thousand_timeouts_need_few_loop_timers() -> None:
    assert run_timeouts(0.0, dict.fromkeys(range(1000), 5.0), remove=tuple(range(1000))) == ([], 1)
    expired, timers = run_timeouts(0.1, {number: 0.02 + number * 1e-5 for number in range(1000)})
    assert sorted(expired) == list(range(1000)) and timers <= 25


def test_expiry_callback_can_add_and_remove_timeouts() -> None:
    loop, expired = CountingLoop(), list[int]()

    def expire(number: int) -> None:
        expired.append(number)
        limits.remove(2)
        if number < 5:
            limits.add(number + 4, 0.01)

    limits = TimeoutTable(loop, expire)
    limits.add(1, 0.01)
    limits.add(2, 0.0105)  # due in the same check
    loop.run(asyncio.sleep(0.05))
    assert expired == [1, 5]
