"""Which callbacks may run at the same time. Executors ask; programs may derive groups of their own."""

from __future__ import annotations

import threading
import weakref
from threading import Lock  # noqa: F401
from typing import Any


class CallbackGroup:
    """Callbacks with a rule about which of them may run at the same time. Entities are kept by weak references."""

    def __init__(self) -> None:
        super().__init__()
        self.entities: set[weakref.ref[Any]] = set()

    def add_entity(self, entity: Any) -> None:
        """Take in a subscription, timer, client, service, guard condition or waitable."""
        self.entities.add(weakref.ref(entity, self.entities.discard))

    def has_entity(self, entity: Any) -> bool:
        """Whether it was taken in."""
        return weakref.ref(entity) in self.entities

    def can_execute(self, entity: Any) -> bool:
        """Whether the callback of an entity may run now."""
        raise NotImplementedError

    def beginning_execution(self, entity: Any) -> bool:
        """Note that the callback of an entity is about to run; False when it may not."""
        raise NotImplementedError

    def ending_execution(self, entity: Any) -> None:
        """Note that the callback of an entity is over."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """All callbacks may run at the same time, each of them several times."""

    def can_execute(self, entity: Any) -> bool:
        return True

    def beginning_execution(self, entity: Any) -> bool:
        return True

    def ending_execution(self, entity: Any) -> None:
        pass


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """One callback at a time; one that awaits something holds the group meanwhile."""

    def __init__(self) -> None:
        super().__init__()
        self._active_entity: Any = None
        self._lock = threading.Lock()

    def can_execute(self, entity: Any) -> bool:
        assert weakref.ref(entity) in self.entities
        return self._active_entity is None

    def beginning_execution(self, entity: Any) -> bool:
        with self._lock:
            assert weakref.ref(entity) in self.entities
            if self._active_entity is not None:
                return False
            self._active_entity = entity
            return True

    def ending_execution(self, entity: Any) -> None:
        with self._lock:
            assert self._active_entity == entity
            self._active_entity = None
