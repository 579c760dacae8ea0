"""Polling interface of subscriptions, servers and timers, for programs that do not wait with asyncio.

Listeners are called on the event loop, once for each arrival. Arrived data stays in the queue of its entity until
`take`, `receive` or an iteration removes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.registration import RegistrationSet
from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import Entity
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.loop.user_functions import require_callable

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.registration import Registration


class CallbackInUseError(RosidlError, TypeError):
    """The program tries to receive from an entity that has a callback."""


class PollableEntity(Entity):
    """Entity with a method `take`."""

    _listeners: RegistrationSet[UserCallback] | None = None
    _on_arrival: Callable[[], None] | None = None
    """Calls the listeners; None until the first one is added."""

    @property
    def is_ready(self) -> bool:
        """True if data has arrived and was not taken yet; False after `close`."""
        return not self._closed and self._is_ready()

    def on_ready(self, function: Callable[[], object]) -> Registration:
        """Call a function without arguments when something can be taken, until the returned registration is closed.

        It is called on the event loop, or by the thread that runs the loop of a `LoopRunner`, for each arrival; and
        immediately, if something can be taken already. Arrivals may coincide, so take until `take` returns None. The
        function should only wake up the consumer: `LoopRunner.wake`, `threading.Event.set`. Its exceptions are logged
        like those of any callback.

        Raises:
            CallbackInUseError: the entity has a callback, which takes everything.
            ClosedError: the entity is closed.
            TypeError: `function` is not callable, or not without arguments.
        """
        subject = f"the on_ready function of {self._described()}"
        self._require_takeable()
        require_callable(function, subject)
        if function is None:
            raise TypeError(f"{subject} must be a function, got None")
        require_signature(function, subject)
        if self._listeners is None:
            self._listeners = RegistrationSet()
        listener = UserCallback(self._scope, function, subject)
        registration = self._listeners.add(listener)
        self._on_arrival = self._notify_ready
        if self._is_ready():
            listener.call()
        return registration

    def _notify_ready(self) -> None:
        for listener in self._listeners or ():
            listener.call()

    def _described(self) -> str:
        """Return the entity's kind and name for errors."""
        raise NotImplementedError

    def _require_takeable(self) -> None:
        """Raise `CallbackInUseError` or `ClosedError`."""
        raise NotImplementedError

    def _is_ready(self) -> bool:
        raise NotImplementedError
