"""The open contexts of this process: which event loop serves them, and what becomes of them when it ends or forks."""

from __future__ import annotations

import atexit
import os
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.logs.outputs import outputs

if TYPE_CHECKING:
    import asyncio

    from rosidl_py_gen.runtime.node.context_core import ContextCore

_FORKED = (
    "made before this process was forked, and works in the parent process only: start processes with multiprocessing's "
    '"spawn" method, or make nodes after the fork'
)


_open: set[ContextCore] = set()


def add(core: ContextCore) -> None:
    """Count a context among the open ones."""
    _open.add(core)


def discard(core: ContextCore) -> None:
    """Count a context among the open ones no longer."""
    _open.discard(core)


def attach_all() -> None:
    """Let the running loop serve every open context that no running loop serves yet."""
    for core in sorted(_open, key=lambda core: not core.is_default):
        core.bridge.adopt_running_loop()


def close_served_by(loop: asyncio.AbstractEventLoop) -> None:
    """Close the contexts that this loop serves."""
    for core in list(_open):
        if core.bridge.loop is loop:
            core.close()


def close_all() -> None:
    """Leave all domains before the process goes, so that peers see it at once and no DDS thread outlives Python."""
    for core in list(_open):
        core.close()


@atexit.register
def _close_forgotten() -> None:
    for core in list(_open):
        core.close_at_exit()


def _after_fork() -> None:
    """In the child: everything inherited looks closed.

    A child has the memory of its parent, but none of the threads that serve DDS and wait for it: a call into the
    middleware, a join or a lock may hang for ever.
    """
    for core in _open:
        core.abandon(_FORKED)
    _open.clear()
    outputs.after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
