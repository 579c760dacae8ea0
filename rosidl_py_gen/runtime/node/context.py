"""Public class for a participant of a domain, and the default context.

The first node without a context opens the default context, the last one closes it.
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
    """Participant of a domain, shared by nodes.

    All contexts of one process and domain must have the same settings. After a fork a context and its nodes are closed
    in the child process.

    Args:
        domain_id: None uses ``ROS_DOMAIN_ID``, else 0.
        discovery: ``"localhost"``, ``"subnet"`` or ``"off"``; None uses
            ``ROS_AUTOMATIC_DISCOVERY_RANGE``, else ``"subnet"``.
        args: command line that may contain ``--ros-args``; None uses `sys.argv`.
        announce_delay_s: time for which changes of own nodes are collected before they are announced to peers.
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
            one that uses DDS.
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
        """Arguments without those of ROS; like `sys.argv`, they begin with the program's name."""
        self.settings: DomainSettings = core.settings
        """Settings that result from arguments and environment."""
        self.domain_id = core.settings.domain_id

    @property
    def middleware(self) -> str:
        """``DDS``, ``Zenoh`` or ``memory``."""
        return self._core.participant.middleware

    @property
    def ddsc_library(self) -> str:
        """Name, version and file of the DDS library, as in ``Cyclone DDS 0.10.2, /usr/lib/...``; empty without DDS."""
        return self._core.participant.library

    @property
    def library_capabilities(self) -> Mapping[str, str]:
        """Features that depend on the DDS library -> ``"yes"``, or the reason why a feature is unavailable."""
        return self._core.participant.capabilities

    @property
    def services_unavailable_reason(self) -> str | None:
        """Reason why services of nodes on Fast DDS are unavailable; None if they are available."""
        return self._core.participant.services_unavailable_reason

    @property
    def on_incompatible_endpoint(self) -> Callable[[str, str], None] | None:
        """Function that is called instead of a log entry if one of our endpoints is incompatible with a peer.

        It gets the text, and the name of the topic or service.
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
        """Return the context of nodes that are given none; open it if necessary."""
        with cls._default_lock:
            if cls._default is None or cls._default.is_closed:
                cls._default = cls()
                cls._default._core.is_default = True
            return cls._default

    @classmethod
    def close_default(cls) -> None:
        """Close the default context, if there is one, with its nodes."""
        with cls._default_lock:
            context, cls._default = cls._default, None
        if context is not None:
            context.close()

    @classmethod
    def _after_fork(cls) -> None:
        """Replace the lock in the child, because a thread of the parent may have held it."""
        cls._default, cls._default_lock = None, threading.RLock()

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
        """Do the same as `close`; the name in rclpy."""
        self.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=Context._after_fork)
