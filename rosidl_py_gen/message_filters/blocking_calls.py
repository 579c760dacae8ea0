"""Blocking calls of objects without a node, which the program feeds by hand."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.runtime import WouldDeadlockError

if TYPE_CHECKING:
    from collections.abc import Coroutine

T = TypeVar("T")


class NoNodeScope:
    """Scope of an object without a node; the scope of a node is an `EntityScope`."""

    def run_blocking(self, coroutine: Coroutine[Any, Any, T], caller: object, name: str) -> T:
        """Run a coroutine to its end, while other threads feed the object; raises `WouldDeadlockError` in a loop."""
        if current_loop() is not None:
            coroutine.close()
            raise WouldDeadlockError(
                f"{name}_sync of {caller!r} inside the event loop would deadlock; use 'await ...{name}(...)' in an "
                "async function, or call it from another thread"
            )
        return asyncio.run(coroutine)
