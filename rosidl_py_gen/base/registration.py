"""What was handed in to be used later: keeping it in order, and taking it back.

Decides that any thread may add and remove while another goes through what is there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from typing_extensions import Self

T = TypeVar("T")


class Registration:
    """Something that was handed in, such as a callback; `close`, or the end of a ``with`` block, takes it back."""

    __slots__ = ("_remove",)

    def __init__(self, remove: Callable[[], object]) -> None:
        self._remove: Callable[[], object] | None = remove

    def close(self) -> None:
        """Take it back; may be called twice."""
        remove, self._remove = self._remove, None
        if remove is not None:
            remove()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RegistrationSet(Generic[T]):
    """What was added and not taken back, oldest first; what is taken back while somebody iterates is left out."""

    def __init__(self) -> None:
        self._items: dict[object, T] = {}

    def add(self, item: T) -> Registration:
        """Keep `item` until the answer is closed; one that is added twice counts twice."""
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
