"""Flow control of a server: a limit for the number of replies that its clients have perhaps not taken yet.

A client of ROS keeps the last 10 replies that it has not taken, and overwrites older ones silently: their calls never
end. On DDS the 10 include replies to other clients of the service. So a server that would send many replies at once, as
when its goals end together, sends `MAX_REPLIES`. It then waits until they have arrived, where the transport reports
that, and for `HOLD_S`, because a client takes replies some time after they arrived.

Calls in sequence are faster than acknowledgements and must not wait for them. So the server tests an unknown client: it
delays the client's fourth reply by `PROBE_S`. A client that sends no request in this time waits for replies: it is
trusted, and each further request shows that it took the earlier replies. A client that continues to send takes no reply
before it has sent all its requests, and gets `MAX_REPLIES` at a time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.transport.api import SYSTEM_CLOCKS, ClockFunctions
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

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
