"""A context: one DDS participant, its graph, and the event loop its nodes live on.

Decides how arguments, environment and defaults become a participant. Nodes share the default context unless they are
given another one; it is opened by the first node and closed with the last.
"""

from __future__ import annotations

import atexit
import itertools
import os
import sys
import threading
import weakref
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.arguments import parse_arguments
from rosidl_py_gen.runtime.bridge import Bridge
from rosidl_py_gen.runtime.ddsnames import participant_user_data
from rosidl_py_gen.runtime.discovery import Discovery
from rosidl_py_gen.runtime.environment import cyclone_xml, read_environment
from rosidl_py_gen.runtime.log_console import install_console, read_console_environment, remove_console
from rosidl_py_gen.runtime.logging import get_root_logger, set_logger_level
from rosidl_py_gen.runtime.sync_calls import SyncCalls

if TYPE_CHECKING:
    from collections.abc import Coroutine, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.arguments import RosArguments
    from rosidl_py_gen.runtime.scope import Closable
    from rosidl_py_gen.runtime.transport import Transport

T = TypeVar("T")

_TUNING = '<Internal><SocketReceiveBufferSize max="32MiB"/></Internal>'
"""XML below ``<Domain>`` for every domain of ours; the user's CYCLONEDDS_URI wins over it.

The kernel grants at most net.core.rmem_max. With Cyclone's own 1 MiB a fifth of 6 MB images was lost on loopback, with
4 MiB none.
"""


class Context:
    """One participant of a DDS domain.

    Args:
        domain_id: None means ``ROS_DOMAIN_ID``, else 0.
        discovery: ``"localhost"``, ``"subnet"`` or ``"off"``; None means the environment (protocol.md 10.6).
        args: a command line that may contain ``--ros-args``; None means `sys.argv`.
        transport: None means DDS; a `MemoryTransport` stays inside this process.

    Raises:
        EnvironmentSettingError, RosArgumentError, TransportError, BackendMissingError.
    """

    _default: ClassVar[Context | None] = None
    _default_lock: ClassVar[threading.RLock] = threading.RLock()

    def __init__(
        self,
        domain_id: int | None = None,
        *,
        discovery: str | None = None,
        args: Sequence[str] | None = None,
        transport: Transport | None = None,
    ) -> None:
        settings = read_environment(os.environ, domain_id=domain_id, discovery=discovery)
        self.ros_arguments: RosArguments = parse_arguments(sys.argv if args is None else args)
        self.arguments = list(self.ros_arguments.program)
        """What is left for the program, like `sys.argv`: its name first, without ROS arguments."""
        self._apply_logging()
        for sentence in (*settings.warnings, *self.ros_arguments.warnings):
            get_root_logger().warning(sentence)
        self.domain_id = settings.domain_id
        self.settings = settings
        xml = cyclone_xml(settings, process_id=os.getpid(), extra=_TUNING)
        chosen = transport if transport is not None else _dds()
        user_data = participant_user_data(self.ros_arguments.enclave)
        self.participant = chosen.open(settings.domain_id, user_data, cyclone_xml=xml)
        self.bridge = Bridge(self.participant)
        self.discovery = Discovery(self.participant, self.bridge)
        self.entity_numbers = itertools.count(1)
        self._closed = False
        self._shared = False
        self._nodes: weakref.WeakSet[Closable] = weakref.WeakSet()
        self._node_count = 0
        self._sync_calls = SyncCalls(self.bridge)
        _open_contexts.add(self)

    def _apply_logging(self) -> None:
        install_console(read_console_environment(os.environ))
        if not self.ros_arguments.stdout_logs:
            remove_console()
        if self.ros_arguments.log_level is not None:
            set_logger_level("", self.ros_arguments.log_level)
        for name, level in self.ros_arguments.log_levels:
            set_logger_level(name, level)

    # ----------------------------------------------------------------------------------------------------- sharing

    @classmethod
    def default(cls) -> Context:
        """The context that nodes share when they are not given one; opened when there is none."""
        with cls._default_lock:
            if cls._default is None or cls._default.is_closed:
                cls._default = cls()
                cls._default._shared = True
            return cls._default

    @classmethod
    def close_default(cls) -> None:
        """Close the shared context if there is one, and with it the nodes that were left open."""
        with cls._default_lock:
            context, cls._default = cls._default, None
        if context is not None:
            context.close()

    def adopt(self, node: Closable) -> None:
        """Count a node in; `close` will close it."""
        self.require_open()
        self._nodes.add(node)
        self._node_count += 1

    def release(self, node: Closable) -> None:
        """Count a node out; the default context closes with its last node."""
        self._nodes.discard(node)
        self._node_count -= 1
        if self._shared and self._node_count == 0:
            self.close()

    def require_open(self) -> None:
        """Raise `ClosedError` when the context is closed."""
        if self._closed:
            raise ClosedError("this context is closed")

    @property
    def is_closed(self) -> bool:
        """True after `close`."""
        return self._closed

    # -------------------------------------------------------------------------------------------------------- loop

    def run_until_complete(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine from plain code, on the loop that runs, or on one that this context keeps for the purpose."""
        if self._closed:
            coroutine.close()
            self.require_open()
        return self._sync_calls.run(coroutine)

    # ------------------------------------------------------------------------------------------------------ closing

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        self.bridge.running_loop()
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all nodes and leave the domain; may be called twice."""
        if self._closed:
            return
        self._closed = True
        _open_contexts.discard(self)
        for node in list(self._nodes):
            node.close()
        self.discovery.close()
        self.bridge.close()
        self.participant.close()
        self._sync_calls.close()


def _dds() -> Transport:
    from rosidl_py_gen.runtime.cyclone import CycloneTransport

    return CycloneTransport()


_open_contexts: weakref.WeakSet[Context] = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    """Leave the domains before the interpreter goes, so that peers see it at once and no DDS thread outlives Python."""
    for context in list(_open_contexts):
        context.close()
