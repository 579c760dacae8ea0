"""Flow control of service requests: limits the number of requests that a server has not answered.

A ROS 2 server has a keep-last queue (10 by default) and silently overwrites old requests, whose calls would never
return. All clients of one service in a context share a window: at most `min(queue depth, window size)` requests may be
unanswered. The window size is 3 at first. After 2 s it grows by one with each response; not before, because other
clients of the server may not be discovered yet. A response also removes the same client's earlier requests from the
window, because a server takes the requests of a client in order. A request that was given up leaves the window, too.

If no response arrives for 10 s, one more request is sent with a warning, and the timeout doubles. Requests to services
that reply late by design (`get_result`) are sent in batches at a fixed interval instead.
"""

from __future__ import annotations

import asyncio
import itertools
import threading
import weakref
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs.loggers import internal_logger

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.timeout_table import TimeoutTable
    from rosidl_py_gen.runtime.transport.api import TopicKey

ResponseT = TypeVar("ResponseT")

_INITIAL_WINDOW = 3
"""Initial number of requests that may be unanswered. It is below the usual queue depth of a server, which several
clients may share."""
DISCOVERY_SETTLE_S = 2.0
"""Time in seconds after which clients that started together have discovered each other, also on a busy machine."""
STALL_TIMEOUT_S = 10.0
"""Time in seconds without a response after which one request beyond the queue depth is sent, as earlier requests may be
lost."""


class RequestTimedOutError(RosidlError):
    """Raised internally if no response arrived in time.

    The waiting call replaces it by an exception that states the time limit.
    """


@dataclass(slots=True, eq=False)
class PendingRequest(Generic[ResponseT]):
    """Request that has no response yet; compared by identity.

    Attributes:
        encoded: serialized request.
        on_reply: called with the response and the GUID of its reply writer.
        on_error: called with the exception if there is no response.
        timeout_s: time limit of the call; None without one.
        sequence_number: number that the transport assigned; 0 until the request is sent.
        flow_number: number in the `RequestFlowControl`; 0 if the request is not subject to flow control.
        timeouts: table with the request's timeout; None without one.
        had_servers: True if servers existed when the request was made.
    """

    encoded: bytes
    on_reply: Callable[[ResponseT, bytes | None], object]
    on_error: Callable[[Exception], object]
    timeout_s: float | None = None
    sequence_number: int = 0
    flow_number: int = 0
    timeouts: TimeoutTable[PendingRequest[ResponseT]] | None = None
    had_servers: bool = False


class RequestFlowControl:
    """Window for a service: limits how many requests of all its clients in a context are unanswered.

    Waiting requests are sent in order.
    """

    def __init__(self, name: str, batch_interval_s: float | None = None) -> None:
        """Create the window of one service.

        Args:
            name: name of the service for log entries.
            batch_interval_s: time after which the server has taken all requests; None: only responses prove that it
                has.
        """
        self._name = name
        self._batch_interval_s = batch_interval_s
        self.stall_timeout_s = STALL_TIMEOUT_S
        """Time in seconds without a response until one more request is sent. The time doubles at each repetition until
        a response arrives."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self.waiting: deque[tuple[Callable[[int], bool], object]] = deque()
        """Functions that send requests for which the window has no room, oldest first, each with its client."""
        self._flow_numbers = itertools.count(1)
        self._in_flight: dict[int, object] = {}
        """Requests that may still be in the server's queue, oldest first, as dict from flow number to client."""
        self._last_progress_s = self._started_s = 0.0
        self.server_queue_depth = 1
        """Number of requests of this context that the server's queue can contain, as far as is known now."""
        self._window_size = _INITIAL_WINDOW
        self._timer: asyncio.TimerHandle | None = None

    def acquire(self, send: Callable[[int], bool], server_queue_depth: int, client: object = None) -> None:
        """Call `send` as soon as the window has room for its request, perhaps immediately. Thread: loop.

        Args:
            send: gets the flow number for `on_response` and `release`, one of which must be called when the request is
                answered or given up. Returns False if its request is no longer needed; then the request leaves the
                window.
            server_queue_depth: number of requests that the server's queue can contain.
            client: sender; requests of one client reach the server in order, requests of several clients do not.
        """
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # requests of another loop are lost with it
            self._started_s = loop.time()
            self._loop, self.waiting, self._in_flight, self._timer = loop, deque(), {}, None
        self.server_queue_depth = server_queue_depth
        self.waiting.append((send, client))
        if len(self.waiting) == 1:
            self._send()

    def on_response(self, number: int, client: object = None) -> None:
        """Remove an answered request from the window, and the same client's earlier requests, because the server has
        taken them, too.
        """
        in_flight = self._in_flight
        if self._loop is not None and self._loop.time() - self._started_s >= DISCOVERY_SETTLE_S:
            self._window_size = min(self._window_size + 1, self.server_queue_depth)
        for taken in [earlier for earlier, sender in in_flight.items() if earlier <= number and sender is client]:
            del in_flight[taken]
        if self._batch_interval_s is None and self.waiting and self._loop is not None:
            self.stall_timeout_s, self._last_progress_s = STALL_TIMEOUT_S, self._loop.time()
        self._continue()

    def release(self, number: int) -> None:
        """Remove a request that was given up or answered from the window."""
        self._in_flight.pop(number, None)
        self._continue()

    def _continue(self) -> None:
        if self.waiting and self._loop is current_loop():
            self._send()

    def _send(self) -> None:
        """Send as many waiting requests as the window allows; start the timer if requests remain."""
        assert self._loop is not None
        in_flight, waiting = self._in_flight, self.waiting
        size = self._window_size if self._batch_interval_s is None else self.server_queue_depth
        while waiting and len(in_flight) < min(self.server_queue_depth, size):
            number = next(self._flow_numbers)
            send, in_flight[number] = waiting.popleft()
            self._last_progress_s = self._loop.time()
            if not send(number):
                in_flight.pop(number, None)
        if waiting and self._timer is None:
            self._timer = self._loop.call_at(self._due_s(), self._on_timer)

    def _due_s(self) -> float:
        return self._last_progress_s + (self._batch_interval_s or self.stall_timeout_s)

    def _on_timer(self) -> None:
        assert self._loop is not None
        self._timer = None
        if self.waiting and self._loop.time() >= self._due_s():
            if self._batch_interval_s is not None:
                self._in_flight.clear()
            elif self._in_flight:
                internal_logger().warning(
                    f"no server of {self._name} replied for {self.stall_timeout_s:g} s; {len(self.waiting)} calls "
                    f"are waiting, because the server queues at most {self.server_queue_depth} requests. Sending one "
                    "more. Check the server, and pass timeout_s to calls"
                )
                self.stall_timeout_s *= 2
                del self._in_flight[next(iter(self._in_flight))]
        self._send()


class RequestWindows:
    """Flow control of all services of a context: one window for each service while it has clients. Thread: any."""

    def __init__(self) -> None:
        self._windows: weakref.WeakValueDictionary[TopicKey, RequestFlowControl] = weakref.WeakValueDictionary()
        self._lock = threading.RLock()

    def get(self, requests: TopicKey, name: str, batch_interval_s: float | None) -> RequestFlowControl:
        """Return the window of a service; create it if this is the first client of the service.

        Args:
            requests: topic of the service's requests.
            name: name of the service.
            batch_interval_s: as for `RequestFlowControl`; only the value of the first client counts.
        """
        with self._lock:
            window = self._windows.get(requests)
            if window is None:
                window = self._windows[requests] = RequestFlowControl(name, batch_interval_s)
            return window
