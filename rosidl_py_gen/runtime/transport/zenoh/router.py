"""Zenoh router like rmw_zenoh_cpp's `rmw_zenohd`, through which peers discover each other and clients exchange data."""

from __future__ import annotations

import contextlib
import json
import os
import socket
from typing import TYPE_CHECKING
from weakref import WeakSet

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.runtime.transport.api import TransportError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import zenoh
    from typing_extensions import Self


class ZenohRouter:
    """Zenoh router that runs in this process until it is closed; a context manager.

    Args:
        environ: environment with ZENOH_ROUTER_CONFIG_URI and ZENOH_CONFIG_OVERRIDE.
        warn: called for each skipped pair of ZENOH_CONFIG_OVERRIDE.
        listen: endpoints instead of the configured ones; ``tcp/127.0.0.1:0`` uses a free port.
        connect: endpoints of other routers.
        log: minimum level of Zenoh's log of this process on standard output, unless RUST_LOG is set; empty for no log.

    Raises:
        ExtraMissingError: Zenoh is not installed.
        ZenohConfigError: the configuration is not usable.
        TransportError: Zenoh refused, for example because a router exists already.
    """

    def __init__(
        self,
        environ: Mapping[str, str],
        warn: Callable[[str], None],
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        log: str = "",
    ) -> None:
        Extra.require_modules("zenoh")  # not at import: the class must be importable without Zenoh
        import zenoh

        from rosidl_py_gen.runtime.transport.zenoh.participant import (
            IPV4_ONLY,
            configured_endpoints,
            error_text,
            router_config,
        )

        if log:
            zenoh.init_log_from_env_or(log)
        if not listen and not environ.get("ZENOH_ROUTER_CONFIG_URI") and not _has_ipv6():
            listen = [IPV4_ONLY]
        config = router_config(environ, warn, listen=listen, connect=connect)
        endpoints = configured_endpoints(config, "listen")
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            where = ", ".join(endpoints) or "no endpoint"
            raise TransportError(f"no Zenoh router on {where}: {error_text(error)}") from None
        self._session: zenoh.Session | None = session
        _routers.add(self)
        self.zid: str = str(session.info.zid())
        """Zenoh id of the router, hexadecimal."""
        self.endpoints: list[str] = self._locators() or endpoints
        """Endpoints that sessions can connect to; a wildcard address is replaced by each address of this machine."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the router. May be called twice; does nothing in a forked child, whose parent has the router."""
        import zenoh

        if self._session is not None:
            with contextlib.suppress(zenoh.ZError):  # raised after a while on a busy machine
                self._session.close()  # type: ignore[no-untyped-call]

    def _detach_after_fork(self) -> None:
        from rosidl_py_gen.runtime.transport.zenoh.endpoints import leak_after_fork

        leak_after_fork(self._session)
        self._session = None

    def _locators(self) -> list[str]:
        """Return the endpoints that the router's admin space lists; empty if the admin space is disabled."""
        assert self._session is not None
        for reply in self._session.get(f"@/{self.zid}/router"):
            if reply.ok is not None:
                return [str(locator) for locator in json.loads(reply.ok.payload.to_bytes()).get("locators", [])]
        return []


_routers: WeakSet[ZenohRouter] = WeakSet()


def _after_fork() -> None:
    for router in list(_routers):
        router._detach_after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _has_ipv6() -> bool:
    """Return True if this machine has IPv6, which the router's default endpoint needs."""
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as trial:
            trial.bind(("::", 0))
    except OSError:
        return False
    return True
