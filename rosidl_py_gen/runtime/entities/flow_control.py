"""A request under way, and when it may be sent to servers that keep few of them.

A ROS server keeps the last 10 requests and overwrites older ones without a word: their calls would never be answered.
So the clients of a service never have more under way that may still lie in the server's queue than fit in there, and
the others wait for their turn. A server takes requests in the order in which they come: the answer to one says that all
before it were taken, too, also those that will never be answered. What is given up stands in nobody's way either.

Where nothing at all is answered for long, which cannot be told from a server that is slow, one more request goes out,
after a warning, and each further one takes twice as long: it may overwrite the oldest one. Servers that answer much
later by their nature, as those of results do, are given a pause to take what was sent instead.
"""

from __future__ import annotations

import asyncio
import itertools
import weakref
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs.loggers import internal_logger

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.timeout_table import TimeoutTable
    from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

ResponseT = TypeVar("ResponseT")

_INITIAL_WINDOW = 3
"""So many requests are sent at first, if the server keeps as many; after `DISCOVERY_SETTLE_S` each answer makes room
for one more. Others who call the same server, and share what it keeps, may not be known before."""
DISCOVERY_SETTLE_S = 2.0
"""Until others who began at the same time are known, also on a busy machine."""
_STALL_TIMEOUT_S = 10.0
"""So long nothing is answered before one more request is sent than the server keeps."""

request_numbers = itertools.count(1)
"""By which they are known here; what stands on the wire is the port's number."""


class RequestTimedOutError(RosidlError):
    """No answer came in time; how long that was only the call knows."""


class PendingRequest(Generic[ResponseT]):
    """A request under way.

    Attributes:
        number: that of the port; 0 until it is sent.
        turn: its number in the `RequestFlowControl`; 0 when it did not have to wait for one.
        limits: what watches its time, if that is limited.
        had_servers: there were some when it was made.
    """

    __slots__ = (
        *("encoded", "had_servers", "limits", "number", "on_error", "on_reply", "sequence"),
        *("timeout_s", "flow_number"),
    )

    def __init__(
        self,
        encoded: bytes,
        on_reply: Callable[[ResponseT, bytes | None], object],
        on_error: Callable[[Exception], object],
        timeout_s: float | None = None,
    ) -> None:
        self.encoded = encoded
        self.timeout_s = timeout_s
        self.on_reply = on_reply
        self.on_error = on_error
        self.sequence = next(request_numbers)
        self.number = 0
        self.flow_number = 0
        self.limits: TimeoutTable | None = None
        self.had_servers = False


class RequestFlowControl:
    """Shared by all clients of one service in one context; first come, first served."""

    def __init__(self, name: str, batch_interval_s: float | None = None) -> None:
        """`batch_interval_s`: after so long without another one all that was sent counts as taken; None: only
        answers tell.
        """
        self._name = name
        self._pause_s = batch_interval_s
        self._patience_s = _STALL_TIMEOUT_S
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: deque[tuple[Callable[[int], bool], object]] = deque()
        self._numbers = itertools.count(1)
        self._in_flight: dict[int, object] = {}
        """What was sent and may not have been taken, oldest first, and whose it is."""
        self._moved_s = self._began_s = 0.0
        self.server_queue_depth = 1
        """How many requests of ours the server keeps, as far as is known now."""
        self._window_size = _INITIAL_WINDOW
        self._timer: asyncio.TimerHandle | None = None

    def acquire(self, send: Callable[[int], bool], kept: int, client: object = None) -> None:
        """Call `send` as soon as one more request may be sent, perhaps at once; on the loop's thread.

        Args:
            send: gets the number for `on_response` and `release`, one of which has to be called once the request is
                answered or given up. It returns False if the request was given up; its place is then free.
            kept: how many requests the server keeps.
            client: whose request it is. Those of one client come to the server in their order, those of several do not.
        """
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # what waited on another loop waits no more
            self._began_s = loop.time()
            self._loop, self._waiting, self._in_flight, self._timer = loop, deque(), {}, None
        self.server_queue_depth = kept
        self._waiting.append((send, client))
        if len(self._waiting) == 1:
            self._send()

    def on_response(self, number: int, client: object = None) -> None:
        """A request is answered, so that those its client sent before it are no longer in the server's queue."""
        held = self._in_flight
        if self._loop is not None and self._loop.time() - self._began_s >= DISCOVERY_SETTLE_S:
            self._window_size = min(self._window_size + 1, self.server_queue_depth)
        for one in [one for one, whose in held.items() if one <= number and whose is client]:
            del held[one]
        if self._pause_s is None and self._waiting and self._loop is not None:
            self._patience_s, self._moved_s = _STALL_TIMEOUT_S, self._loop.time()
        self._go_on()

    def release(self, number: int) -> None:
        """A request that was sent is given up; also when it is answered."""
        self._in_flight.pop(number, None)
        self._go_on()

    def _go_on(self) -> None:
        if self._waiting and self._loop is current_loop():
            self._send()

    def _send(self) -> None:
        """Send what fits into the server's queue; look again later when there is more."""
        assert self._loop is not None
        held, waiting = self._in_flight, self._waiting
        while waiting and len(held) < (
            self.server_queue_depth if self._pause_s is not None else min(self.server_queue_depth, self._window_size)
        ):
            number = next(self._numbers)
            send, held[number] = waiting.popleft()
            self._moved_s = self._loop.time()
            if not send(number):
                held.pop(number, None)
        if waiting and self._timer is None:
            self._timer = self._loop.call_at(self._due_s(), self._look)

    def _due_s(self) -> float:
        return self._moved_s + (self._patience_s if self._pause_s is None else self._pause_s)

    def _look(self) -> None:
        """Go on where no answer came for long."""
        assert self._loop is not None
        self._timer = None
        if self._waiting and self._loop.time() >= self._due_s():
            if self._pause_s is not None:
                self._in_flight.clear()
            elif self._in_flight:
                self._warn()
                self._patience_s *= 2
                del self._in_flight[next(iter(self._in_flight))]
        self._send()

    def _warn(self) -> None:
        internal_logger().warning(
            f"no server of {self._name} answered for {self._patience_s:g} s; {len(self._waiting)} calls wait until one "
            f"does, because more than {self.server_queue_depth} requests at once would overwrite each other. One more "
            "is sent; look why the server is silent, and give calls a timeout_s"
        )


class RequestFlowControls:
    """The windows of one context, by what the requests go to."""

    def __init__(self) -> None:
        self._windows: weakref.WeakValueDictionary[TopicKey, RequestFlowControl] = weakref.WeakValueDictionary()

    def of(self, requests_on: TopicKey, name: str, batch_interval_s: float | None) -> RequestFlowControl:
        """The one window of a service; `batch_interval_s` counts for the first client."""
        return self._windows.setdefault(requests_on, RequestFlowControl(name, batch_interval_s))
