"""What an action server keeps of one accepted goal, behind the `ServerGoal` that its handler holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.waiters import Waiters, complete_threadsafe

if TYPE_CHECKING:
    import asyncio

    from rosidl_py_gen.runtime.time.values import Time


class GoalRecord:
    """One goal; its state is in the server's `GoalTable`, here is what waits for it and what it came to."""

    def __init__(self) -> None:
        self.accepted_stamp: Time | None = None
        """By the server's clock; None only until it is accepted."""
        self.cancel_requested = False
        """A cancel was accepted, or the server closes."""
        self.has_started = False
        """True since the goal began to execute, also after its end."""
        self.handler: object = None
        """The `caller` that the goal's handler is while that runs."""
        self.result: bytes | None = None
        """What get_result answers, once the goal has ended; empty when the server closed before."""
        self.cancel_answers: set[asyncio.Future[bool]] = set()
        """Cancel requests that the program decides about; they are refused when the goal ends."""
        self.changed = Waiters()

    def request_cancel(self) -> None:
        """Note that a cancel was accepted, after the status has changed, or that the server closes."""
        self.cancel_requested = True
        self.changed.wake()

    def start(self) -> None:
        """Note that the goal executes from now on."""
        self.has_started = True
        self.changed.wake()

    def end(self, result: bytes) -> None:
        """Note that the goal has ended with this, or with nothing because the server closes."""
        self.result = result
        self.changed.wake()
        self.refuse_cancels()

    def refuse_cancels(self) -> None:
        """Answer the cancel requests that nobody decided about: it is too late for them."""
        for answer in tuple(self.cancel_answers):  # another thread may close while a cancel comes
            complete_threadsafe(answer, False)

    async def result_bytes(self) -> bytes:
        """Wait for the end of the goal; what get_result answers then."""
        await self.changed.wait(lambda: self.result is not None)
        return self.result or b""
