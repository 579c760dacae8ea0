"""What the endpoints of one node share, without knowing the node.

Endpoints get a `EntityScope` and a resolved name, never the node: a node holds its endpoints, and the way back would
make a
cycle. Decides how to wait for the graph, how callbacks are run and how their failures are reported; and who closes
what: a scope closes all that is made with it, and what is made of several parts has a nested one for them.
"""

from __future__ import annotations

import asyncio
import contextlib
import copy
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.graph.type_hashes import checked_mode
from rosidl_py_gen.runtime.logs.loggers import node_logger
from rosidl_py_gen.runtime.loop.callable_checks import start_task
from rosidl_py_gen.runtime.loop.callback_failures import CallbackFailures
from rosidl_py_gen.runtime.loop.shared_loop import WouldDeadlockError
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.deadline import Deadline, WaitTimeoutError
from rosidl_py_gen.runtime.time.values import ClockType

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Coroutine

    from rosidl_py_gen.runtime.entities.flow_control import RequestFlowControls
    from rosidl_py_gen.runtime.graph.discovery import Discovery
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.graph.unmatched import UnmatchedReason
    from rosidl_py_gen.runtime.loop.callback_failures import OnError
    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding
    from rosidl_py_gen.runtime.transport.api import Participant
    from rosidl_py_gen.runtime.transport.clock_functions import ClockFunctions
    from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

T = TypeVar("T")

_MATCH_POLL_INTERVAL_S = 0.05
"""Matching inside DDS may follow the discovery event by some moments, and nothing announces that."""


class Closeable(Protocol):
    """Something a node owns."""

    def close(self) -> None:
        """Release everything; may be called twice."""


class Entity:
    """An entity of a node: it closes with the node, or before; its constructor ends with `EntityScope.own`."""

    def __init__(self, scope: EntityScope) -> None:
        self._scope = scope
        self._closed = False

    def close(self) -> None:
        """Release everything; may be called twice."""
        raise NotImplementedError

    def destroy(self) -> None:
        """Do the same as `close`; the name in rclpy."""
        self.close()

    def _begin_close(self, *guids: bytes) -> bool:
        """What `close` begins with: True the first time; then it is not owned any more, and `guids` are withdrawn."""
        if self._closed:
            return False
        self._closed = True
        self._scope.unregister(self, *guids)
        return True


class CompositeEntity(Entity):
    """What is made of parts: whatever is made with `_parts` ends with it, endpoints as well as tasks."""

    def __init__(self, scope: EntityScope, *, type_hash_check: TypeCheck | None = None) -> None:
        super().__init__(scope)
        self._parts = scope.create_child()
        self._parts.type_hash_check = checked_mode(type_hash_check, scope.type_hash_check)

    def close(self) -> None:
        """Close everything this is made of. From any thread; may be called twice."""
        if self._begin_close():
            self._parts.close()


def entity_repr(owner: Entity, *parts: str, peers: Callable[[], int], peer: str) -> str:
    """A `repr`: ``Publisher(/chatter, std_msgs/msg/String, reliable, volatile, keep last 10, 2 subscriptions)``.

    It never fails and never waits: nothing that is closed, or was forked, is asked for its `peers`.
    """
    state = "closed" if owner._closed or owner._scope.closed else pluralize(peers(), peer)
    return f"{type(owner).__name__}({', '.join((*parts, state))})"


def pluralize(number: int, what: str) -> str:
    """``1 server``, ``2 servers``."""
    return f"{number} {what}{'' if number == 1 else 's'}"


class Throttle:
    """Lets something pass at most once a second; one for each endpoint, so that one cannot silence another."""

    def __init__(self, clocks: ClockFunctions) -> None:
        self._steady_ns = clocks.steady_ns
        self._next_ns = 0

    def allows(self) -> bool:
        """True when the last time it said so was a second ago."""
        now_ns = self._steady_ns()
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + NS_PER_S
        return True


class EntityScope:
    """One node's share of a context; or of that, what belongs to one `CompositeEntity`."""

    def __init__(
        self,
        participant: Participant,
        bridge: LoopBinding,
        discovery: Discovery,
        request_windows: RequestFlowControls,
        clocks: ClockFunctions,
        number: int,
        fully_qualified_name: str,
        on_error: OnError = "log",
    ) -> None:
        """`number` is the node's in `discovery`."""
        self.participant = participant
        self.bridge = bridge
        self.discovery = discovery
        self.graph = discovery.graph
        self.clocks = clocks
        self.number = number
        self.node_name = fully_qualified_name
        self.logger = node_logger(fully_qualified_name)
        self.failures = CallbackFailures(bridge, on_error)
        """What becomes of exceptions in functions of the user."""
        self.closed = False
        self.owned: dict[int, Closeable] = {}
        """Everything that has to be closed with this scope, oldest first; emptied by `close`."""
        self.with_callbacks: dict[int, object] = {}
        """Entities with a function of the user, by `id`; those that the user closed before the node are not in it."""
        self.type_hash_check: TypeCheck = "error"
        """What endpoints do about messages of another definition, where they are not told otherwise."""
        self.request_window = request_windows.of
        """All clients of a service in one context share its window."""
        self._tasks: set[asyncio.Task[Any]] = set()
        self._node: EntityScope | None = None
        """The node's, in one that is nested."""

    def create_child(self) -> EntityScope:
        """One that closes before the node does: what it owns, and its tasks, are its own, the rest is the node's."""
        child = copy.copy(self)
        child.owned, child._tasks, child._node = {}, set(), self._node or self
        return child

    def make_clock(self, clock_type: ClockType = ClockType.ROS_TIME) -> Clock:
        """A clock that goes as those of everybody this node can meet."""
        own = self.clocks
        return Clock(clock_type, system_ns=own.system_ns, steady_ns=own.steady_ns, on_failure=self.report_failure)

    # ---------------------------------------------------------------------------------------------------- entities

    def register(self, endpoint: Closeable, *, reader: bytes = b"", writer: bytes = b"") -> None:
        """Announce these GUIDs, and close `endpoint` with the scope; it lives until then, or until it calls
        `unregister`.

        Raises:
            ClosedError: the scope was closed meanwhile, by another thread; then the endpoint is closed, too.
        """
        self.owned[id(endpoint)] = endpoint
        if reader or writer:
            self.discovery.change_endpoints(self.number, reader=reader, writer=writer)
        if self.closed:
            self.owned.pop(id(endpoint), None)
            endpoint.close()
            self.require_open(False, "the node")

    def set_type_hash_check(self, mode: TypeCheck, *guids: bytes) -> None:
        """What endpoints of ours do about others of another definition; said before they are announced."""
        if mode != "error":
            self.discovery.type_hash_checks.update(dict.fromkeys(guids, mode))

    def unregister(self, endpoint: object, *guids: bytes) -> None:
        """Undo `register`; nothing is announced when the whole node is going."""
        self.owned.pop(id(endpoint), None)
        if (self._node or self).closed:
            return
        self.with_callbacks.pop(id(endpoint), None)
        if guids:
            self.discovery.change_endpoints(self.number, remove=guids)

    def require_open(self, closed: bool, what: str) -> None:
        """Raise `ClosedError` when the endpoint or the node is closed."""
        if closed or self.closed:
            named = f"node {self.node_name}" if what == "the node" else f"{what} of node {self.node_name}"
            raise ClosedError(f"{named} is closed")

    def close(self) -> None:
        """Cancel all tasks but the calling one, close everything that is owned, newest first, withdraw the node.

        May be called twice.
        """
        # One graph message at the end of a node, not one per endpoint. What another thread is making just now closes
        # itself, and what comes of a task that is cancelled counts as its end.
        self.closed = True
        here = current_loop()
        for task in self._tasks - {None if here is None else asyncio.current_task()}:
            loop = task.get_loop()
            if loop is here:
                task.cancel()
            else:
                with contextlib.suppress(RuntimeError):  # it is closed
                    loop.call_soon_threadsafe(task.cancel)
        for endpoint in reversed(list(self.owned.values())):
            endpoint.close()
        self.owned.clear()
        if self._node is None:
            self.discovery.remove_node(self.number)

    def abandon(self, reason: str) -> None:
        """In a forked child: look closed, and touch nothing of the transport; errors give the reason."""
        self.closed = True
        self.node_name += f" ({reason})"
        for part in self.owned.values():
            if isinstance(part, CompositeEntity):
                part._parts.abandon(reason)
        self.owned.clear()

    # ----------------------------------------------------------------------------------------------------- waiting

    async def wait_until(
        self,
        condition: Callable[[], object],
        timeout_s: float | None,
        is_closed: Callable[[], bool],
        *,
        poll_s: float = _MATCH_POLL_INTERVAL_S,
    ) -> bool:
        """Wait until `condition` holds; checked at every change of the graph and every `poll_s` seconds.

        Returns:
            False when the time passed.

        Raises:
            ClosedError: whoever waits is closed, or was meanwhile. TypeError, ValueError: see `Deadline`.
        """
        deadline = Deadline(timeout_s)
        self.require_open(is_closed(), "what was waited for")
        self.bridge.running_loop()

        def is_over() -> bool:
            self.require_open(is_closed(), "what was waited for")
            return bool(condition())

        while not await self.discovery.changes.wait(is_over, deadline.remaining_s(poll_s)):
            if deadline.is_expired():
                return False
        return True

    async def wait_or_raise(
        self,
        condition: Callable[[], object],
        timeout_s: float | None,
        is_closed: Callable[[], bool],
        missing: Callable[[], str],
        *,
        why: Callable[[], str] = lambda: "",
        poll_s: float = _MATCH_POLL_INTERVAL_S,
    ) -> Literal[True]:
        """Wait for a user until `condition` holds: `missing` returns what did not come in time, `why` the reason.

        Returns:
            True, so that what was written for an answer of true or false reads the same.

        Raises:
            WaitTimeoutError: the time passed. Others as `wait_until`.
        """
        if not await self.wait_until(condition, timeout_s, is_closed, poll_s=poll_s):
            raise WaitTimeoutError(f"{missing()} in {timeout_s:g} s", why())
        return True

    def why_unmatched(
        self, own: bytes, channel: TopicKey, *, is_writer: bool, matched: Collection[bytes] = (), ending: str = ""
    ) -> UnmatchedReason:
        """Return why an endpoint has no other peers than `matched`; see `UnmatchedReasons.why`."""
        self.discovery.refresh()
        return self.discovery.unmatched.why(own, channel, is_writer=is_writer, matched=matched, ending=ending)

    # --------------------------------------------------------------------------------------------------- callbacks

    def create_task(self, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine as a task that is kept alive, and cancelled when the scope closes."""
        task = start_task(self.bridge.running_loop(), coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def run_blocking(self, coroutine: Coroutine[Any, Any, T], what: str, instead: str) -> T:
        """Run a coroutine from plain code, on the loop that runs, or on one that is kept for the purpose.

        Raises:
            WouldDeadlockError: `what` was called inside the event loop, where `instead` is to be used. ClosedError.
        """
        in_loop = self.bridge.in_loop_thread() or current_loop() is not None
        if in_loop or self.closed:
            coroutine.close()
            self.require_open(False, "the node")
            raise WouldDeadlockError(
                f"{what} from inside the event loop would wait for ever; use {instead} in an async function, or call "
                "it from another thread"
            )
        raises = self.failures.on_error == "raise"
        return self.bridge.run(self.failures.run_guarded(coroutine) if raises else coroutine)

    def report_failure(self, doing: str) -> None:
        """Log the exception being handled, with its traceback, as the node; raise it where that is asked for."""
        self.failures.report(doing, self.logger)
