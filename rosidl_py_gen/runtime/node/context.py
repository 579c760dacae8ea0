"""Contexts: members of a domain that nodes share; and the base of a node's methods, which reach its context.

The first node without a context opens the default context, and the last such node closes it. Open contexts are attached
to event loops, and closed when a loop or the process ends.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import warnings
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.discovery import Discovery
from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
from rosidl_py_gen.runtime.logs import caller_stacklevel, get_root_logger, outputs
from rosidl_py_gen.runtime.loop.callbacks import CallbacksNeverRanError, FailureGuard, require_on_error
from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding
from rosidl_py_gen.runtime.loop.shared_loop import LoopRunner
from rosidl_py_gen.runtime.names import validate_enclave
from rosidl_py_gen.runtime.node.settings import DDS, ZENOH, find_security, middleware, parse_arguments, read_environment
from rosidl_py_gen.runtime.parameters.initial_values import InitialValues
from rosidl_py_gen.runtime.transport.api import BackendMissingError
from rosidl_py_gen.runtime.transport.flow_control import RequestWindows
from rosidl_py_gen.runtime.transport.latch import Latch

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.graph import ParticipantInfo
    from rosidl_py_gen.runtime.loop.callbacks import OnError
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.transport.api import DomainSettings, Transport

_FORKED = (
    "made before this process was forked, and works in the parent process only: start processes with multiprocessing's "
    '"spawn" method, or make nodes after the fork'
)
open_contexts: set[ContextCore] = set()


def _warn(sentence: str) -> None:
    get_root_logger().warning(sentence, stacklevel=caller_stacklevel())


class ContextCore:
    """Components of a `Context`, such as participant and nodes; `Context` documents parameters and exceptions."""

    def __init__(
        self,
        domain_id: int | None,
        discovery: str | None,
        args: Sequence[str] | None,
        transport: Transport | str | None,
        on_error: OnError,
        announce_delay_s: float,
        loop_runner: LoopRunner | None,
        enclave: str | None = None,
    ) -> None:
        self.on_error = require_on_error(on_error)
        if enclave is not None:
            validate_enclave(enclave)
        resolved_transport = resolve_transport(transport)
        settings = read_environment(
            os.environ, domain_id=domain_id, discovery=discovery, distro=Distribution.name_for_node()
        )
        self.ros_arguments = parse_arguments(sys.argv if args is None else args)
        self.enclave = self.ros_arguments.enclave if enclave is None else enclave
        outputs.open(self.ros_arguments.logs, next(iter(self.ros_arguments.program), ""), os.environ)
        try:
            self._open(settings, resolved_transport, announce_delay_s, loop_runner)
        except BaseException:
            outputs.close()
            raise

    def _open(
        self, settings: DomainSettings, transport: Transport, announce_delay_s: float, loop_runner: LoopRunner | None
    ) -> None:
        for sentence in (*settings.warnings, *self.ros_arguments.warnings):
            _warn(sentence)
        is_supported = getattr(transport, "has_security", False)
        security = find_security(os.environ, self.enclave, _warn, is_supported=is_supported)
        self.settings = settings = replace(settings, security=security)
        if security is not None:
            text = f"found security directory {security.folder}"
            get_root_logger().info(text, stacklevel=caller_stacklevel())
        self.clocks = transport.clocks
        self.participant = transport.open(settings, self.enclave)
        try:
            self.loop_binding = LoopBinding(self.participant, loop_runner)
            self.discovery = Discovery(self.participant, self.loop_binding, announce_delay_s)
            self.initial_values = InitialValues(self.ros_arguments.parameters)
            """Parameter values from the command line and parameter files, for all nodes of the context."""
        except BaseException:  # permissions may deny the topic of the graph
            self.participant.close()
            raise
        self.request_windows = RequestWindows()
        self.closed = ""
        """Text of `ClosedError`, such as "this context is closed"; empty while the context is open."""
        self.is_default = False
        """True for the default context, which nodes without a `context` argument use; it closes with its last node."""
        self._had_loop = threading.Event()
        self.loop_binding.on_bind(self._had_loop.set)
        self._nodes: dict[int, Node] = {}
        self.reservations = 0
        """Number of nodes under construction that will use the default context. Lock: Context._default_lock."""
        self._close_latch = Latch()
        if loop_runner is not None:
            try:
                loop_runner.call(lambda: self.loop_binding.attach(loop_runner.loop))
            except BaseException:
                self.participant.close()
                raise
        open_contexts.add(self)

    def require_open(self) -> None:
        """Raise `ClosedError` if the context is closed."""
        if self.closed:
            raise ClosedError(self.closed)

    def take_never_ran_error(self, scope: EntityScope) -> CallbacksNeverRanError | None:
        """Return an error if callbacks of a node never ran because no event loop has served the context, else None.

        The node's callbacks are then no longer recorded, so the next call for the node returns None.
        """
        entities = list(scope.with_callbacks.values())
        if self._had_loop.is_set() or all(getattr(entity, "is_canceled", False) for entity in entities):
            return None
        scope.with_callbacks.clear()
        return CallbacksNeverRanError(
            f"the callbacks of {scope.node_name} never ran: no event loop has served the node; use `async with` on it, "
            "spin(node) or run(main); in a test an async function, asyncio.run or ros_loop.run"
        )

    @property
    def scopes(self) -> list[EntityScope]:
        """Scopes of all open nodes; a scope owns the entities of its node."""
        return [node._scope for node in list(self._nodes.values())]

    def open_scope(self, names: NodeNames, on_error: OnError | None = None) -> EntityScope:
        """Announce a node to peers and return its scope, which owns the node's entities.

        Raises:
            ClosedError: the context is closed.
        """
        self.require_open()
        on_error = self.on_error if on_error is None else require_on_error(on_error)
        number = self.discovery.add_node(names.name, names.namespace)
        return EntityScope(
            self.participant,
            self.loop_binding,
            self.discovery,
            self.request_windows,
            self.clocks,
            number,
            names.fully_qualified_name,
            on_error,
        )

    def adopt(self, node: Node, *, is_reserved: bool) -> None:
        """Register a new node, which the context closes when it closes itself.

        Args:
            node: node whose construction has succeeded.
            is_reserved: end the reservation that `reserve_default_context` made for the node.
        """
        with Context._default_lock:
            self._nodes[node._scope.number] = node
            self.reservations -= is_reserved

    def release(self, node: Node) -> None:
        """Remove a closed node; the default context closes with its last node."""
        self._nodes.pop(node._scope.number, None)
        self.close_if_unused()

    def close_if_unused(self, *, is_reserved: bool = False) -> None:
        """Close the default context if it has no nodes and no reservations; has no effect on other contexts.

        Args:
            is_reserved: end the reservation of a node whose construction failed.
        """
        with Context._default_lock:
            self.reservations -= is_reserved
            if self._nodes or self.reservations or not self.is_default:
                return
            Context._forget_default(self)  # before it closes, so that no other thread gets it
        self.close()

    def close(self) -> None:
        """Close all nodes and leave the domain; may be called twice."""
        if self.closed or not self._close_latch.set():
            return
        self.closed = "this context is closed"
        open_contexts.discard(self)
        for node in list(self._nodes.values()):
            node.close()
        self.initial_values.close()
        self.discovery.close()
        self.loop_binding.close()
        self.participant.close()
        outputs.close()

    def close_at_exit(self) -> None:
        """Close the context at the end of the process, with a warning for each node that is still open."""
        for node in list(self._nodes.values()):
            warnings.warn(f"node {node._scope.node_name} was never closed", ResourceWarning, stacklevel=1)
        self.close()

    def abandon(self, reason: str) -> None:
        """Mark context and nodes as closed in a forked child, without a call into the transport.

        Args:
            reason: part of the texts of later `ClosedError` exceptions.
        """
        self.closed = f"this context is closed: it was {reason}"
        self.loop_binding.abandon(self.closed)
        for node in self._nodes.values():
            node._scope.abandon(reason)
        self.participant.endpoint_index.detach_after_fork()
        self.participant.detach_after_fork()


def resolve_transport(transport: Transport | str | None) -> Transport:
    """Return the transport for a name or a transport object.

    If the argument is None, ``RMW_IMPLEMENTATION`` selects the transport.

    Raises:
        TypeError: the argument is neither a known name nor a transport object.
        BackendMissingError: the library of the transport is not installed.
    """
    warn = get_root_logger().warning
    name = middleware(os.environ, warn) if transport is None else transport
    if name == DDS:
        from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneTransport

        return CycloneTransport()
    if name == ZENOH:
        try:
            from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohTransport
        except ImportError as error:
            raise BackendMissingError(
                "nodes on Zenoh need two more packages. Wheels of eclipse-zenoh exist for "
                "CPython 3.9 and later on Linux (x86-64, ARM; glibc), macOS and Windows (x86-64). "
                f"The import failed with: {error}. To install them: {Extra('zenoh').install_command()}",
                name=error.name,
            ) from error
        return ZenohTransport()
    if isinstance(name, (str, type)) or not callable(getattr(name, "open", None)):
        raise TypeError(
            f"transport must be 'dds', 'zenoh' or a transport object such as MemoryTransport(), got {name!r:.100}"
        )
    return name


class Context:
    """Participant of a domain, shared by nodes.

    All contexts of one process and domain must have the same settings. After a fork a context and its nodes are closed
    in the child process.

    Args:
        domain_id: None uses ``ROS_DOMAIN_ID``, else 0.
        discovery: ``"localhost"``, ``"subnet"`` or ``"off"``; None uses
            ``ROS_AUTOMATIC_DISCOVERY_RANGE``, else ``"subnet"``.
        args: command line that may contain ``--ros-args``; None uses `sys.argv`.
        announce_delay_s: time for which new and closed entities are collected before they are announced to peers.
        on_error: default of the nodes' `on_error`; see `Node`.
        transport: ``"dds"`` or ``"zenoh"``; None uses ``RMW_IMPLEMENTATION``, else DDS if a libddsc is found. A
            `MemoryTransport` connects contexts of this process.
        loop_runner: runs the event loop of the context. None: the asyncio loop in which its nodes are used.
        enclave: name of the enclave, such as ``/robot/arm``; None uses ``--enclave``, else ``/``.

    Raises:
        EnvironmentSettingError: an environment variable, or the argument of the same meaning, is invalid.
        RosArgumentError: `args` contain an invalid ROS argument.
        LogFileError: the log file cannot be created.
        BackendMissingError: the library of the transport is not installed.
        ClosedError: the runner is closed.
        InvalidNameError: `enclave` is not an absolute name.
        SecurityError: ``ROS_SECURITY_ENABLE`` requires security, and a file or the library prevents it.
        TransportError: DDS reports an error, the domain is open with other settings, or this process was forked from
            a process that uses DDS.
    """

    _default: ClassVar[Context | None] = None
    _default_lock: ClassVar[threading.RLock] = threading.RLock()

    def __init__(
        self,
        domain_id: int | None = None,
        *,
        discovery: str | None = None,
        args: Sequence[str] | None = None,
        transport: Transport | str | None = None,
        on_error: OnError = "log",
        announce_delay_s: float = 0.0,
        loop_runner: LoopRunner | None = None,
        enclave: str | None = None,
    ) -> None:
        if not (loop_runner is None or isinstance(loop_runner, LoopRunner)):
            raise TypeError(f"loop_runner must be a LoopRunner, got {loop_runner!r:.100}")
        self._core = core = ContextCore(
            domain_id, discovery, args, transport, on_error, announce_delay_s, loop_runner, enclave
        )
        self._guards: list[FailureGuard] = []
        self.arguments: list[str] = list(core.ros_arguments.program)
        """Command line without ROS arguments; like `sys.argv`, it begins with the program's name."""
        self.settings: DomainSettings = core.settings
        """Settings of the domain, such as id, discovery range and security, from arguments and environment."""
        self.domain_id = core.settings.domain_id

    @property
    def middleware(self) -> str:
        """Name of the middleware: ``DDS``, ``Zenoh`` or ``memory``."""
        return self._core.participant.middleware

    @property
    def ddsc_library(self) -> str:
        """Name, version and file of the DDS library, as in ``Cyclone DDS 0.10.2, /usr/lib/...``; empty without DDS."""
        return self._core.participant.library

    @property
    def library_capabilities(self) -> Mapping[str, str]:
        """Features that depend on the DDS library, each with ``"yes"``, or with the reason why the feature is
        unavailable.
        """
        return self._core.participant.capabilities

    @property
    def services_unavailable_reason(self) -> str | None:
        """Reason why this process cannot exchange requests with nodes on Fast DDS; None if it can."""
        return self._core.participant.services_unavailable_reason

    @property
    def on_incompatible_endpoint(self) -> Callable[[str, str], None] | None:
        """Function that is called when an endpoint of this context and a peer are incompatible, instead of writing a
        log entry.

        Its arguments are a sentence about the reason, and the name of the topic or service.
        """
        return self._core.discovery.on_incompatible_endpoint

    @on_incompatible_endpoint.setter
    def on_incompatible_endpoint(self, function: Callable[[str, str], None] | None) -> None:
        self._core.discovery.on_incompatible_endpoint = function

    def participants(self) -> list[ParticipantInfo]:
        """Return all discovered members of the domain, including this one; usually each is a process."""
        self._core.require_open()
        self._core.discovery.refresh()
        return self._core.discovery.graph.participants()

    @classmethod
    def default(cls) -> Context:
        """Return the default context, which nodes without a `context` argument use; open it if necessary."""
        with cls._default_lock:
            if cls._default is None or cls._default.is_closed:
                cls._default = cls()
                cls._default._core.is_default = True
            return cls._default

    @classmethod
    def _forget_default(cls, core: ContextCore) -> None:
        """Make the next call of `default` open a new context, if `core` is the default context now.

        Lock: _default_lock must be held.
        """
        if cls._default is not None and cls._default._core is core:
            cls._default = None

    @classmethod
    def close_default(cls) -> None:
        """Close the default context, if there is one, with its nodes."""
        with cls._default_lock:
            context, cls._default = cls._default, None
        if context is not None:
            context.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        loop_binding = self._core.loop_binding
        loop_binding.running_loop()
        self._guards.append(guard := FailureGuard(lambda failures: failures.loop_binding is loop_binding))
        guard.__enter__()
        return self

    async def __aexit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.close()
        finally:
            self._guards.pop().__exit__(kind, error, trace)

    @property
    def is_closed(self) -> bool:
        """True after `close`."""
        return self._core.closed != ""

    def close(self) -> None:
        """Close all nodes and leave the domain; may be called twice."""
        self._core.close()

    def shutdown(self) -> None:
        """Do the same as `close`; for compatibility with rclpy."""
        self.close()


def core_of(context: Context) -> ContextCore:
    """Return the internal part of a context, which its users do not see."""
    return context._core


def reserve_default_context() -> Context:
    """Return the default context, and keep it open until `adopt` or `close_if_unused` is called for this
    reservation.
    """
    with Context._default_lock:
        context = Context.default()
        context._core.reservations += 1
        return context


def attach_all() -> None:
    """Attach the running event loop to every open context that no other running loop serves."""
    for core in sorted(open_contexts, key=lambda core: not core.is_default):
        core.loop_binding.adopt_running_loop()


def close_served_by(loop: asyncio.AbstractEventLoop) -> None:
    """Close the contexts whose callbacks an event loop runs."""
    for core in list(open_contexts):
        if core.loop_binding.loop is loop:
            core.close()


def close_all() -> None:
    """Close all contexts before the process ends, so that peers notice the end at once and no DDS thread runs longer
    than Python.
    """
    for core in list(open_contexts):
        core.close()


@atexit.register
def _close_at_exit() -> None:
    # A second Ctrl-C must not leave DDS entities open: they may block the end of the interpreter for ever.
    if open_contexts and signal.getsignal(signal.SIGINT) is not command_interrupts:
        with suppress(ValueError):  # this is not the main thread
            command_interrupts.ignore_next()
    for core in list(open_contexts):
        core.close_at_exit()


def _after_fork() -> None:
    """Mark all inherited contexts as closed in a forked child.

    A child has the memory of its parent, but not the threads that serve DDS: a call into the middleware, a join or a
    lock may block forever.
    """
    Context._default, Context._default_lock = None, threading.RLock()  # a thread of the parent may have held it
    for core in open_contexts:
        core.abandon(_FORKED)
    open_contexts.clear()
    outputs.after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


class NodeBase:
    """Base class that declares the attributes which all methods of `Node` use.

    The constructor of `Node` sets the attributes.
    """

    _scope: EntityScope
    _names: NodeNames
    context: Context
    clock: Clock

    def _require_open(self) -> None:
        self._scope.require_open(False, "the node")
        self.context._core.loop_binding.adopt_running_loop()
