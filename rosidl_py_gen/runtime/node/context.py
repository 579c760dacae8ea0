"""A context: one participant of a domain, its graph, and the event loop its nodes live on.

Decides what users see of it, and which context nodes share that are given none: it is opened by the first node and
closed with the last.
"""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING, ClassVar

from rosidl_py_gen.runtime.loop.callback_failures import FailureGuard
from rosidl_py_gen.runtime.loop.loop_runner import LoopRunner
from rosidl_py_gen.runtime.node.context_core import ContextCore

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.graph.graph import ParticipantInfo
    from rosidl_py_gen.runtime.loop.callback_failures import OnError
    from rosidl_py_gen.runtime.transport.api import DomainSettings, Transport


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
        transport: ``"dds"`` or ``"zenoh"``; None means what ``RMW_IMPLEMENTATION`` says, else DDS where a libddsc is
            found. A `MemoryTransport` stays inside this process.
        loop_runner: its loop alone serves the context. None: the asyncio loop that its nodes are used in.

    Raises:
        EnvironmentSettingError, RosArgumentError, LogFileError, BackendMissingError: as their names say.
        ClosedError: the runner is closed.
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
        loop_runner: LoopRunner | None = None,
    ) -> None:
        if not (loop_runner is None or isinstance(loop_runner, LoopRunner)):
            raise TypeError(f"loop_runner must be a LoopRunner, got {loop_runner!r:.100}")
        self._core = core = ContextCore(domain_id, discovery, args, transport, on_error, announce_delay_s, loop_runner)
        self._guards: list[FailureGuard] = []
        self.arguments = list(core.ros_arguments.program)
        """What is left for the program, like `sys.argv`: its name first, without ROS arguments."""
        self.settings: DomainSettings = core.settings
        """What arguments and environment came to."""
        self.domain_id = core.settings.domain_id

    # ------------------------------------------------------------------------------------------------------- domain

    @property
    def middleware(self) -> str:
        """``DDS``, ``Zenoh`` or ``memory``."""
        return self._core.participant.middleware

    @property
    def ddsc_library(self) -> str:
        """The C library that is used, its version and file, as in ``Cyclone DDS 0.10.2, /usr/lib/...``; empty when it
        is not one of several.
        """
        return self._core.participant.library

    @property
    def library_capabilities(self) -> Mapping[str, str]:
        """What depends on that library, in words: each ``"yes"`` or why not."""
        return self._core.participant.capabilities

    @property
    def services_unavailable_reason(self) -> str | None:
        """Why services of nodes on Fast DDS cannot be used here; None when they can."""
        return self._core.participant.services_unavailable_reason

    @property
    def on_incompatible_endpoint(self) -> Callable[[str, str], None] | None:
        """Function that is called, in place of a log entry, for each of our endpoints that is incompatible with a peer.

        It gets the text, and the name of the topic or service.
        """
        return self._core.discovery.on_incompatible_endpoint

    @on_incompatible_endpoint.setter
    def on_incompatible_endpoint(self, tell: Callable[[str, str], None] | None) -> None:
        self._core.discovery.on_incompatible_endpoint = tell

    def participants(self) -> list[ParticipantInfo]:
        """Every member of the domain that was found, this one included; usually each is a process."""
        self._core.require_open()
        self._core.discovery.refresh()
        return self._core.discovery.graph.participants()

    # ----------------------------------------------------------------------------------------------------- sharing

    @classmethod
    def default(cls) -> Context:
        """The context that nodes share when they are not given one; opened when there is none."""
        with cls._default_lock:
            if cls._default is None or cls._default.is_closed:
                cls._default = cls()
                cls._default._core.is_default = True
            return cls._default

    @classmethod
    def close_default(cls) -> None:
        """Close the shared context if there is one, and with it the nodes that were left open."""
        with cls._default_lock:
            context, cls._default = cls._default, None
        if context is not None:
            context.close()

    @classmethod
    def _after_fork(cls) -> None:
        """In the child: a lock that nobody holds; a thread of the parent may have held the other."""
        cls._default, cls._default_lock = None, threading.RLock()

    # ------------------------------------------------------------------------------------------------------ closing

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        bridge = self._core.bridge
        bridge.running_loop()
        self._guards.append(guard := FailureGuard(lambda failures: failures.loop_binding is bridge))
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
        """Do the same as `close`; the name in rclpy."""
        self.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=Context._after_fork)
