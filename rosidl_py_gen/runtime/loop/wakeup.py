"""Who waits for data on behalf of an event loop; see `bridge.py` for why there are two ways."""

from __future__ import annotations

import asyncio
import contextlib
import selectors
import signal
import socket
import threading
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.transport.interface import Participant

_LONGEST_WAIT_NS = 1_000_000_000
"""A wait in DDS cannot be interrupted by a signal. Should no wake-up file descriptor be ours, Ctrl-C waits this
long.
"""

_orphans: list[socket.socket] = []
"""Pairs that signals still write to: given up in another thread than the main one, which alone can change that."""


# ---------------------------------------------------------------------------------------------------------- direct mode


class DirectSelector(selectors.BaseSelector):
    """Stands in for a loop's selector: waits for DDS in the loop's thread, for file descriptors in a helper thread.

    While the helper waits, the wrapped selector is only looked at (its own file descriptor becomes readable when one of
    its members does; epoll and kqueue allow that). The helper then ends the loop's wait and rests until the loop has
    read the events and is about to wait again.
    """

    def __init__(self, inner: selectors.BaseSelector, participant: Participant, dispatch: Callable[[], None]) -> None:
        self._inner = inner
        self._participant = participant
        self._dispatch = dispatch
        self._armed = threading.Semaphore(1)
        self._fired = False
        self._closing = False
        self._receiver, self._sender = socket.socketpair()
        self._receiver.setblocking(False)
        self._sender.setblocking(False)
        self._own_wakeup = self._take_signals()
        self._helper = threading.Thread(target=self._watch_descriptors, name="rosidl-py-gen helper", daemon=True)
        self._helper.start()
        self._loop: Any = None
        self._timers = 0

    @classmethod
    def wrap(
        cls, loop: asyncio.AbstractEventLoop, participant: Participant, dispatch: Callable[[], None]
    ) -> DirectSelector | None:
        """Put a new one in front of the loop's selector; None when this loop cannot be treated so.

        `dispatch` is called after every wait.

        `_selector` is private to asyncio but has had this meaning since Python 3.4; anything unexpected means thread
        mode.
        """
        inner = getattr(loop, "_selector", None)
        plain = isinstance(loop, asyncio.SelectorEventLoop) and isinstance(inner, selectors.BaseSelector)
        known = all(hasattr(loop, name) for name in ("_ready", "_scheduled", "_stopping"))
        if not plain or not known or isinstance(inner, DirectSelector) or not hasattr(inner, "fileno"):
            return None
        assert isinstance(inner, selectors.BaseSelector)
        selector = cls(inner, participant, dispatch)
        selector._loop = loop
        selector._loop._selector = selector
        return selector

    def _take_signals(self) -> bool:
        """Let signals write to our socket, so that they end a wait; only the main thread may, and only if nobody
        did.
        """
        if threading.current_thread() is not threading.main_thread():
            return False
        previous = signal.set_wakeup_fd(self._sender.fileno(), warn_on_full_buffer=False)
        ours = any(previous == orphan.fileno() for orphan in _orphans)
        while _orphans:
            _orphans.pop().close()
        if previous != -1 and not ours:
            signal.set_wakeup_fd(previous)
            return False
        return True

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for DDS or file descriptors; sinks of data that arrived are called in here."""
        participant = self._participant
        self._timers = len(self._loop._scheduled) if self._loop is not None else 0
        if timeout is not None and timeout <= 0:
            participant.wait(0)
            self._dispatch()
            return self._inner.select(0)
        if self._fired:
            # The helper rests until all events were read, else it would report the same ones again.
            events = self._inner.select(0)
            if events:
                # A file descriptor that is always ready must not keep DDS waiting.
                participant.wait(0)
                self._dispatch()
                return events
            self._fired = False
            self._armed.release()
        deadline = None if timeout is None else time.monotonic() + timeout
        wait_ns = _LONGEST_WAIT_NS if timeout is None else min(int(timeout * 1e9) + 1, _LONGEST_WAIT_NS)
        while True:
            participant.wait(wait_ns)
            self._dispatch()
            if self._fired:
                return self._inner.select(0)
            if self._loop_has_work():
                return []
            if deadline is not None:
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    return []
                wait_ns = min(int(left_s * 1e9) + 1, _LONGEST_WAIT_NS)

    def _loop_has_work(self) -> bool:
        """Whether callbacks left something to do for the loop; if not, going round it would cost 4 us a message.

        `_ready`, `_scheduled` and `_stopping` are private to asyncio, like `_selector`; `wrap` checked that they exist.
        """
        loop = self._loop
        if loop is None or loop._ready or loop._stopping:
            return True
        timers = len(loop._scheduled)
        changed: bool = timers != self._timers
        self._timers = timers
        return changed

    def _watch_descriptors(self) -> None:
        """Runs in the helper thread."""
        with selectors.DefaultSelector() as poll:
            poll.register(self._inner.fileno(), selectors.EVENT_READ)  # type: ignore[attr-defined]
            poll.register(self._receiver, selectors.EVENT_READ)
            while True:
                self._armed.acquire()
                if self._closing:
                    return
                poll.select()
                if self._closing:
                    return
                with contextlib.suppress(BlockingIOError):
                    self._receiver.recv(4096)
                self._fired = True
                self._participant.wake()

    def close(self) -> None:
        """Give the loop its own selector back and end the helper. Called by the bridge, and by a loop that closes."""
        if self._closing:
            return
        self._closing = True
        if self._own_wakeup and threading.current_thread() is threading.main_thread():
            current = signal.set_wakeup_fd(-1)
            if current not in (-1, self._sender.fileno()):
                signal.set_wakeup_fd(current)
        self._sender.send(b"\0")
        self._armed.release()
        self._helper.join()
        if self._own_wakeup and threading.current_thread() is not threading.main_thread():
            _orphans.extend((self._sender, self._receiver))
        else:
            self._receiver.close()
            self._sender.close()
        if self._loop is not None and self._loop._selector is self:
            self._loop._selector = self._inner
            if self._loop.is_closed():
                self._inner.close()
        self._loop = None

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Of the wrapped selector."""
        return self._inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """Of the wrapped selector."""
        return self._inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Of the wrapped selector."""
        return self._inner.modify(fileobj, events, data)

    def get_key(self, fileobj: Any) -> selectors.SelectorKey:
        """Of the wrapped selector."""
        return self._inner.get_key(fileobj)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        """Of the wrapped selector."""
        return self._inner.get_map()

    def fileno(self) -> int:
        """Of the wrapped selector."""
        number: int = self._inner.fileno()  # type: ignore[attr-defined]
        return number


# ---------------------------------------------------------------------------------------------------------- thread mode


class WaitingThread:
    """Waits for data in a thread of its own and notifies the bridge."""

    def __init__(self, participant: Participant, notify: Callable[[], None]) -> None:
        self._participant = participant
        self._notify = notify
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="rosidl-py-gen receiver", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._closing:
            self._participant.wait(2**63 - 1)
            if not self._closing:
                self._notify()

    def close(self) -> None:
        """End the thread."""
        self._closing = True
        self._participant.wake()
        if threading.current_thread() is not self._thread:
            self._thread.join()
