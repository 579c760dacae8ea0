"""Contexts, which are open from `rclpy.init` to `rclpy.shutdown`: the class `Context`."""

from __future__ import annotations

import atexit
import inspect
import re
import sys
import threading
import weakref
from collections.abc import Callable
from inspect import ismethod
from types import MethodType, TracebackType
from typing import TYPE_CHECKING, Any, ContextManager, List, Optional, Protocol, Type, Union
from weakref import WeakMethod

from rclpy._rclpy_pybind11 import RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.destroyable import DestroyableType
from rclpy.handles import ContextHandle
from rosidl_py_gen import runtime

_open_contexts: set[ContextHandle] = set()


class Context:
    """Membership of a process in a domain, from `init` to `shutdown`; it cannot be opened again.

    Example:
        >>> with Context() as context:  # doctest: +SKIP
        ...     context.ok()
        True
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._callbacks: list[Callable[[], Any]] = []
        self._rosidl_context: ContextHandle | None = None

    @property
    def handle(self) -> ContextHandle | None:
        """Handle of the context of rosidl_py_gen.runtime; None before `init`."""
        return self._rosidl_context

    def destroy(self) -> None:
        """Leave the domain as soon as no entity uses the context."""
        if self._rosidl_context is not None:
            self._rosidl_context.destroy_when_not_in_use()

    def init(
        self, args: list[str] | None = None, *, initialize_logging: bool = True, domain_id: int | None = None
    ) -> None:
        """Open the context.

        Args:
            args: command line with ``--ros-args``. [default: `sys.argv`]
            initialize_logging: without effect, because logging needs no context here.
            domain_id: domain. [default: ``ROS_DOMAIN_ID``, else 0]

        Raises:
            RuntimeError: the context was opened before, or `domain_id` is negative.
            UnknownROSArgsError: an argument after ``--ros-args`` is unknown.
            RCLInvalidROSArgsError: the arguments cannot be parsed.
            UnicodeEncodeError: an argument is not valid UTF-8.
        """
        with self._lock:
            if domain_id is not None and domain_id < 0:
                raise RuntimeError(f"Domain id ({domain_id}) should not be lower than zero.")
            if self._rosidl_context is not None:
                raise RuntimeError("Context.init() must only be called once")
            command_line = list(sys.argv if args is None else args)
            for argument in command_line:
                argument.encode()  # as in rclpy, surrogates are refused: UnicodeEncodeError
            try:
                self._rosidl_context = ContextHandle(command_line, domain_id)
            except runtime.RosArgumentError as error:
                raise invalid_arguments_error(error) from error
            _open_contexts.add(self._rosidl_context)

    def ok(self) -> bool:
        """Return True if the context is open: after `init` and before `shutdown`."""
        return self._rosidl_context is not None and self._rosidl_context.ok()

    def _rosidl_shut_down(self, handle: ContextHandle) -> None:
        with self._lock:
            _open_contexts.discard(handle)
            handle.shutdown()
            callbacks, self._callbacks = self._callbacks, []
        for reference in callbacks:
            callback = reference()
            if isinstance(reference, weakref.WeakMethod) and callback is not None:
                callback()

    def shutdown(self) -> None:
        """Leave the domain; raise RuntimeError if the context is not open."""
        if self._rosidl_context is None:
            raise RuntimeError("Context must be initialized before it can be shutdown")
        self._rosidl_shut_down(self._rosidl_context)

    def try_shutdown(self) -> None:
        """Leave the domain, if the context is open."""
        if self._rosidl_context is None:
            return
        if self._rosidl_context.ok():
            self._rosidl_shut_down(self._rosidl_context)
        else:
            _open_contexts.discard(self._rosidl_context)
            self._rosidl_context.close()  # a signal has only marked it as shut down

    def on_shutdown(self, callback: Callable[[], Any]) -> None:
        """Call a function at `shutdown`, or now if the context is shut down. Methods are stored as weak references."""
        if not callable(callback):
            raise TypeError(f"callback should be a callable, got {type(callback)}")
        with self._lock:
            if self._rosidl_context is None or self._rosidl_context.ok():
                if inspect.ismethod(callback):
                    callback = weakref.WeakMethod(callback, self._rosidl_discard_callback)
                self._callbacks.append(callback)
                return
        callback()

    def _rosidl_discard_callback(self, reference: Callable[[], Any]) -> None:
        if reference in self._callbacks:
            self._callbacks.remove(reference)

    def get_domain_id(self) -> int:
        """Return the number of the domain; raise RuntimeError before `init`."""
        if self._rosidl_context is None:
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return self._rosidl_context.get_domain_id()

    def __enter__(self) -> Context:
        self.init()
        return self

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        self.try_shutdown()


def invalid_arguments_error(error: runtime.RosArgumentError) -> RuntimeError:
    """Return the exception that rclpy raises for a command line that ROS cannot parse."""
    match = re.match(r"unknown ROS arguments: (.*?);", str(error))
    if match is None:
        return RCLInvalidROSArgsError(f"Failed to parse ROS arguments: {error}")
    return UnknownROSArgsError(f"Found unknown ROS arguments: [{match[1]}]: {error}")


def mark_all_shut_down() -> None:
    """Mark every context as shut down, and end all waits; signal handlers call the function."""
    for handle in list(_open_contexts):
        handle.mark_shut_down()


@atexit.register
def _close_all_contexts() -> None:
    if _open_contexts:  # the remaining threads are daemons; errors from the closed context are not to be printed
        threading.excepthook = lambda args: None
    for handle in list(_open_contexts):
        handle.close()
