"""Entities that follow the transitions of a lifecycle node."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from rclpy._rclpy_pybind11 import TransitionCallbackReturnType

TransitionCallbackReturn = TransitionCallbackReturnType


class ManagedEntity:
    """Base of entities that follow the transitions of a lifecycle node, and by default accept every transition.

    Subclasses override methods, whose argument `state` is the previous `LifecycleState`.
    """

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Accept the transition to inactive by returning SUCCESS; an override may return FAILURE or ERROR.

        The methods `on_cleanup`, `on_shutdown`, `on_activate` and `on_deactivate` do the same for their transitions.
        `on_error` follows a callback that raised or returned ERROR.
        """
        return TransitionCallbackReturn.SUCCESS

    on_cleanup = on_shutdown = on_activate = on_deactivate = on_error = on_configure


class SimpleManagedEntity(ManagedEntity):
    """Managed entity that is either active or inactive."""

    def __init__(self) -> None:
        self._enabled = False

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        self._enabled = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        self._enabled = False
        return TransitionCallbackReturn.SUCCESS

    @property
    def is_activated(self) -> bool:
        return self._enabled

    @staticmethod
    def when_enabled(
        wrapped: Callable[..., Any] | None = None, *, when_not_enabled: Callable[[], Any] | None = None
    ) -> Callable[..., Any]:
        """Decorate a method that must run only while the entity is active; otherwise `when_not_enabled()` is called."""

        def decorate(method: Callable[..., Any]) -> Callable[..., None]:
            @wraps(method)
            def only_when_enabled(self: SimpleManagedEntity, *args: Any, **kwargs: Any) -> None:
                if self._enabled:
                    method(self, *args, **kwargs)
                elif when_not_enabled is not None:
                    when_not_enabled()

            return only_when_enabled

        return decorate if wrapped is None else decorate(wrapped)
