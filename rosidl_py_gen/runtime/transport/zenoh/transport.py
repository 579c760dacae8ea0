"""Zenoh transport: opens a session for a context and waits for a router.

Zenoh cannot be used after a fork: its threads, which all sessions of a process share, do not exist in the child, and
the first call would never return.
"""

from __future__ import annotations

import os
import time
from typing import ClassVar

from rosidl_py_gen.base.resources import install_command
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.transport.api import SYSTEM_CLOCKS, BackendMissingError, DomainSettings, TransportError

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

_ROUTER_RETRY_INTERVAL_S = 1.0
"""Interval between two checks for a router, in seconds; the same as in rmw_zenoh_cpp."""
_ROUTER_POLL_INTERVAL_S = 0.001


class ZenohTransport:
    """Transport that joins domains by Zenoh sessions, which `config.py` configures."""

    _was_used: ClassVar[bool] = False
    _is_forked: ClassVar[bool] = False

    clocks = SYSTEM_CLOCKS

    def open(self, settings: DomainSettings, enclave: str = "/") -> ZenohParticipant:
        """Open a Zenoh session and join the domain of `settings`; discovery range and static peers are ignored.

        Raises:
            ZenohConfigError: a configuration file or environment variable is not usable.
            TransportError: Zenoh cannot open a session, or this process was forked from a process that uses Zenoh.
        """
        if ZenohTransport._is_forked:
            raise TransportError(
                "this process was forked from one that uses Zenoh, whose threads do not exist here; start it with "
                'multiprocessing\'s "spawn" method, or fork before the first node is created'
            )
        config = session_config(os.environ, get_root_logger().warning)
        # Otherwise Zenoh waits for all discovered peers, often half a second for one that is gone.
        insert(config, "open/return_conditions/connect_scouted", "false", where="own settings")
        attempts, humble = router_attempts(os.environ), is_humble(os.environ)
        where = ", ".join(endpoints_of(config, "connect"))
        ZenohTransport._was_used = True
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            reason = str(error).split(" at ", 1)[0]
            raise TransportError(
                f"Zenoh could not open a session: {reason}. It was configured to connect to {where or 'no endpoint'}"
            ) from None
        _check_for_router(session, attempts, where or "any endpoint")
        return ZenohParticipant(session, settings.domain_id, enclave, is_humble=humble)

    @classmethod
    def after_fork(cls) -> None:
        """Refuse to use Zenoh in this forked child if the parent has used it."""
        cls._is_forked = cls._was_used


def _check_for_router(session: zenoh.Session, attempts: float, where: str) -> None:
    """Wait for a router as configured by ZENOH_ROUTER_CHECK_ATTEMPTS, and warn if there is none."""
    if attempts <= 0 or _wait_for_router(session, _ROUTER_RETRY_INTERVAL_S):
        return
    if attempts > 1:
        get_root_logger().warning(f"waiting for a Zenoh router at {where}")
        if _wait_for_router(session, (attempts - 1) * _ROUTER_RETRY_INTERVAL_S):
            return
    get_root_logger().warning(
        f"no Zenoh router answers at {where}, so other processes are not found; start `rosidl-py zenoh-router`. The "
        "connection is retried"
    )


def _wait_for_router(session: zenoh.Session, timeout_s: float) -> bool:
    end_s = time.monotonic() + timeout_s
    while not session.info.routers_zid():
        if time.monotonic() >= end_s:
            return False
        time.sleep(_ROUTER_POLL_INTERVAL_S)
    return True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=ZenohTransport.after_fork)
