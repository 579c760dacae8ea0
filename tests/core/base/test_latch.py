"""`Latch`, and registrations and waiters that several threads use."""

from __future__ import annotations

import asyncio
from functools import partial

from support.parallel_threads import in_threads

from rosidl_py_gen.base.callbacks import Registration, RegistrationSet
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.runtime.transport.latch import Latch


def test_only_the_first_call_sets_a_latch() -> None:
    latch = Latch()
    assert not latch and latch.set() and latch and not latch.set()


def test_one_of_eight_threads_sets_a_latch() -> None:
    latches = [Latch() for _ in range(500)]
    results = in_threads(lambda _: [latch.set() for latch in latches])
    assert [sum(column) for column in zip(*results, strict=True)] == [1] * len(latches)


def test_registration_that_eight_threads_close_is_removed_once() -> None:
    removed: list[int] = []
    registrations = [Registration(partial(removed.append, number)) for number in range(300)]
    in_threads(lambda _: [registration.close() for registration in registrations])
    assert sorted(removed) == list(range(300))


def test_iteration_contains_items_that_stay_registered_while_threads_add_others() -> None:
    items: RegistrationSet[str] = RegistrationSet()
    items.add("first")
    items.add("second")

    def work(number: int) -> None:
        for _ in range(300):
            if number % 2:
                items.add(str(number)).close()
            else:
                assert list(items)[:2] == ["first", "second"]

    in_threads(work)
    assert list(items) == ["first", "second"]


def test_waiters_are_counted_while_other_threads_wake_them_up() -> None:
    waiters = Waiters()
    is_over = False

    async def wait() -> None:
        await asyncio.gather(*(waiters.wait(lambda: is_over) for _ in range(20)))

    def work(number: int) -> None:
        nonlocal is_over
        if number == 0:
            asyncio.run(wait())
            return
        for _ in range(300):
            bool(waiters)
            waiters.wake()
        is_over = True
        waiters.wake()

    in_threads(work, 4)
    assert not waiters
