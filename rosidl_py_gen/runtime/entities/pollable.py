"""Polling interface of subscriptions, servers and timers, for programs that do not wait with asyncio.

Listeners are called on the event loop, once for each arrival. Arrived data stays in the queue of its entity until
`take`, `receive` or an iteration removes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.callbacks import RegistrationSet, require_signature
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import Entity
from rosidl_py_gen.runtime.loop.user_callback import UserCallback, require_callable

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.callbacks import Registration
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope


QOS_HINT = "; QoS is given as qos=..."


def user_callback(
    scope: EntityScope,
    function: Callable[..., object] | None,
    subject: str,
    *arguments: str,
    hint: str = "",
    type_hint: str = "",
) -> UserCallback | None:
    """Return the callback of a user's function, which may be None; raises as `require_callable`, `require_signature`.

    `type_hint` ends the error about an object that is no function, `hint` that about other arguments.
    """
    require_callable(function, subject, type_hint)
    if function is None:
        return None
    require_signature(function, subject, *arguments, hint=hint)
    return UserCallback(scope, function, subject)


class CallbackInUseError(RosidlError, TypeError):
    """The program tries to receive from an entity that has a callback."""


class PollableEntity(Entity):
    """Entity with a method `take`."""

    _callback: UserCallback | None
    """Takes everything, if there is one."""
    _contents = "messages"
    """Noun for the data that the callback takes, for errors."""
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
        listener = user_callback(self._scope, function, subject)
        if listener is None:
            raise TypeError(f"{subject} must be a function, got None")
        if self._listeners is None:
            self._listeners = RegistrationSet()
        registration = self._listeners.add(listener)
        self._on_arrival = self._notify_ready
        if self._is_ready():
            listener.call()
        return registration

    def _notify_ready(self) -> None:
        for listener in self._listeners or ():
            listener.call()

    def _require_no_callback(self) -> None:
        if self._callback is not None:
            raise CallbackInUseError(
                f"{self._described()} has a callback; its {self._contents} cannot be taken as well"
            )

    def _require_takeable(self) -> None:
        """Raise `CallbackInUseError` or `ClosedError`."""
        self._require_no_callback()
        self._require_open()

    def _is_ready(self) -> bool:
        raise NotImplementedError
