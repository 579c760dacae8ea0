"""Flow control of replies: a limit for how many of them clients may not have taken yet.

A client of ROS keeps the last 10 replies that it has not taken, and overwrites older ones silently: their calls never
end. On DDS it keeps those to other clients of the service, too. So a server that would send many at once, as when its
goals end together, sends `MAX_REPLIES` and then waits until these have arrived, where the transport reports that, and
for `HOLD_S`, as a client takes them some time after they arrived.

Calls that come one after another are faster than acknowledgements and must not wait for them. So an unknown client is
probed: its fourth reply is held for `PROBE_S`. A client that sends no request in this time waits for replies: it is
trusted, and each further request shows that it took the replies before. A client that goes on sending takes no reply
before it has sent everything, and gets `MAX_REPLIES` at a time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.transport.api import SYSTEM_CLOCKS, ClockFunctions
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

MAX_REPLIES = 8
"""Maximum number of replies that may be in flight. A client of ROS keeps 10."""
_PROBE_REPLIES = 3
"""Number of replies to a client before it is probed: with 7 requests that wait then it has no more than 10 replies."""
PROBE_S = 0.005
"""Time without a request after which a client is trusted, once for each series of calls; calls that take longer never
wait. Clients of rclpy send goals every 0.1 ms, on a busy machine every 2 ms."""
IDLE_S = 0.1
"""Time without a request or reply after which a client is probed again."""
HOLD_S = 0.04
"""Minimum time for `MAX_REPLIES`, as replies arrive before they are taken. With 20 ms a client of rclpy lost some of 20
results on a machine with four busy processes on two cores. A larger value delays results that come together."""
_HOLD_PER_READER_S = 0.008
"""The same for each client: 8 replies to 20 clients in one node of rclpy keep it busy for 100 ms."""
ACK_TIMEOUT_S = 0.1
"""Time after which replies count as taken without an acknowledgement, which usually takes 5 to 30 ms: a client may have
been killed. Until acknowledgements come again, `HOLD_S` counts."""
_MAX_CLIENTS = 256


@dataclass(slots=True)
class _Client:
    """State of one client."""

    unanswered: int = 0
    """Number of its requests that have no reply yet."""
    in_flight: int = 0
    """Number of replies that it may not have taken."""
    is_trusted: bool = False
    """A request of it shows that it took the replies before."""
    is_bursty: bool = False
    """It has sent more requests than it can keep replies."""
    last_ns: int = 0
    """Time of its last request or reply."""


class ReplyWindow:
    """Replies of one server that its clients may not have taken. Thread: any.

    `have_arrived` returns True if every client has acknowledged all replies; it is None if the transport cannot tell.
    """

    def __init__(self, have_arrived: Callable[[], bool] | None, clocks: ClockFunctions = SYSTEM_CLOCKS) -> None:
        self.limit = 0
        """Number of replies that may be in flight; 0 if the clients retain any number."""
        self._max_unanswered = 0
        self._have_arrived = have_arrived
        self._clocks = clocks
        self._is_released = False
        self._clients: dict[Hashable, _Client] = {}
        self._in_flight: list[tuple[int, _Client]] = []
        """When each reply was sent, and to whom; oldest first."""
        self._hold_s = HOLD_S
        self._timeout_s = ACK_TIMEOUT_S
        self._lock = threading.RLock()  # a signal handler may send a reply in the middle of another one

    def set_readers(self, readers: Iterable[QoSProfile]) -> None:
        """Set the limit for clients with these profiles."""
        depths = [max(1, qos.depth) for qos in readers if qos.history is not History.KEEP_ALL]
        if depths and not self._is_released:
            self.limit = min(MAX_REPLIES, *depths)
            self._max_unanswered = max(1, min(depths) - _PROBE_REPLIES)
            self._hold_s = max(HOLD_S, _HOLD_PER_READER_S * len(depths))
        else:
            self.limit = 0
            self._forget_clients()

    def release(self) -> None:
        """Remove the limit for good: the server closes, and replies that wait must be sent before."""
        self.limit, self._is_released = 0, True

    def on_request(self, key: Hashable) -> None:
        """Record a request of a client."""
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
        """Return True if a reply may be sent to that client now."""
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
        """Forget replies that count as taken."""
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
        """Record a reply to a client."""
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
