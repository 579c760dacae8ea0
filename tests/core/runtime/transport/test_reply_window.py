"""Flow control of replies, with virtual time."""

from __future__ import annotations

from weakref import WeakSet

from rosidl_py_gen.runtime.transport.api import ClockFunctions
from rosidl_py_gen.runtime.transport.flow_control import ACK_TIMEOUT_S, HOLD_S, PROBE_S, ReplyWindow
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT


class Server:
    """Server with a reply window; `acknowledged` is None if the transport reports no acknowledgements."""

    def __init__(self, acknowledged: bool | None, depth: int = 10) -> None:
        self.acknowledged, self.now_ns = acknowledged, 10**9
        clocks = ClockFunctions(steady_ns=lambda: self.now_ns)
        arrived = None if acknowledged is None else lambda: bool(self.acknowledged)
        self.window = ReplyWindow(arrived, clocks)
        self.window.set_readers([SERVICES_DEFAULT.keep_all(), SERVICES_DEFAULT.keep_last(depth)])
        self.waiting: list[str] = []

    def wait(self, seconds: float) -> None:
        self.now_ns += int(seconds * 1e9)

    def request(self, *clients: str) -> None:
        for client in clients:
            if self.window.limit:
                self.window.on_request(client)
            self.waiting.append(client)

    def reply(self) -> int:
        """Send as many replies as possible; return their number."""
        count = len(self.waiting)
        while self.waiting and self.window.is_open(self.waiting[0]):
            client = self.waiting.pop(0)
            if self.window.limit:
                self.window.on_sent(client)
        return count - len(self.waiting)

    def replies(self, pause_s: float, times: int) -> list[int]:
        """Return the number of replies sent after each `pause_s`."""
        sent = []
        for _ in range(times):
            sent.append(self.reply())
            self.wait(pause_s)
        return sent


def test_many_replies_are_sent_in_groups_that_fit_client_queues() -> None:
    for clients in (["a"] * 20, [f"client {number}" for number in range(20)]):
        server = Server(acknowledged=True)
        server.request(*clients)
        assert server.replies(HOLD_S, 3) == [8, 8, 4], clients
    server = Server(acknowledged=False)  # a dead client: delayed once, later as without acknowledgements
    server.request(*["a"] * 40)
    assert server.replies(HOLD_S, 8) == [8, 0, 0, 8, 8, 8, 8, 0]
    assert 2 < ACK_TIMEOUT_S / HOLD_S <= 3
    server = Server(acknowledged=None)
    server.request(*["a"] * 20)
    assert server.replies(HOLD_S / 2, 5) == [8, 0, 8, 0, 4]


def test_sequential_calls_are_delayed_only_once_and_briefly() -> None:
    for acknowledged in (True, False, None):
        server = Server(acknowledged)
        waited = 0
        for _ in range(200):
            server.request("a")
            while not server.reply():
                waited += 1
                server.wait(0.001)
            server.wait(0.0003)
        assert waited * 0.001 <= PROBE_S, acknowledged
        server = Server(acknowledged)
        for _ in range(50):  # slower ones never wait
            server.request("a")
            assert server.reply() == 1
            server.wait(PROBE_S)


def test_groups_of_calls_are_delayed_only_once() -> None:
    server = Server(acknowledged=False)
    sent = []
    server.request(*["a"] * 5)
    for _ in range(50):
        sent.append(server.reply())
        server.wait(0.0003 if sent[-1] else PROBE_S)
        server.request(*["a"] * sent[-1])
    assert sent[1] == 0 and min(sent[2:]) > 0


def test_client_that_sends_many_requests_before_reading_is_limited() -> None:
    # The server is faster than the client, so it never sees two requests at once before it waits.
    server = Server(acknowledged=True)
    for _ in range(3):
        sent = 0
        for _ in range(20):
            server.request("a")
            sent += server.reply()
            server.wait(0.0005)
        assert sent <= 8
        assert sum(server.replies(HOLD_S, 3)) + sent == 20


def test_replies_are_unlimited_without_short_queues_and_after_release() -> None:
    server = Server(acknowledged=False)
    server.request(*["a"] * 100)
    server.window.set_readers([SERVICES_DEFAULT.keep_all()])
    assert server.reply() == 100
    server.window.set_readers([SERVICES_DEFAULT])
    server.request(*["a"] * 100)
    assert server.reply() == 8
    server.window.release()
    server.window.set_readers([SERVICES_DEFAULT])
    assert server.reply() == 92


def test_clients_with_queue_depth_one_receive_one_reply_at_a_time() -> None:
    server = Server(acknowledged=True, depth=1)
    server.request("a", "a", "a")
    assert server.replies(HOLD_S, 3) == [1, 1, 1]


def test_reply_window_retains_a_bounded_number_of_clients() -> None:
    server, known, name = Server(acknowledged=True), WeakSet[str](), type("Name", (str,), {})  # with weak references
    for number in range(1000):
        server.request(client := name(f"client {number}"))
        known.add(client)
        server.reply()
        server.wait(1)
    assert len(known) <= 256
