"""A context: one participant of a domain, its graph, and the event loop its nodes live on.

Decides how arguments, environment and defaults become a participant. Nodes share the default context unless they are
given another one; it is opened by the first node and closed with the last. Decides what becomes of contexts when the
process ends or is forked, too.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
import warnings
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeVar

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.rclpy_names import knows_rclpy
from rosidl_py_gen.runtime.endpoints.scope import Scope
from rosidl_py_gen.runtime.endpoints.window import RequestWindows
from rosidl_py_gen.runtime.graph.discovery import Discovery
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.logs.outputs import outputs
from rosidl_py_gen.runtime.loop.bridge import Bridge
from rosidl_py_gen.runtime.loop.failures import Guard, require_on_error
from rosidl_py_gen.runtime.node.arguments import parse_arguments
from rosidl_py_gen.runtime.node.environment import DDS, ZENOH, middleware, read_environment
from rosidl_py_gen.runtime.parameters.initial import InitialValues

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.graph.state import ParticipantInfo
    from rosidl_py_gen.runtime.loop.failures import OnError
    from rosidl_py_gen.runtime.names.remap import NodeNames
    from rosidl_py_gen.runtime.node.arguments import RosArguments
    from rosidl_py_gen.runtime.transport.port import DomainSettings, Transport

T = TypeVar("T")

_FORKED = (
    "made before this process was forked, and works in the parent process only: start processes with multiprocessing's "
    '"spawn" method, or make nodes after the fork'
)


class OpenNode(Protocol):
    """What a context knows of its nodes."""

    scope: Scope

    def close(self) -> None:
        """May be called twice."""


@knows_rclpy
class Context:
    """One participant of a domain.

    All contexts of one process and domain need the same settings. After a fork a context belongs to the parent process
    alone: in the child it is closed, and so are its nodes.

    Args:
        domain_id: None means ``ROS_DOMAIN_ID``, else 0.
        discovery: ``"localhost"``, ``"subnet"`` or ``"off"``; None means the environment
            (docs/internals/protocol.md 10.6).
        args: a command line that may contain ``--ros-args``; None means `sys.argv`.
        announce_delay_s: how long changes of our nodes wait for others before peers are told of them, together.
        on_error: what nodes do that are not told otherwise, when a callback raises; see `Node`.
        transport: ``"dds"`` or ``"zenoh"``; None means what ``RMW_IMPLEMENTATION`` says, else DDS where cyclonedds is
            installed. A `MemoryTransport` stays inside this process.

    Raises:
        EnvironmentSettingError, RosArgumentError, LogFileError, BackendMissingError: as their names say.
        TransportError: DDS refused, the domain is open with other settings, or this process was forked from one that
            uses DDS.
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
    ) -> None:
        self.on_error = require_on_error(on_error)
        chosen = chosen_transport(transport)
        settings = read_environment(os.environ, domain_id=domain_id, discovery=discovery)
        self.ros_arguments: RosArguments = parse_arguments(sys.argv if args is None else args)
        self.arguments = list(self.ros_arguments.program)
        """What is left for the program, like `sys.argv`: its name first, without ROS arguments."""
        outputs.open(self.ros_arguments.logs, next(iter(self.arguments), ""), os.environ)
        try:
            self._open(settings, chosen, announce_delay_s)
        except BaseException:
            outputs.close()
            raise

    def _open(self, settings: DomainSettings, transport: Transport, announce_delay_s: float) -> None:
        for sentence in (*settings.warnings, *self.ros_arguments.warnings):
            get_root_logger().warning(sentence)
        self.domain_id = settings.domain_id
        self.settings = settings
        """What arguments and environment came to."""
        self.clocks = transport.clocks
        self.participant = transport.open(settings, self.ros_arguments.enclave)
        self.bridge = Bridge(self.participant)
        self.discovery = Discovery(self.participant, self.bridge, announce_delay_s)
        self.request_windows = RequestWindows()
        self.initial_values = InitialValues(self.ros_arguments.parameters, self.bridge)
        """Of parameters, for all nodes."""
        self._closed = ""
        """Why it is closed, for errors; empty while it is open."""
        self._had_loop = threading.Event()
        self.bridge.on_start(self._had_loop.set)
        self._nodes: dict[int, OpenNode] = {}
        self._guards: list[Guard] = []
        _open_contexts.add(self)

    # ------------------------------------------------------------------------------------------------------- domain

    @property
    def middleware(self) -> str:
        """``DDS``, ``Zenoh`` or ``memory``."""
        return self.participant.middleware

    @property
    def service_refusal(self) -> str | None:
        """Why services of nodes on Fast DDS cannot be used here; None when they can."""
        return self.participant.identity_refusal

    @property
    def on_mismatch(self) -> Callable[[str], None] | None:
        """Is told, when it is set, instead of the log, which endpoints of ours do not understand those of others."""
        return self.discovery.on_mismatch

    @on_mismatch.setter
    def on_mismatch(self, tell: Callable[[str], None] | None) -> None:
        self.discovery.on_mismatch = tell

    def participants(self) -> list[ParticipantInfo]:
        """Every member of the domain that was found, this one included; usually each is a process."""
        self.require_open()
        self.discovery.refresh()
        return self.discovery.graph.participants()

    # ----------------------------------------------------------------------------------------------------- sharing

    @classmethod
    def default(cls) -> Context:
        """The context that nodes share when they are not given one; opened when there is none."""
        with cls._default_lock:
            if cls._default is None or cls._default.is_closed:
                cls._default = cls()
            return cls._default

    @classmethod
    def close_default(cls) -> None:
        """Close the shared context if there is one, and with it the nodes that were left open."""
        with cls._default_lock:
            context, cls._default = cls._default, None
        if context is not None:
            context.close()

    def open_scope(self, names: NodeNames, on_error: OnError | None = None) -> Scope:
        """Announce a node and make what its endpoints share; raises `ClosedError`."""
        self.require_open()
        chosen = self.on_error if on_error is None else require_on_error(on_error)
        number = self.discovery.add_node(names.name, names.namespace)
        return Scope(
            self.participant,
            self.bridge,
            self.discovery,
            self.request_windows,
            self.clocks,
            number,
            names.fully_qualified_name,
            chosen,
        )

    def adopt(self, node: OpenNode) -> None:
        """Keep a node until it closes or `close` closes it."""
        self._nodes[node.scope.number] = node

    def release(self, node: OpenNode) -> None:
        """Forget a closed node; the default context closes with its last node."""
        self._nodes.pop(node.scope.number, None)
        self.close_if_unused()

    def close_if_unused(self) -> None:
        """Close the default context when it has no node, because the last one left or the first one failed."""
        if not self._nodes and type(self)._default is self:
            self.close()

    def require_open(self) -> None:
        """Raise `ClosedError` when the context is closed."""
        if self._closed:
            raise ClosedError(self._closed)

    @property
    def is_closed(self) -> bool:
        """True after `close`."""
        return self._closed != ""

    # -------------------------------------------------------------------------------------------------------- loop

    @property
    def had_loop(self) -> bool:
        """Whether an event loop was ever attached; before that no callback runs."""
        return self._had_loop.is_set()

    @classmethod
    def attach_all(cls) -> None:
        """Let the running loop serve every open context that no running loop serves yet."""
        for context in sorted(_open_contexts, key=lambda context: context is not cls._default):
            context.bridge.adopt_running_loop()

    @staticmethod
    def close_served_by(loop: asyncio.AbstractEventLoop) -> None:
        """Close the contexts that this loop serves."""
        for context in list(_open_contexts):
            if context.bridge.loop is loop:
                context.close()

    # ------------------------------------------------------------------------------------------------------ closing

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        self.bridge.running_loop()
        self._guards.append(guard := Guard(lambda failures: failures.bridge is self.bridge))
        guard.__enter__()
        return self

    async def __aexit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.close()
        finally:
            self._guards.pop().__exit__(kind, error, trace)

    def close(self) -> None:
        """Close all nodes and leave the domain; may be called twice."""
        if self._closed:
            return
        self._closed = "this context is closed"
        _open_contexts.discard(self)
        for node in list(self._nodes.values()):
            node.close()
        self.initial_values.close()
        self.discovery.close()
        self.bridge.close()
        self.participant.close()
        outputs.close()

    @staticmethod
    def close_all() -> None:
        """Leave all domains before the process goes, so that peers see it at once and no DDS thread outlives Python."""
        for context in list(_open_contexts):
            context.close()

    def close_forgotten(self) -> None:
        """Close what is still open when the process ends, and warn about the nodes."""
        for node in self._nodes.values():
            warnings.warn(f"node {node.scope.node_name} was never closed", ResourceWarning, stacklevel=1)
        self.close()

    # ------------------------------------------------------------------------------------------------------ forking

    def abandon(self, reason: str) -> None:
        """In a forked child: look closed, and touch nothing of the transport; errors give the reason."""
        self._closed = f"this context is closed: it was {reason}"
        self.bridge.abandon(self._closed)
        for node in self._nodes.values():
            node.scope.abandon(reason)
        self.participant.abandon()

    @classmethod
    def after_fork(cls) -> None:
        """In the child: everything inherited looks closed.

        A child has the memory of its parent, but none of the threads that serve DDS and wait for it: a call into the
        middleware, a join or a lock may hang for ever.
        """
        cls._default, cls._default_lock = None, threading.RLock()
        for context in _open_contexts:
            context.abandon(_FORKED)
        _open_contexts.clear()
        outputs.after_fork()


def chosen_transport(transport: Transport | str | None) -> Transport:
    """The transport that an argument means; None: the environment decides.

    Raises:
        TypeError: there is no such transport. BackendMissingError: it is not installed.
    """
    name = middleware(os.environ, get_root_logger().warning) if transport is None else transport
    if name == DDS:
        from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneTransport

        return CycloneTransport()
    if name == ZENOH:
        from rosidl_py_gen.runtime.transport.zenoh.transport import ZenohTransport

        return ZenohTransport()
    if isinstance(name, (str, type)) or not callable(getattr(name, "open", None)):
        raise TypeError(
            f"transport must be 'dds', 'zenoh' or a transport object such as MemoryTransport(), got {name!r:.100}"
        )
    return name


_open_contexts: set[Context] = set()


@atexit.register
def _close_forgotten() -> None:
    for context in list(_open_contexts):
        context.close_forgotten()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=Context.after_fork)
