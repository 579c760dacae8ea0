"""A Zenoh router, as rmw_zenoh_cpp's `rmw_zenohd` is one: peers meet through it, and clients exchange all through it.

Decides how it is opened and where it says that it listens; what it does is Zenoh's business. No node is needed.
"""

from __future__ import annotations

import contextlib
import json
import socket
from typing import TYPE_CHECKING

from rosidl_py_gen.base.resources import require_modules
from rosidl_py_gen.runtime.transport.api import TransportError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from typing_extensions import Self


class ZenohRouter:
    """A router in this process, until it is closed; use it with ``with``, too.

    Args:
        environ: ZENOH_ROUTER_CONFIG_URI and ZENOH_CONFIG_OVERRIDE count.
        warn: told of what was left out of them.
        listen: endpoints in place of the configured ones; ``tcp/127.0.0.1:0`` takes a free port.
        connect: endpoints of other routers.
        log: from which level on Zenoh writes its log of this process to standard output, or as RUST_LOG says; empty for
            no log.

    Raises:
        ExtraMissingError: Zenoh is not installed.
        ZenohConfigError: the configuration cannot be used.
        TransportError: Zenoh refused, for example since there is a router already.
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
        require_modules("zenoh")  # here, so that the class can be imported with all others without it
        import zenoh

        from rosidl_py_gen.runtime.transport.zenoh.config import IPV4_ONLY, endpoints_of, error_text, router_config

        if log:
            zenoh.init_log_from_env_or(log)
        if not listen and not environ.get("ZENOH_ROUTER_CONFIG_URI") and not _has_ipv6():
            listen = [IPV4_ONLY]
        config = router_config(environ, warn, listen=listen, connect=connect)
        wanted = endpoints_of(config, "listen")
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            where = ", ".join(wanted) or "no endpoint"
            raise TransportError(f"no Zenoh router on {where}: {error_text(error)}") from None
        self.zid = str(self._session.info.zid())
        """The identity that other sessions see, in hexadecimal digits."""
        self.endpoints = self._locators() or wanted
        """Where it listens, as others may connect: of a wildcard address each address of this machine."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End it; may be called twice."""
        import zenoh

        with contextlib.suppress(zenoh.ZError):  # it gives up after a while when the machine is too busy
            self._session.close()  # type: ignore[no-untyped-call]

    def _locators(self) -> list[str]:
        """What the router tells of itself in its admin space; nothing where that is off."""
        for reply in self._session.get(f"@/{self.zid}/router"):
            if reply.ok is not None:
                told = json.loads(reply.ok.payload.to_bytes())
                return [str(locator) for locator in told.get("locators", [])]
        return []


def _has_ipv6() -> bool:
    """Whether the default endpoint, which takes IPv6 and IPv4, can be had."""
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as trial:
            trial.bind(("::", 0))
    except OSError:
        return False
    return True
