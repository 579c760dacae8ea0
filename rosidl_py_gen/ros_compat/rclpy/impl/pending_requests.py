"""Requests of service and action clients that wait for their responses."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.task import Future
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    import concurrent.futures
    from collections.abc import Callable

    ResponseFuture = concurrent.futures.Future[Any]


class PendingRequests:
    """Unanswered requests of one client of rosidl_py_gen.runtime, by sequence number. Thread: any.

    Args:
        client: client that sends the requests.
        notify: function that is called after a response has arrived.

    Attributes:
        futures: future of each request that has no response yet and was not discarded.
        responses: responses that arrived and were not taken.
    """

    def __init__(self, client: runtime.Client[Any, Any], notify: Callable[[], object]) -> None:
        self.client = client
        self.futures: dict[int, Future[Any]] = {}
        self.responses: deque[tuple[int, ResponseFuture]] = deque()
        self.lock = threading.Lock()
        self._notify = notify
        self._details: dict[int, tuple[ResponseFuture, Any]] = {}
        self._sequence_numbers = itertools.count(1)

    def send(self, request: Any, subject: Any = None) -> Future[Any]:
        """Send a request, and return the future of its response.

        `subject` is any object; `take` returns it together with the future and the response. The caller of `take` must
        set the result of the future.
        """
        future: Future[Any] = Future()
        response_future = self.client.send_request(request)
        with self.lock:
            sequence_number = next(self._sequence_numbers)
            self.futures[sequence_number] = future
            self._details[sequence_number] = response_future, subject
        future.add_done_callback(self.discard)
        response_future.add_done_callback(partial(self._on_response, sequence_number))
        return future

    def discard(self, future: Future[Any]) -> None:
        """Forget the request of a future, so that its response is ignored."""
        with self.lock:
            sequence_number = next((key for key, other in self.futures.items() if other is future), None)
            if sequence_number is None:
                return
            del self.futures[sequence_number]
            response_future, _ = self._details.pop(sequence_number)
        if not response_future.done():
            response_future.cancel()

    def _on_response(self, sequence_number: int, response_future: ResponseFuture) -> None:
        lost_errors = runtime.ServerLostError, runtime.ClosedError
        if response_future.cancelled() or isinstance(response_future.exception(), lost_errors):
            return  # in rclpy such a future stays pending
        self.responses.append((sequence_number, response_future))
        self._notify()

    def take(self) -> tuple[Future[Any] | None, Any, ResponseFuture] | None:
        """Return the next response with the future and the subject of its request, or None if no response has arrived.

        Future and subject are None if the request was discarded.
        """
        if not self.responses:
            return None
        try:
            sequence_number, response_future = self.responses.popleft()
        except IndexError:  # another thread was faster
            return None
        with self.lock:
            future = self.futures.get(sequence_number)
            return future, None if future is None else self._details[sequence_number][1], response_future


def wait_until_done(future: Future[Any], timeout_sec: float | None = None) -> bool:
    """Wait for a future while an executor in another thread runs; return False if `timeout_sec` has passed."""
    event = threading.Event()
    future.add_done_callback(lambda _: event.set())
    return event.wait(timeout_sec)
