"""Registrations: order, removal, iteration and threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from rosidl_py_gen.base.callbacks import Registration, RegistrationSet


def test_what_is_added_stays_in_order_until_it_is_closed() -> None:
    kept: RegistrationSet[str] = RegistrationSet()
    first, _ = kept.add("a"), kept.add("b")
    with kept.add("c"):
        assert list(kept) == ["a", "b", "c"] and len(kept) == 3
    assert list(kept) == ["a", "b"]
    first.close()
    first.close()
    assert list(kept) == ["b"]
    with kept.add("b"):  # an equal item is removed alone
        assert list(kept) == ["b", "b"]
    assert list(kept) == ["b"]


def test_while_somebody_iterates_what_goes_is_left_out_and_what_comes_waits() -> None:
    kept: RegistrationSet[str] = RegistrationSet()
    _, second = kept.add("a"), kept.add("b")
    seen = []
    for item in kept:
        second.close()
        kept.add("c")
        seen.append(item)
    assert seen == ["a"] and list(kept) == ["a", "c"]


def test_threads_that_add_and_close_lose_nothing() -> None:
    kept: RegistrationSet[int] = RegistrationSet()

    def add_and_close(number: int) -> Registration:
        for _ in range(200):
            kept.add(-1).close()
        return kept.add(number)

    with ThreadPoolExecutor(8) as pool:
        added = list(pool.map(add_and_close, range(64)))
        assert sorted(kept) == list(range(64))
        list(pool.map(Registration.close, added))
    assert not kept
