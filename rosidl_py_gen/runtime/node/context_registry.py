"""Open contexts of this process: attaches them to event loops, and closes them when a loop or the process ends."""

from __future__ import annotations

import atexit
import os
import signal
from contextlib import suppress
from typing import TYPE_CHECKING

from rosidl_py_gen.base.interrupts import CommandInterrupts, command_interrupts
from rosidl_py_gen.runtime.logs.outputs import outputs

if TYPE_CHECKING:
    import asyncio

    from rosidl_py_gen.runtime.node.context import ContextCore

_FORKED = (
    "made before this process was forked, and works in the parent process only: start processes with multiprocessing's "
    '"spawn" method, or make nodes after the fork'
)
open_contexts: set[ContextCore] = set()


def attach_all() -> None:
    """Attach the running loop to every open context that no running loop serves."""
    for core in sorted(open_contexts, key=lambda core: not core.is_default):
        core.loop_binding.adopt_running_loop()


def close_served_by(loop: asyncio.AbstractEventLoop) -> None:
    """Close the contexts that a loop serves."""
    for core in list(open_contexts):
        if core.loop_binding.loop is loop:
            core.close()


def close_all() -> None:
    """Close all contexts before the process ends, so that peers notice at once and no DDS thread outlives Python."""
    for core in list(open_contexts):
        core.close()


@atexit.register
def _close_at_exit() -> None:
    # A second Ctrl-C must not leave DDS entities open: they may block the end of the interpreter for ever.
    if open_contexts and signal.getsignal(signal.SIGINT) is not command_interrupts:
        interrupts = CommandInterrupts()
        interrupts.ignores_first = True
        with suppress(ValueError):  # this is not the main thread
            signal.signal(signal.SIGINT, interrupts)
    for core in list(open_contexts):
        core.close_at_exit()


def _after_fork() -> None:
    """Mark all inherited contexts as closed in the child.

    A child has the memory of its parent, but not the threads that serve DDS: a call into the middleware, a join or a
    lock may block forever.
    """
    for core in open_contexts:
        core.abandon(_FORKED)
    open_contexts.clear()
    outputs.after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
