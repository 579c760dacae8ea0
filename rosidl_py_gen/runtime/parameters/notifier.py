"""Who hears of what a parameter store holds, and when.

Decides that declarations that are made together are told once all of them are made, and that those which are taken
back are not told at all. Events are told while the store is locked, so in the order of the sets; post-set callbacks
are called without any lock.
"""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rosidl_py_gen.runtime.parameters.values import Parameter, ParameterEvent


@dataclass(slots=True)
class Held:
    """What one thread keeps to itself for now."""

    events: list[ParameterEvent] = field(default_factory=list)
    told: list[Sequence[Parameter]] = field(default_factory=list)
    withdrawn: list[str] = field(default_factory=list)
    """Names nobody shall hear of."""
    thread: int = field(default_factory=threading.get_ident)


class News:
    """Tells `on_event` and the post-set callbacks (`tell`) what was set."""

    def __init__(
        self,
        on_event: Callable[[ParameterEvent], None],
        tell: Callable[[Sequence[Parameter]], None],
        on_failure: Callable[[str], None],
    ) -> None:
        self._on_event = on_event
        self._tell = tell
        self._on_failure = on_failure
        self._held: Held | None = None

    def announce(self, event: ParameterEvent) -> None:
        """Tell of what is stored; the store is locked."""
        if self._held is not None:
            self._held.events.append(event)
            return
        try:
            self._on_event(event)
        except Exception:
            self._on_failure("publishing what was set")

    def tell(self, parameters: Sequence[Parameter]) -> None:
        """Call the post-set callbacks; the store is not locked, unless this thread holds things back."""
        held = self._held
        if held is not None and held.thread == threading.get_ident():
            held.told.append(parameters)
        else:
            self._tell(parameters)

    @contextlib.contextmanager
    def held_until(self, lock: contextlib.AbstractContextManager[object]) -> Iterator[Held]:
        """Keep everything back until the block ends, under `lock`, but for what is `withdrawn` then."""
        held = Held()
        try:
            with lock:
                outer, self._held = self._held, held
                try:
                    yield held
                finally:
                    self._held = outer
                    for event in held.events:
                        left = event.without(held.withdrawn)
                        if left or not held.withdrawn:
                            self.announce(left)
        finally:
            for parameters in held.told:
                known = [parameter for parameter in parameters if parameter.name not in held.withdrawn]
                if known:
                    self.tell(known)
