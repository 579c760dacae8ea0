"""Base classes of entities (publishers, clients and so on), and the scope: all that the entities of one node share.

Entities get an `EntityScope` and a resolved name, never the node: a node owns its entities, and a reference back would
make a cycle. A scope closes everything that was created with it. An entity that consists of other entities has a nested
scope.
"""

from __future__ import annotations

import asyncio
import contextlib
import copy
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

from rosidl_py_gen.base.callbacks import RegistrationSet, require_signature
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.clocks import Clock
from rosidl_py_gen.runtime.graph import DEFAULT_CHECK, checked_mode
from rosidl_py_gen.runtime.logs import node_logger
from rosidl_py_gen.runtime.loop.callbacks import CallbackFailures, UserCallback, require_callable, start_task
from rosidl_py_gen.runtime.loop.shared_loop import WouldDeadlockError
from rosidl_py_gen.runtime.time_values import ClockType, Deadline, WaitTimeoutError
from rosidl_py_gen.runtime.transport.latch import Latch

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Coroutine

    from rosidl_py_gen.base.callbacks import Registration
    from rosidl_py_gen.runtime.discovery import Discovery, UnmatchedReason
    from rosidl_py_gen.runtime.graph import TypeCheck
    from rosidl_py_gen.runtime.loop.callbacks import OnError
    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding
    from rosidl_py_gen.runtime.transport.api import ClockFunctions, DiscoveredEndpoint, Participant, TopicKey
    from rosidl_py_gen.runtime.transport.flow_control import RequestWindows

T = TypeVar("T")

_MATCH_POLL_INTERVAL_S = 0.05
"""Interval in seconds of checks for matched endpoints. DDS matches endpoints some time after their discovery, without
an event."""
QOS_HINT = "; QoS is given as qos=..."


class Closeable(Protocol):
    """Object that a scope can own and close: an entity, a queue or a registration."""

    def close(self) -> None:
        """Release all resources; may be called twice."""


class Entity:
    """Entity of a node, which closes at the latest with the node.

    Constructors of subclasses end with `EntityScope.register`.
    """

    def __init__(self, scope: EntityScope) -> None:
        self._scope = scope
        self._closed = False
        self._close_latch = Latch()

    def close(self) -> None:
        """Release all resources of the entity; may be called twice."""
        raise NotImplementedError

    def destroy(self) -> None:
        """Do the same as `close`; for compatibility with rclpy."""
        self.close()

    def _described(self) -> str:
        """Return the kind and name of the entity for error texts, such as ``the publisher on /chatter``."""
        raise NotImplementedError

    def _require_open(self) -> None:
        if self._closed or self._scope.closed:
            self._scope.require_open(True, self._described())

    def _begin_close(self, *guids: bytes) -> bool:
        """Unregister the entity from its node, and withdraw its endpoints with these GUIDs from peers.

        Returns False if the entity was closed before.
        """
        if not self._close_latch.set():
            return False
        self._closed = True
        self._scope.unregister(self, *guids)
        return True


class CallbackInUseError(RosidlError, TypeError):
    """Raised if the program tries to receive from an entity that has a callback."""


class PollableEntity(Entity):
    """Entity with a method `take`: a subscription, a server or a timer.

    Functions added with `on_ready` are called on the event loop, once for each arrival. Arrived data stays in the queue
    of its entity until `take`, `receive` or an iteration removes it.
    """

    _callback: UserCallback | None
    """Callback of the user, which gets all arrived data; None if the program receives by `take` or iteration."""
    _contents = "messages"
    """Noun for error texts that names the data which the callback takes."""
    _listeners: RegistrationSet[UserCallback] | None = None
    _on_arrival: Callable[[], None] | None = None
    """Function that calls the listeners of `on_ready`; None until the first listener is added."""

    @property
    def is_ready(self) -> bool:
        """True if data has arrived and was not taken yet; False after `close`."""
        return not self._closed and self._is_ready()

    def on_ready(self, function: Callable[[], object]) -> Registration:
        """Call a function without arguments when something can be taken, until the returned registration is closed.

        The function is called on the event loop, or by the thread that runs the loop of a `LoopRunner`, for each
        arrival; and immediately, if something can be taken already. Arrivals may coincide, so take until `take` returns
        None. The function should only wake up the consumer: `LoopRunner.wake`, `threading.Event.set`. Its exceptions
        are logged like the exceptions of any callback.

        Raises:
            CallbackInUseError: the entity has a callback, which takes everything.
            ClosedError: the entity is closed.
            TypeError: `function` is not callable, or not without arguments.
        """
        subject = f"the on_ready function of {self._described()}"
        self._require_takeable()
        listener = user_callback(self._scope, function, subject)
        if listener is None:
            raise TypeError(f"{subject} must be a function, got None")
        if self._listeners is None:
            self._listeners = RegistrationSet()
        registration = self._listeners.add(listener)
        self._on_arrival = self._notify_ready
        if self._is_ready():
            listener.call()
        return registration

    def _notify_ready(self) -> None:
        for listener in self._listeners or ():
            listener.call()

    def _require_no_callback(self) -> None:
        if self._callback is not None:
            raise CallbackInUseError(
                f"{self._described()} has a callback; its {self._contents} cannot be taken as well"
            )

    def _require_takeable(self) -> None:
        """Raise `CallbackInUseError` if the entity has a callback, `ClosedError` if it is closed."""
        self._require_no_callback()
        self._require_open()

    def _is_ready(self) -> bool:
        raise NotImplementedError


class CompositeEntity(Entity):
    """Entity that consists of other entities: all entities and tasks created with its scope `_parts` close with it."""

    def __init__(self, scope: EntityScope, *, type_hash_check: TypeCheck | None = None) -> None:
        super().__init__(scope)
        self._parts = scope.create_child()
        self._parts.type_hash_check = checked_mode(type_hash_check, scope.type_hash_check)

    def close(self) -> None:
        """Close all entities of which this entity consists. From any thread; may be called twice."""
        if self._begin_close():
            self._parts.close()


def user_callback(
    scope: EntityScope,
    function: Callable[..., object] | None,
    subject: str,
    *arguments: str,
    hint: str = "",
    type_hint: str = "",
) -> UserCallback | None:
    """Return a function of the user as a `UserCallback`; None if the function is None.

    Args:
        scope: owner of the entity.
        function: plain or async function.
        subject: name of the callback for error texts.
        arguments: descriptions of the arguments with which the function will be called.
        hint: end of the error text if the function cannot be called with these arguments.
        type_hint: end of the error text if the object is not a function.

    Raises:
        TypeError, CallbackSignatureError: the object is not a function, or cannot be called with these arguments.
    """
    require_callable(function, subject, type_hint)
    if function is None:
        return None
    require_signature(function, subject, *arguments, hint=hint)
    return UserCallback(scope, function, subject)


def entity_repr(entity: Entity, *details: str, peers: Callable[[], int], peer: str) -> str:
    """Return a `repr` such as ``Publisher(/chatter, std_msgs/msg/String, reliable, keep last 10, 2 subscriptions)``.

    The function never fails and never waits: the peers of a closed or forked entity are not counted.
    """
    state = "closed" if entity._closed or entity._scope.closed else pluralize(peers(), peer)
    return f"{type(entity).__name__}({', '.join((*details, state))})"


class Throttle:
    """Limit of one log entry per second, which each endpoint has separately, so that no endpoint silences another."""

    def __init__(self, clocks: ClockFunctions) -> None:
        self._steady_ns = clocks.steady_ns
        self._next_ns = 0

    def allows(self) -> bool:
        """Return True for at most one call per second."""
        now_ns = self._steady_ns()
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + NS_PER_S
        return True


class EntityScope:
    """Owner of the entities of a node or of a `CompositeEntity`, with the resources that these entities share."""

    def __init__(
        self,
        participant: Participant,
        loop_binding: LoopBinding,
        discovery: Discovery,
        request_windows: RequestWindows,
        clocks: ClockFunctions,
        number: int,
        fully_qualified_name: str,
        on_error: OnError = "log",
    ) -> None:
        """Create the scope of a node.

        Args:
            participant: member of the domain that creates the endpoints.
            loop_binding: event loop of the context.
            discovery: discovered peers, and the announcement of own nodes.
            request_windows: flow control of all services in the context.
            clocks: time functions of the transport.
            number: number of the node in `discovery`.
            fully_qualified_name: name of the node.
            on_error: treatment of exceptions in callbacks.
        """
        self.participant = participant
        self.loop_binding = loop_binding
        self.discovery = discovery
        self.graph = discovery.graph
        self.request_windows = request_windows
        self.clocks = clocks
        self.number = number
        self.node_name = fully_qualified_name
        self.logger = node_logger(fully_qualified_name)
        self.failures = CallbackFailures(loop_binding, on_error)
        self.closed = False
        self.close_latch = Latch()
        """Flag that exactly one call of `close` sets, so that the scope is closed once."""
        self.owned: dict[int, Closeable] = {}
        """Objects that the scope closes when it closes, by `id`, oldest first; emptied by `close`."""
        self.with_callbacks: dict[int, object] = {}
        """Entities with a callback of the user, by `id`, except entities that the user closed before the node."""
        self.type_hash_check: TypeCheck = DEFAULT_CHECK
        """Default of `type_hash_check` for entities that are created without this argument."""
        self.tasks: set[asyncio.Task[Any]] = set()
        self._node: EntityScope | None = None
        """Scope of the node if this scope belongs to a composite entity; None in the scope of a node."""

    def create_child(self) -> EntityScope:
        """Create a nested scope with its own entities and tasks, which may close before the node does."""
        child = copy.copy(self)
        child.owned, child.tasks, child._node = {}, set(), self._node or self
        child.close_latch = Latch()
        return child

    def make_clock(self, clock_type: ClockType = ClockType.ROS_TIME) -> Clock:
        """Create a clock that reads the time functions of the transport (real or virtual time)."""
        functions = self.clocks
        return Clock(
            clock_type, system_ns=functions.system_ns, steady_ns=functions.steady_ns, on_failure=self.report_failure
        )

    def register(self, entity: Closeable, *, reader: bytes = b"", writer: bytes = b"") -> None:
        """Add an entity, which the scope closes when it closes, and announce the endpoints of the entity.

        The entity belongs to the scope until the entity calls `unregister`.

        Args:
            entity: entity or other object to close with the scope.
            reader: GUID of the entity's reader, if it has one.
            writer: GUID of the entity's writer, if it has one.

        Raises:
            ClosedError: another thread has closed the scope; the entity is closed, too.
        """
        self.owned[id(entity)] = entity
        if reader or writer:
            self.discovery.change_endpoints(self.number, reader=reader, writer=writer)
        if self.closed:
            self.owned.pop(id(entity), None)
            entity.close()
            self.require_open(False, "the node")

    def set_type_hash_check(
        self,
        mode: TypeCheck,
        guid: bytes,
        on_other_definition: Callable[[DiscoveredEndpoint], object] | None = None,
    ) -> None:
        """Set the type hash check of an endpoint before it is announced.

        Args:
            on_other_definition: called with each writer that has another definition than the endpoint, a reader.
        """
        if mode != DEFAULT_CHECK:
            self.discovery.type_hash_checks[guid] = mode
        if on_other_definition is not None:
            self.discovery.on_other_definition[guid] = on_other_definition

    def unregister(self, entity: object, *guids: bytes) -> None:
        """Remove an entity from the scope, and withdraw its endpoints with these GUIDs.

        While the whole node closes, nothing is withdrawn: the node is withdrawn as a whole.
        """
        self.owned.pop(id(entity), None)
        if (self._node or self).closed:
            return
        self.with_callbacks.pop(id(entity), None)
        if guids:
            self.discovery.change_endpoints(self.number, remove=guids)

    def require_open(self, closed: bool, subject: str) -> None:
        """Raise `ClosedError` that names `subject` if `closed` is true, or if the scope is closed."""
        if closed or self.closed:
            owner = f"node {self.node_name}" if subject == "the node" else f"{subject} of node {self.node_name}"
            raise ClosedError(f"{owner} is closed")

    def close(self) -> None:
        """Cancel all tasks except the calling one, close all entities, newest first, and withdraw the node.

        May be called twice.
        """
        if self.closed or not self.close_latch.set():
            return
        # The graph message is sent once, when the node is removed, not for each endpoint. An entity that another thread
        # creates at the same time closes itself in `register`.
        self.closed = True
        running_loop = current_loop()
        for task in self.tasks - {None if running_loop is None else asyncio.current_task()}:
            loop = task.get_loop()
            if loop is running_loop:
                task.cancel()
            else:
                with contextlib.suppress(RuntimeError):  # the loop is closed
                    loop.call_soon_threadsafe(task.cancel)
        for entity in reversed(list(self.owned.values())):
            entity.close()
        self.owned.clear()
        if self._node is None:
            self.discovery.remove_node(self.number)

    def abandon(self, reason: str) -> None:
        """Mark the scope and nested scopes as closed in a forked child, without a call into the transport.

        Args:
            reason: part of the texts of later `ClosedError` exceptions.
        """
        self.closed = True
        self.node_name += f" ({reason})"
        for entity in self.owned.values():
            if isinstance(entity, CompositeEntity):
                entity._parts.abandon(reason)
        self.owned.clear()

    async def wait_until(
        self,
        condition: Callable[[], object],
        timeout_s: float | None,
        entity: Entity | None = None,
        *,
        poll_s: float = _MATCH_POLL_INTERVAL_S,
    ) -> bool:
        """Wait until `condition()` is true, checked at every change of the graph and every `poll_s` seconds.

        Args:
            condition: function that returns a true value to end the wait.
            timeout_s: None waits forever.
            entity: entity on whose behalf the caller waits; None: the node.
            poll_s: interval of checks without a change of the graph.

        Returns:
            False if `timeout_s` has passed.

        Raises:
            ClosedError: the entity or the node is closed, also while waiting.
        """
        deadline = Deadline(timeout_s)
        require_open = partial(self.require_open, False, "the node") if entity is None else entity._require_open
        require_open()
        self.loop_binding.running_loop()

        def is_over() -> bool:
            require_open()
            return bool(condition())

        while not await self.discovery.changes.wait(is_over, deadline.remaining_s(poll_s)):
            if deadline.is_expired():
                return False
        return True

    async def wait_or_raise(
        self,
        condition: Callable[[], object],
        timeout_s: float | None,
        missing: Callable[[], str],
        entity: Entity | None = None,
        *,
        why: Callable[[], str] = lambda: "",
        poll_s: float = _MATCH_POLL_INTERVAL_S,
    ) -> Literal[True]:
        """Wait until `condition()` is true, like `wait_until`.

        Args:
            condition: function that returns a true value to end the wait.
            timeout_s: None waits forever.
            missing: returns the error text about what is missing.
            entity: entity on whose behalf the caller waits; None: the node.
            why: returns the reason for the error, or "".
            poll_s: interval of checks without a change of the graph.

        Raises:
            WaitTimeoutError: `timeout_s` has passed.
            ClosedError: the entity or the node is closed, also while waiting.
        """
        if not await self.wait_until(condition, timeout_s, entity, poll_s=poll_s):
            raise WaitTimeoutError(f"{missing()} in {timeout_s:g} s", why())
        return True

    def why_unmatched(
        self, guid: bytes, topic_key: TopicKey, *, is_writer: bool, matched: Collection[bytes] = (), ending: str = ""
    ) -> UnmatchedReason:
        """Return the reason why an endpoint has no peers except `matched`; arguments as for `UnmatchedReasons.why`."""
        self.discovery.refresh()
        return self.discovery.unmatched.why(guid, topic_key, is_writer=is_writer, matched=matched, ending=ending)

    def create_task(self, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine as a task that the scope cancels when it closes.

        The scope refers to the task until the task ends.
        """
        loop = asyncio.get_running_loop()
        if loop is not self.loop_binding.bound_loop:
            self.loop_binding.attach(loop)
        task = start_task(loop, coroutine)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)
        return task

    def adopt_running_loop(self) -> None:
        """Attach the event loop that runs in the calling thread, if there is one and no other loop serves the node."""
        self.loop_binding.adopt_running_loop()

    def run_blocking(self, coroutine: Coroutine[Any, Any, T], caller: object, name: str) -> T:
        """Run a coroutine of a ``..._sync`` method on the event loop, block until its end, and return its result.

        Args:
            coroutine: coroutine of the method without ``_sync``.
            caller: object whose method is called, for error texts.
            name: name of the method without ``_sync``.

        Raises:
            ClosedError: the node is closed.
            WouldDeadlockError: the calling thread runs an event loop.
        """
        in_loop = self.loop_binding.in_loop_thread() or current_loop() is not None
        if in_loop or self.closed:
            coroutine.close()
            self.require_open(False, "the node")
            raise WouldDeadlockError(
                f"{name}_sync of {caller!r} inside the event loop would deadlock; use 'await ...{name}(...)' in an "
                "async function, or call it from another thread"
            )
        raises = self.failures.on_error == "raise"
        return self.loop_binding.run(self.failures.run_guarded(coroutine) if raises else coroutine)

    def report_failure(self, activity: str) -> None:
        """Log the exception that is being handled, with its traceback, in the name of the node.

        With ``on_error="raise"`` the exception is also raised later.

        Args:
            activity: what has failed, such as ``"the callback of /chatter"``.
        """
        self.failures.report(activity, self.logger)
