"""Flow control of services: limits of requests without a reply, and of replies that clients have not taken.

Clients: a ROS 2 server has a keep-last queue (10 by default) and silently overwrites old requests, whose calls would
never return. All clients of one service in a context share a window: at most `min(queue depth, window size)` requests
may be unanswered. The window size is 3 at first. After 2 s it grows by one with each response; not before, because
other clients of the server may not be discovered yet. A response also removes the same client's earlier requests from
the window, because a server takes the requests of a client in order. A request that was given up leaves the window,
too. If no response arrives for 10 s, one more request is sent with a warning, and the timeout doubles. Requests to
services that reply late by design (`get_result`) are sent in batches at a fixed interval instead.

Timeouts: most operations end long before their timeout. So `TimeoutTable.remove` does not touch the timer, which finds
the next timeout when it fires: a timer for each operation would be a tenth of the cost of a service call.

Servers: a client of ROS keeps the last 10 replies that it has not taken, and overwrites older ones silently: their
calls never end. On DDS the 10 include replies to other clients of the service. So a server that would send many replies
at once, as when its goals end together, sends `MAX_REPLIES`. It then waits until they have arrived, where the transport
reports that, and for `HOLD_S`, because a client takes replies some time after they arrived.

Calls in sequence are faster than acknowledgements and must not wait for them. So the server tests an unknown client: it
delays the client's fourth reply by `PROBE_S`. A client that sends no request in this time waits for replies: it is
trusted, and each further request shows that it took the earlier replies. A client that continues to send takes no reply
before it has sent all its requests, and gets `MAX_REPLIES` at a time.
"""

from __future__ import annotations

import asyncio
import itertools
import threading
import weakref
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs import internal_logger
from rosidl_py_gen.runtime.transport.api import SYSTEM_CLOCKS, ClockFunctions
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

if TYPE_CHECKING:
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


# ------------------------------------------------------------------------------------------------------------- timeouts

OperationT = TypeVar("OperationT")

_COALESCE_S = 0.001
"""Minimum time between two checks of timeouts, in seconds, so that many timeouts in sequence share one check."""


class TimeoutTable(Generic[OperationT]):
    """Timeouts of operations, which are hashable objects.

    `expire` is called on the loop with each operation whose timeout is over.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, expire: Callable[[OperationT], None]) -> None:
        self.loop = loop
        self._expire = expire
        self._ends_s: dict[OperationT, float] = {}
        self._timer: asyncio.TimerHandle | None = None

    def add(self, operation: OperationT, timeout_s: float) -> None:
        """Add an operation; its timeout of this many seconds starts now."""
        end_s = self._ends_s[operation] = self.loop.time() + timeout_s
        if self._timer is None or end_s < self._timer.when():
            self._schedule_check(end_s)

    def remove(self, operation: OperationT) -> None:
        """Remove an operation, so that it does not expire; without effect for an unknown operation."""
        self._ends_s.pop(operation, None)

    def _schedule_check(self, time_s: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_at(time_s, self._check)

    def _check(self) -> None:
        self._timer = None
        now_s = self.loop.time()
        due = [(end_s, operation) for operation, end_s in self._ends_s.items() if end_s <= now_s + _COALESCE_S]
        # In the order of their timeouts, if the loop was blocked and several are due.
        for _, operation in sorted(due, key=lambda item: item[0]):
            if self._ends_s.pop(operation, None) is not None:  # `expire` may have removed it
                self._expire(operation)
        if self._ends_s:
            self._schedule_check(max(min(self._ends_s.values()), now_s + _COALESCE_S))


# -------------------------------------------------------------------------------------------------------------- replies

MAX_REPLIES = 8
"""Maximum number of replies that the clients of a server have perhaps not taken. A client of ROS keeps 10 replies."""
_PROBE_REPLIES = 3
"""Number of replies to a client before the server tests the client's behaviour by a delay. With at most 7 unanswered
requests at that time, the client has no more than the 10 replies that it can keep."""
PROBE_S = 0.005
"""Time in seconds in which a tested client must send no request to be trusted. Each series of calls waits for it once,
calls that take longer never. Clients of rclpy send goals every 0.1 ms, on a busy machine every 2 ms."""
IDLE_S = 0.1
"""Time in seconds without a request or reply after which the behaviour of a client is tested again."""
HOLD_S = 0.04
"""Minimum time in seconds from sending a reply until it counts as taken, because clients take replies some time after
they arrived. With 20 ms a client of rclpy lost some of 20 results on a machine with four busy processes on two cores. A
larger value delays results that are sent together."""
_HOLD_PER_READER_S = 0.008
"""Minimum time in seconds, for each client of the server, from sending a reply until it counts as taken. Used if the
product with the number of clients exceeds `HOLD_S`: 8 replies to 20 clients in one node of rclpy keep the node busy for
100 ms."""
ACK_TIMEOUT_S = 0.1
"""Time in seconds after which a reply counts as taken without an acknowledgement, because the client may have been
killed. An acknowledgement usually takes from 5 to 30 ms. After one timeout, `HOLD_S` applies until acknowledgements
arrive again."""
_MAX_CLIENTS = 256


@dataclass(slots=True)
class _Client:
    """State of one client in the flow control of a server."""

    unanswered: int = 0
    """Number of the client's requests that have no reply yet."""
    in_flight: int = 0
    """Number of replies that the client may not have taken."""
    is_trusted: bool = False
    """True if each further request of the client shows that it took the earlier replies."""
    is_bursty: bool = False
    """True if the client has sent more requests at once than it can keep replies."""
    last_ns: int = 0
    """Time of the client's last request or reply, in ns of the steady clock."""


class ReplyWindow:
    """Flow control of one server, which counts the replies that its clients have perhaps not taken. Thread: any.

    `have_arrived` returns True if every client has acknowledged all replies; None if the transport cannot tell.
    """

    def __init__(self, have_arrived: Callable[[], bool] | None, clocks: ClockFunctions = SYSTEM_CLOCKS) -> None:
        self.limit = 0
        """Maximum number of replies that clients may not have taken; 0 if the clients retain any number."""
        self._max_unanswered = 0
        self._have_arrived = have_arrived
        self._clocks = clocks
        self._is_released = False
        self._clients: dict[Hashable, _Client] = {}
        self._in_flight: list[tuple[int, _Client]] = []
        """Replies that clients have perhaps not taken, oldest first: the time of sending in ns, and the client."""
        self._hold_s = HOLD_S
        self._timeout_s = ACK_TIMEOUT_S
        self._lock = threading.RLock()  # a signal handler may send a reply in the middle of another one

    def set_readers(self, readers: Iterable[QoSProfile]) -> None:
        """Set the limit from the QoS profiles of the reply readers of all clients."""
        depths = [max(1, qos.depth) for qos in readers if qos.history is not History.KEEP_ALL]
        if depths and not self._is_released:
            self.limit = min(MAX_REPLIES, *depths)
            self._max_unanswered = max(1, min(depths) - _PROBE_REPLIES)
            self._hold_s = max(HOLD_S, _HOLD_PER_READER_S * len(depths))
        else:
            self.limit = 0
            self._forget_clients()

    def release(self) -> None:
        """Remove the limit for good, because the server closes, and waiting replies must be sent before that."""
        self.limit, self._is_released = 0, True

    def on_request(self, key: Hashable) -> None:
        """Record that the client `key` has sent a request."""
        with self._lock:
            client, now_ns = self._client(key), self._clocks.steady_ns()
            quiet_s = (now_ns - client.last_ns) / NS_PER_S
            if quiet_s > IDLE_S:
                client.is_trusted = client.is_bursty = False
            client.last_ns = now_ns
            client.unanswered += 1
            if client.unanswered > self._max_unanswered:
                client.is_trusted, client.is_bursty = False, True
            elif client.is_trusted or (quiet_s >= PROBE_S and not client.is_bursty):
                self._have_taken(client)

    def is_open(self, key: Hashable) -> bool:
        """Return True if a reply may be sent to the client `key` now."""
        with self._lock:
            client, now_ns = self._client(key), self._clocks.steady_ns()
            if self._has_room(client):
                return True
            if not (client.is_trusted or client.is_bursty) and now_ns - client.last_ns >= PROBE_S * NS_PER_S:
                client.is_trusted = True
                self._have_taken(client)
            self._drop_older(now_ns)
            return self._has_room(client)

    def _has_room(self, client: _Client) -> bool:
        share = self.limit if client.is_trusted or client.is_bursty else _PROBE_REPLIES
        return not self.limit or (client.in_flight < share and len(self._in_flight) < self.limit)

    def _drop_older(self, now_ns: int) -> None:
        """Stop counting replies that were sent so long ago that they count as taken."""
        age_s = self._hold_s
        if self._have_arrived is not None:
            if self._have_arrived():
                self._timeout_s = ACK_TIMEOUT_S
            else:
                age_s = max(self._hold_s, self._timeout_s)
        until_ns = now_ns - int(age_s * NS_PER_S)
        while self._in_flight and self._in_flight[0][0] <= until_ns:
            self._in_flight.pop(0)[1].in_flight -= 1
            if age_s > self._hold_s:
                self._timeout_s = self._hold_s

    def on_sent(self, key: Hashable) -> None:
        """Record that a reply was sent to the client `key`."""
        with self._lock:
            client = self._client(key)
            client.last_ns = self._clocks.steady_ns()
            client.unanswered = max(0, client.unanswered - 1)
            client.in_flight += 1
            self._in_flight.append((client.last_ns, client))

    def _have_taken(self, client: _Client) -> None:
        if client.in_flight:
            client.in_flight = 0
            self._in_flight = [one for one in self._in_flight if one[1] is not client]

    def _client(self, key: Hashable) -> _Client:
        client = self._clients.get(key)
        if client is None:
            if len(self._clients) >= _MAX_CLIENTS:
                self._forget_clients()
            client = self._clients[key] = _Client()
        return client

    def _forget_clients(self) -> None:
        with self._lock:
            self._clients.clear()
            self._in_flight.clear()
