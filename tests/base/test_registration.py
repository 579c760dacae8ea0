"""Registrations: order, removal and iteration."""

from __future__ import annotations

from rosidl_py_gen.base.callbacks import RegistrationSet


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
