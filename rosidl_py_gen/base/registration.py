"""Registered objects, such as callbacks, that can be removed. Thread: any."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self

T = TypeVar("T")


class Registration:
    """A registered object, such as a callback; `close` or the end of a ``with`` block removes it."""

    __slots__ = ("_remove",)

    def __init__(self, remove: Callable[[], object]) -> None:
        self._remove: Callable[[], object] | None = remove

    def close(self) -> None:
        """Remove the object; may be called twice."""
        remove, self._remove = self._remove, None
        if remove is not None:
            remove()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RegistrationSet(Generic[T]):
    """Registered objects, oldest first; an iteration skips objects that are removed during it."""

    def __init__(self) -> None:
        self._items: dict[object, T] = {}

    def add(self, item: T) -> Registration:
        """Add an object until the registration is closed; an object may be added several times."""
        key = object()
        self._items[key] = item
        return Registration(lambda: self._items.pop(key, None))

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[T]:
        items = tuple(self._items.items())
        return self._all(items) if len(items) > 1 else iter([item for _, item in items])

    def _all(self, items: tuple[tuple[object, T], ...]) -> Iterator[T]:
        for key, item in items:
            if key in self._items:
                yield item
