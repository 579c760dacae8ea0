"""Functions of rclpy that need no node, such as functions for the default context."""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, List, Optional, Set

from rclpy.constants import S_TO_NS
from rclpy.context import Context
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from rclpy import InitContextManager

_DEPRECATED_REMAPPING = re.compile(r"(\w+:)?[\w/~{}]+:=[\w/~{}]+")
"""Pattern of a deprecated remap rule: ``from:=to`` without ``--ros-args``."""
_IDENTIFIERS = {"dds": "rmw_cyclonedds_cpp", "zenoh": "rmw_zenoh_cpp"}

g_default_context: Context | None = None
g_context_lock = threading.Lock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the default context of the process; with `shutting_down`, the next call creates a new default context."""
    global g_default_context
    with g_context_lock:
        if g_default_context is None:
            g_default_context = Context()
        context = g_default_context
        if shutting_down:
            g_default_context = None
        return context


def explicit_context(context: Context | InitContextManager | None) -> Context | None:
    """Return the context that an argument `context` selects; None if it selects the default context.

    The result of ``rclpy.init()`` selects the default context, too, because `init` returned None until Jazzy.
    """
    if context is None or isinstance(context, Context):
        return context
    from rclpy import InitContextManager

    return context.rosidl_context if isinstance(context, InitContextManager) else context


def resolve_context(context: Context | InitContextManager | None) -> Context:
    """Return the context that an argument `context` selects; for None the default context."""
    explicit = explicit_context(context)
    return get_default_context() if explicit is None else explicit


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Return a command line, by default `sys.argv`, without the arguments from ``--ros-args`` to ``--``."""
    remaining, is_inside = [], False
    for argument in sys.argv if args is None else args:
        if argument == "--ros-args":
            is_inside = True
        elif is_inside and argument == "--":
            is_inside = False
        elif not is_inside and not _DEPRECATED_REMAPPING.fullmatch(argument):
            remaining.append(argument)
    return remaining


def ok(*, context: Context | None = None) -> bool:
    """Return True if the context, by default the default one, is open."""
    return resolve_context(context).ok()


def shutdown(*, context: Context | None = None) -> None:
    """Shut down the context, by default the default one; raise RuntimeError if it is not open."""
    explicit = explicit_context(context)
    (get_default_context(shutting_down=True) if explicit is None else explicit).shutdown()


def try_shutdown(*, context: Context | None = None) -> None:
    """Shut down the context, by default the default one, if it is open."""
    global g_default_context
    explicit = explicit_context(context)
    if explicit is not None:
        explicit.try_shutdown()
        return
    with g_context_lock:
        if g_default_context is not None:
            g_default_context.try_shutdown()
            g_default_context = None


def get_rmw_implementation_identifier() -> str:
    """Return the name of the rmw implementation that corresponds to the middleware of new contexts."""
    return _IDENTIFIERS[runtime.middleware(os.environ, lambda _: None)]


def get_available_rmw_implementations() -> set[str]:
    """Return the names of the rmw implementations for Cyclone DDS and Zenoh.

    If ``RMW_IMPLEMENTATIONS`` is set, the result contains only the names in it.

    Raises:
        RuntimeError: the variable contains other names.
    """
    available = set(_IDENTIFIERS.values())
    requested = set(filter(None, os.environ.get("RMW_IMPLEMENTATIONS", "").split(os.pathsep)))
    if unavailable := requested - available:
        raise RuntimeError(
            f"The RMW implementations {unavailable} specified in 'RMW_IMPLEMENTATIONS' are not available"
            f" ({', '.join(sorted(available))})"
        )
    return requested or available


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Return a timeout in nanoseconds; for None and negative numbers -1, which means unlimited."""
    return -1 if timeout_sec is None or timeout_sec < 0 else int(float(timeout_sec) * S_TO_NS)
