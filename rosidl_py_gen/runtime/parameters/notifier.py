"""Delivery of the events of a parameter store, and of its post-set calls.

The events of a batch of declarations are held back until all are made, and dropped if the batch fails. Events are
delivered while the store is locked, thus in the order of the sets; post-set callbacks are called without a lock.
"""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from rosidl_py_gen.runtime.parameters.values import Parameter, ParameterEvent


@dataclass(slots=True)
class ChangeBatch:
    """Events and post-set calls of one thread that are held back."""

    events: list[ParameterEvent] = field(default_factory=list)
    sets: list[list[Parameter]] = field(default_factory=list)

    def discard(self, names: Collection[str]) -> None:
        """Drop all that concerns these parameters."""
        if names:
            self.events = [rest for event in self.events if (rest := event.without(names))]
            sets = ([item for item in parameters if item.name not in names] for parameters in self.sets)
            self.sets = [parameters for parameters in sets if parameters]


class Notifier:
    """Passes events to `on_event`, and the parameters of sets to `after_set`, which calls the post-set callbacks."""

    def __init__(
        self,
        on_event: Callable[[ParameterEvent], None],
        after_set: Callable[[Sequence[Parameter]], None],
        on_failure: Callable[[str], None],
    ) -> None:
        self._on_event = on_event
        self._after_set = after_set
        self._on_failure = on_failure
        self._thread = threading.local()

    def event(self, event: ParameterEvent) -> None:
        """Deliver an event, or add it to the batch. Lock: the store's must be held."""
        batch = getattr(self._thread, "batch", None)
        if batch is not None:
            batch.events.append(event)
            return
        try:
            self._on_event(event)
        except Exception:
            self._on_failure("publishing a parameter event")

    def after_set(self, parameters: Sequence[Parameter]) -> None:
        """Call the post-set callbacks, or add the call to the batch. Lock: only with a batch."""
        batch = getattr(self._thread, "batch", None)
        if batch is not None:
            batch.sets.append(list(parameters))
        else:
            self._after_set(parameters)

    @contextlib.contextmanager
    def batch(self, lock: contextlib.AbstractContextManager[object]) -> Iterator[ChangeBatch]:
        """Run a block under `lock`, and hold back events and calls until it ends."""
        batch, outer = ChangeBatch(), getattr(self._thread, "batch", None)
        try:
            with lock:
                self._thread.batch = batch
                try:
                    yield batch
                finally:
                    self._thread.batch = outer
                    for event in batch.events:
                        self.event(event)
        finally:
            with contextlib.ExitStack() as calls:  # makes all calls even if one raises
                for parameters in reversed(batch.sets):
                    calls.callback(self.after_set, parameters)
