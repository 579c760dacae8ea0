"""Who hears of what a parameter store holds, and when.

Decides that nobody hears of declarations that are made together (a batch) before all of them are made, and never of
those that were taken back. Events are passed on while the store is locked, so in the order of the sets; post-set
callbacks are called without any lock.
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
    """What one thread does until nobody has to wait for it any more."""

    events: list[ParameterEvent] = field(default_factory=list)
    sets: list[list[Parameter]] = field(default_factory=list)

    def discard(self, names: Collection[str]) -> None:
        """Nobody shall hear of these."""
        if names:
            self.events = [left for event in self.events if (left := event.without(names))]
            kept = ([item for item in parameters if item.name not in names] for parameters in self.sets)
            self.sets = [parameters for parameters in kept if parameters]


class Notifier:
    """Passes events on to `on_event`, and what was set to the post-set callbacks (`after_set`)."""

    def __init__(
        self,
        on_event: Callable[[ParameterEvent], None],
        after_set: Callable[[Sequence[Parameter]], None],
        on_failure: Callable[[str], None],
    ) -> None:
        self._on_event = on_event
        self._after_set = after_set
        self._on_failure = on_failure
        self._here = threading.local()

    def event(self, event: ParameterEvent) -> None:
        """Something is stored; the store is locked."""
        batch = getattr(self._here, "batch", None)
        if batch is not None:
            batch.events.append(event)
            return
        try:
            self._on_event(event)
        except Exception:
            self._on_failure("publishing what was set")

    def after_set(self, parameters: Sequence[Parameter]) -> None:
        """Something was set; the store is not locked any more, unless this thread has a batch."""
        batch = getattr(self._here, "batch", None)
        if batch is not None:
            batch.sets.append(list(parameters))
        else:
            self._after_set(parameters)

    @contextlib.contextmanager
    def batch(self, lock: contextlib.AbstractContextManager[object]) -> Iterator[ChangeBatch]:
        """Keep everything back until the block, which runs under `lock`, ends."""
        batch, outer = ChangeBatch(), getattr(self._here, "batch", None)
        try:
            with lock:
                self._here.batch = batch
                try:
                    yield batch
                finally:
                    self._here.batch = outer
                    for event in batch.events:
                        self.event(event)
        finally:
            with contextlib.ExitStack() as calls:  # all of them are called, whatever one of them raises
                for parameters in reversed(batch.sets):
                    calls.callback(self.after_set, parameters)
