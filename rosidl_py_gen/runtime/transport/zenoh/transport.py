"""The transport over Zenoh: how a context gets its session.

Decides when to look for a router and what to say when there is none, and that Zenoh is not used after a fork: its
threads, which all sessions of a process share, do not come along, and the first call would wait for ever.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, ClassVar

from rosidl_py_gen.base.resources import install_command
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.transport.api import BackendMissingError, TransportError
from rosidl_py_gen.runtime.transport.clock_functions import SYSTEM_CLOCKS

try:
    import zenoh

    from rosidl_py_gen.runtime.transport.zenoh.config import (
        endpoints_of,
        insert,
        is_humble,
        router_attempts,
        session_config,
    )
    from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohParticipant
except ImportError as err:
    raise BackendMissingError(
        "nodes on Zenoh need two more packages. Wheels of eclipse-zenoh exist for "
        "CPython 3.9 and later on Linux (x86-64, ARM; glibc), macOS and Windows (x86-64). "
        f"The import failed with: {err}. To install them: {install_command('zenoh')}",
        name=err.name,
    ) from err

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.api import DomainSettings

_ROUTER_RETRY_INTERVAL_S = 1.0
"""Between two attempts of rmw_zenoh_cpp."""
_ROUTER_POLL_INTERVAL_S = 0.001


class ZenohTransport:
    """Joins domains by sessions of Zenoh; see `port.Transport`. Where they listen is decided by `config.py`."""

    _was_used: ClassVar[bool] = False
    _is_forked: ClassVar[bool] = False

    clocks = SYSTEM_CLOCKS

    def open(self, settings: DomainSettings, enclave: str = "/") -> ZenohParticipant:
        """Join the domain. Discovery range and static peers have no meaning here.

        Raises `ZenohConfigError`, `TransportError`.
        """
        if ZenohTransport._is_forked:
            raise TransportError(
                "this process was forked from one that uses Zenoh, whose threads did not come along; start it with "
                'multiprocessing\'s "spawn" method, or fork before the first node is made'
            )
        config = session_config(os.environ, get_root_logger().warning)
        # Zenoh would wait for all peers it hears of, and often half a second for one that is gone already.
        insert(config, "open/return_conditions/connect_scouted", "false", where="own settings")
        attempts, humble = router_attempts(os.environ), is_humble(os.environ)
        asked = endpoints_of(config, "connect")
        ZenohTransport._was_used = True
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            reason = str(error).split(" at ", 1)[0]
            raise TransportError(
                f"Zenoh could not open a session: {reason}. It was told to connect with {', '.join(asked) or 'nobody'}"
            ) from None
        _look_for_router(session, attempts, asked)
        return ZenohParticipant(session, settings.domain_id, enclave, is_humble=humble)

    @classmethod
    def after_fork(cls) -> None:
        """In the child: remember that the threads are gone."""
        cls._is_forked = cls._was_used


def _look_for_router(session: zenoh.Session, attempts: float, asked: list[str]) -> None:
    """Wait for a router as ZENOH_ROUTER_CHECK_ATTEMPTS says; without one, peers of this machine are not found."""
    if attempts <= 0 or _wait_for_router(session, _ROUTER_RETRY_INTERVAL_S):
        return
    where = ", ".join(asked) or "any place"
    if attempts > 1:
        get_root_logger().warning(f"waiting for a Zenoh router at {where}")
        if _wait_for_router(session, (attempts - 1) * _ROUTER_RETRY_INTERVAL_S):
            return
    get_root_logger().warning(
        f"no Zenoh router answers at {where}, so other processes are not found; start `rosidl-py zenoh-router`. This "
        "one goes on looking for it"
    )


def _wait_for_router(session: zenoh.Session, patience_s: float) -> bool:
    end_s = time.monotonic() + patience_s
    while not session.info.routers_zid():
        if time.monotonic() >= end_s:
            return False
        time.sleep(_ROUTER_POLL_INTERVAL_S)
    return True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=ZenohTransport.after_fork)
