"""The default context, and what else needs no node."""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Sequence
from typing import List, Optional, Set  # noqa: F401, UP035

from rclpy.constants import S_TO_NS
from rclpy.context import Context
from rosidl_py_gen import runtime

_OLD_REMAPPING = re.compile(r"(\w+:)?[\w/~{}]+:=[\w/~{}]+")
"""``from:=to`` without ``--ros-args``, which is deprecated."""
_IDENTIFIERS = {"dds": "rmw_cyclonedds_cpp", "zenoh": "rmw_zenoh_cpp"}

g_default_context: Context | None = None
g_context_lock = threading.Lock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """The context of the process; with `shutting_down` another one takes its place."""
    global g_default_context
    with g_context_lock:
        if g_default_context is None:
            g_default_context = Context()
        context = g_default_context
        if shutting_down:
            g_default_context = None
        return context


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """A command line, by default that of the process, without what is for ROS: after ``--ros-args`` up to ``--``."""
    kept, inside = [], False
    for argument in sys.argv if args is None else args:
        if argument == "--ros-args":
            inside = True
        elif inside and argument == "--":
            inside = False
        elif not inside and not _OLD_REMAPPING.fullmatch(argument):
            kept.append(argument)
    return kept


def ok(*, context: Context | None = None) -> bool:
    """Whether the context, by default that of the process, is open."""
    return (get_default_context() if context is None else context).ok()


def shutdown(*, context: Context | None = None) -> None:
    """Shut down the context, by default that of the process; RuntimeError when it is not open."""
    (get_default_context(shutting_down=True) if context is None else context).shutdown()


def try_shutdown(*, context: Context | None = None) -> None:
    """Shut down the context, by default that of the process, if it is open."""
    global g_default_context
    if context is not None:
        context.try_shutdown()
        return
    with g_context_lock:
        if g_default_context is not None:
            g_default_context.try_shutdown()
            g_default_context = None


def get_rmw_implementation_identifier() -> str:
    """The middleware that contexts open: of those on DDS the one whose library is used."""
    return _IDENTIFIERS[runtime.middleware(os.environ, lambda _: None)]


def get_available_rmw_implementations() -> set[str]:
    """The middlewares there are: Cyclone DDS and Zenoh, or those of them that ``RMW_IMPLEMENTATIONS`` names.

    Raises RuntimeError when that names others.
    """
    available = set(_IDENTIFIERS.values())
    wanted = set(filter(None, os.environ.get("RMW_IMPLEMENTATIONS", "").split(os.pathsep)))
    if missing := wanted - available:
        raise RuntimeError(
            f"The RMW implementations {missing} specified in 'RMW_IMPLEMENTATIONS' are not available"
            f" ({', '.join(sorted(available))})"
        )
    return wanted or available


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Nanoseconds of a time limit; -1, for ever, for None and negative numbers."""
    return -1 if timeout_sec is None or timeout_sec < 0 else int(float(timeout_sec) * S_TO_NS)
