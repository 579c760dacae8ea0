"""Being told that something can be taken, for programs that do not wait with asyncio.

Decides when: once for each arrival, on the loop, and at once for who asks when something is there already. Nothing is
kept here: what arrived stays in the queue of its endpoint until `take`, `receive` or an iteration gets it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.registration import RegistrationSet
from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import Entity
from rosidl_py_gen.runtime.loop.callable_checks import require_callable
from rosidl_py_gen.runtime.loop.user_callback import UserCallback

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.registration import Registration


class CallbackInUseError(RosidlError, TypeError):
    """The caller wants to receive from something that has a callback."""


class PollableEntity(Entity):
    """What has a `take`."""

    _listeners: RegistrationSet[UserCallback] | None = None
    _tell: Callable[[], None] | None = None
    """Calls the listeners, if there ever was one."""

    @property
    def is_ready(self) -> bool:
        """True when `take` would look at something: it has arrived and was not taken; False after `close`."""
        return not self._closed and self._is_ready()

    def on_ready(self, function: Callable[[], object]) -> Registration:
        """Have a function called, without arguments, when something can be taken, until the answer is closed.

        It is called on the event loop, or by whoever runs that of a `Driver`, for each arrival, however much arrived
        together; and here and now, if something is there already. So take until there is None. It should only note
        that, or wake somebody: `Driver.wake`, `threading.Event.set`. What it raises is logged, as of any callback.

        Raises:
            CallbackInUseError: there is a callback, which takes everything. ClosedError, TypeError: as they say.
        """
        what = f"the on_ready function of {self._described()}"
        self._require_takeable()
        require_callable(function, what)
        if function is None:
            raise TypeError(f"{what} must be a function, got None")
        require_signature(function, what)
        if self._listeners is None:
            self._listeners = RegistrationSet()
        registration = self._listeners.add(told := UserCallback(self._scope, function, what))
        self._tell = self._notify_ready
        if self._is_ready():
            told.call()
        return registration

    def _notify_ready(self) -> None:
        for function in self._listeners or ():
            function.call()

    def _described(self) -> str:
        raise NotImplementedError

    def _require_takeable(self) -> None:
        """Raise `CallbackInUseError` or `ClosedError`."""
        raise NotImplementedError

    def _is_ready(self) -> bool:
        raise NotImplementedError
