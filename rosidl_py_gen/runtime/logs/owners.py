"""Which node a log record belongs to: the one registered for its logger or for the nearest ancestor of that.

So a child logger counts as its parent's node, and a node `a.b` is never taken for a node `a`. Source: protocol.md 9.7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


class LogOwners(Generic[T]):
    """Values by logger name; of two values for one name the older counts."""

    def __init__(self) -> None:
        self._values: dict[str, list[T]] = {}

    def add(self, logger_name: str, value: T) -> Callable[[], None]:
        """Returns the function that takes it away again, which may be called twice."""
        self._values.setdefault(logger_name, []).append(value)

        def remove() -> None:
            found = self._values.get(logger_name, [])
            if value in found:
                found.remove(value)
            if not found:
                self._values.pop(logger_name, None)

        return remove

    def find(self, logger_name: str) -> T | None:
        """The value for this name or its nearest ancestor; None when there is none."""
        while logger_name:
            found = self._values.get(logger_name)
            if found:
                return found[0]
            logger_name = logger_name.rpartition(".")[0]
        return None
