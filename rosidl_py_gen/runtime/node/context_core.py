"""What a context consists of: arguments, participant, graph, the bridge to the event loop, and the nodes it closes.

`Context` is what users hold of it. Decides the order in which a context opens and closes.
"""

from __future__ import annotations

import os
import sys
import threading
import warnings
import weakref
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
from rosidl_py_gen.runtime.entities.flow_control import RequestFlowControl
from rosidl_py_gen.runtime.graph.discovery import Discovery
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.logs.outputs import outputs
from rosidl_py_gen.runtime.loop.callback_failures import CallbacksNeverRanError, require_on_error
from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding
from rosidl_py_gen.runtime.node import context_registry
from rosidl_py_gen.runtime.node.arguments import parse_arguments
from rosidl_py_gen.runtime.node.environment import DDS, ZENOH, check_security, middleware, read_environment
from rosidl_py_gen.runtime.parameters.initial_values import InitialValues
from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.runtime.loop.callback_failures import OnError
    from rosidl_py_gen.runtime.loop.loop_runner import LoopRunner
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.transport.api import DomainSettings, Transport


class ContextCore:
    """The parts of one context; see `Context` for arguments and errors."""

    def __init__(
        self,
        domain_id: int | None,
        discovery: str | None,
        args: Sequence[str] | None,
        transport: Transport | str | None,
        on_error: OnError,
        announce_delay_s: float,
        driver: LoopRunner | None,
    ) -> None:
        self.on_error = require_on_error(on_error)
        chosen = resolve_transport(transport)
        settings = read_environment(os.environ, domain_id=domain_id, discovery=discovery)
        self.ros_arguments = parse_arguments(sys.argv if args is None else args)
        outputs.open(self.ros_arguments.logs, next(iter(self.ros_arguments.program), ""), os.environ)
        try:
            self._open(settings, chosen, announce_delay_s, driver)
        except BaseException:
            outputs.close()
            raise

    def _open(
        self, settings: DomainSettings, transport: Transport, announce_delay_s: float, driver: LoopRunner | None
    ) -> None:
        for sentence in (*settings.warnings, *self.ros_arguments.warnings):
            get_root_logger().warning(sentence)
        self.settings = settings
        self.clocks = transport.clocks
        self.participant = transport.open(settings, self.ros_arguments.enclave)
        self.bridge = LoopBinding(self.participant, driver)
        self.discovery = Discovery(self.participant, self.bridge, announce_delay_s)
        self.request_windows = weakref.WeakValueDictionary[TopicKey, RequestFlowControl]()
        self.initial_values = InitialValues(self.ros_arguments.parameters)
        """Of parameters, for all nodes."""
        self.closed = ""
        """Why it is closed, for errors; empty while it is open."""
        self.is_default = False
        """Whether nodes share it that are given no context; then it closes with its last node."""
        self._had_loop = threading.Event()
        self.bridge.on_start(self._had_loop.set)
        self._nodes: dict[int, Node] = {}
        if driver is not None:
            try:
                driver.call(lambda: self.bridge.attach(driver.loop))
            except BaseException:
                self.participant.close()
                raise
        context_registry.add(self)

    def require_open(self) -> None:
        """Raise `ClosedError` when the context is closed."""
        if self.closed:
            raise ClosedError(self.closed)

    @property
    def had_loop(self) -> bool:
        """Whether an event loop was ever attached; before that no callback runs."""
        return self._had_loop.is_set()

    def unserved(self, scope: EntityScope) -> CallbacksNeverRanError | None:
        """Return the error of a node with callbacks that no event loop has served; the next call returns None."""
        entities = scope.with_callbacks.values()
        if self.had_loop or all(getattr(one, "is_canceled", False) for one in entities):  # timers have that
            return None
        scope.with_callbacks.clear()
        return CallbacksNeverRanError(
            f"the callbacks of {scope.node_name} never ran: no event loop has served the node; use `async with` on it, "
            "spin(node) or run(main); in a test an async function, asyncio.run or ros_loop.run"
        )

    # ------------------------------------------------------------------------------------------------------- nodes

    @property
    def scopes(self) -> list[EntityScope]:
        """Those of the open nodes."""
        return [node._scope for node in self._nodes.values()]

    def open_scope(self, names: NodeNames, on_error: OnError | None = None) -> EntityScope:
        """Announce a node and make what its endpoints share; raises `ClosedError`."""
        self.require_open()
        chosen = self.on_error if on_error is None else require_on_error(on_error)
        number = self.discovery.add_node(names.name, names.namespace)
        return EntityScope(
            self.participant,
            self.bridge,
            self.discovery,
            self.request_windows,
            self.clocks,
            number,
            names.fully_qualified_name,
            chosen,
        )

    def adopt(self, node: Node) -> None:
        """Keep a node until it closes or `close` closes it."""
        self._nodes[node._scope.number] = node

    def release(self, node: Node) -> None:
        """Forget a closed node; the default context closes with its last node."""
        self._nodes.pop(node._scope.number, None)
        self.close_if_unused()

    def close_if_unused(self) -> None:
        """Close the default context when it has no node, because the last one left or the first one failed."""
        if not self._nodes and self.is_default:
            self.close()

    # ------------------------------------------------------------------------------------------------------ closing

    def close(self) -> None:
        """Close all nodes and leave the domain; may be called twice."""
        if self.closed:
            return
        self.closed = "this context is closed"
        context_registry.discard(self)
        for node in list(self._nodes.values()):
            node.close()
        self.initial_values.close()
        self.discovery.close()
        self.bridge.close()
        self.participant.close()
        outputs.close()

    def close_at_exit(self) -> None:
        """Close what is still open when the process ends, and warn about the nodes."""
        for node in self._nodes.values():
            warnings.warn(f"node {node._scope.node_name} was never closed", ResourceWarning, stacklevel=1)
        self.close()

    def abandon(self, reason: str) -> None:
        """In a forked child: look closed, and touch nothing of the transport; errors give the reason."""
        self.closed = f"this context is closed: it was {reason}"
        self.bridge.abandon(self.closed)
        for node in self._nodes.values():
            node._scope.abandon(reason)
        self.participant.detach_after_fork()


def resolve_transport(transport: Transport | str | None) -> Transport:
    """The transport that an argument means; None: the environment decides.

    Raises:
        TypeError: there is no such transport. BackendMissingError: it is not installed.
        EnvironmentSettingError: it reaches a network, and security is enforced.
    """
    warn = get_root_logger().warning
    name = middleware(os.environ, warn) if transport is None else transport
    if name in (DDS, ZENOH):
        check_security(os.environ, warn)
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
