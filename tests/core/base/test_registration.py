"""Registrations: order, removal and iteration."""

from __future__ import annotations

from rosidl_py_gen.base.callbacks import RegistrationSet


def test_registered_items_stay_in_order_until_they_are_closed() -> None:
    registrations: RegistrationSet[str] = RegistrationSet()
    first, _ = registrations.add("a"), registrations.add("b")
    with registrations.add("c"):
        assert list(registrations) == ["a", "b", "c"] and len(registrations) == 3
    assert list(registrations) == ["a", "b"]
    first.close()
    first.close()
    assert list(registrations) == ["b"]
    with registrations.add("b"):  # an equal item is removed alone
        assert list(registrations) == ["b", "b"]
    assert list(registrations) == ["b"]


def test_iteration_skips_items_removed_or_added_during_it() -> None:
    registrations: RegistrationSet[str] = RegistrationSet()
    _, second = registrations.add("a"), registrations.add("b")
    seen = []
    for item in registrations:
        second.close()
        registrations.add("c")
        seen.append(item)
    assert seen == ["a"] and list(registrations) == ["a", "c"]
