"""Callback groups: the rules that decide which callbacks may run at the same time."""

from __future__ import annotations

import threading
import weakref
from threading import Lock
from typing import Any


class CallbackGroup:
    """Group of entities with a rule that decides which callbacks may run concurrently; programs may subclass it."""

    def __init__(self) -> None:
        super().__init__()
        self.entities: set[weakref.ref[Any]] = set()

    def add_entity(self, entity: Any) -> None:
        """Add a subscription, timer, client, service, guard condition or waitable, by a weak reference."""
        self.entities.add(weakref.ref(entity, self.entities.discard))

    def has_entity(self, entity: Any) -> bool:
        return weakref.ref(entity) in self.entities

    def can_execute(self, entity: Any) -> bool:
        """Return True if the callback of an entity may run now."""
        raise NotImplementedError

    def beginning_execution(self, entity: Any) -> bool:
        """Record that the callback of an entity starts; return False if the callback must not run."""
        raise NotImplementedError

    def ending_execution(self, entity: Any) -> None:
        """Record that the callback of an entity has finished."""
        raise NotImplementedError


class ReentrantCallbackGroup(CallbackGroup):
    """Group whose callbacks may all run concurrently, each of them also concurrently with itself."""

    def can_execute(self, entity: Any) -> bool:
        return True

    def beginning_execution(self, entity: Any) -> bool:
        return True

    def ending_execution(self, entity: Any) -> None:
        pass


class MutuallyExclusiveCallbackGroup(CallbackGroup):
    """Group that runs one callback at a time; an async callback occupies the group while it awaits."""

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
