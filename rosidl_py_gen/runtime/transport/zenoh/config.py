"""Configuration of Zenoh sessions and routers: defaults of rmw_zenoh_cpp, and its environment variables.

Sessions listen on this machine only and find each other through a router, never by multicast. Environment variables are
read from a mapping, never from `os.environ`.

Source: docs/internals/zenoh.md 1 (rmw_zenoh_cpp of Jazzy, its two configuration files and zenoh_config.cpp).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Literal

import zenoh

from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.runtime.transport.matching import FORMAT_VARIABLE

ROUTER_PORT = 7447
_MAX_QUOTED_CHARS = 200
_MAX_DEPTH = 100
"""Maximum nesting of brackets in a configuration of Zenoh; some thousands would crash Zenoh's parser."""
_BRACKET = re.compile(r"[\[{}\]]")
_SOURCE_LOCATION = re.compile(r" at \S+\.rs:\d+\.?")
_MESSAGE = re.compile(r'(?:msg: |Str\()"((?:[^"\\]|\\.)*)"')
_LINE_COLUMN = re.compile(r"line: (\d+), column: (\d+)")

_COMMON: dict[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
    "timestamping/enabled": {"router": True, "peer": True, "client": True},
    "queries_default_timeout": 600_000,
    "transport/unicast/open_timeout": 60_000,
    "transport/unicast/accept_timeout": 60_000,
    "transport/unicast/accept_pending": 10_000,
    "transport/unicast/max_sessions": 10_000,
    "transport/link/tx/lease": 60_000,
    "transport/link/tx/keep_alive": 2,
    "transport/shared_memory/enabled": False,  # used if both ends enable it
    "transport/shared_memory/transport_optimization/pool_size": 48 << 20,
    "transport/shared_memory/transport_optimization/message_size_threshold": 512,
    "adminspace/enabled": True,
}
_MAX_CONGESTION_WAIT_US = 250_000
"""Maximum time that a large message waits for a congested link before it is dropped, in microseconds. With the 50 ms of
rmw_zenoh_cpp a busy machine lost one image of ten. After the first drop Zenoh does not wait any more."""
_STRATEGY = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
_SESSION: dict[str, object] = {
    "mode": "peer",
    "connect/endpoints": [f"tcp/localhost:{ROUTER_PORT}"],
    "listen/endpoints": ["tcp/localhost:0"],
    "scouting/gossip/autoconnect_strategy": _STRATEGY,
    "scouting/multicast/autoconnect_strategy": _STRATEGY,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 60_000_000,
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": _MAX_CONGESTION_WAIT_US,
}
_ROUTER: dict[str, object] = {"mode": "router", "listen/endpoints": [f"tcp/[::]:{ROUTER_PORT}"]}
IPV4_ONLY = f"tcp/0.0.0.0:{ROUTER_PORT}"
"""Address on which a router listens on machines without IPv6, which refuse the default address."""


class ZenohConfigError(RosidlError, ValueError):
    """Raised if a configuration of Zenoh is not usable; the text names the variable or key, and quotes its value."""


def session_config(environ: Mapping[str, str], warn: Callable[[str], None]) -> zenoh.Config:
    """Return the configuration of a context's Zenoh session.

    Args:
        warn: called with a text for each skipped pair of ZENOH_CONFIG_OVERRIDE.

    Raises:
        ZenohConfigError: a variable or file is not usable.
    """
    return _configuration(environ, "ZENOH_SESSION_CONFIG_URI", {**_COMMON, **_SESSION}, warn)


def router_config(
    environ: Mapping[str, str], warn: Callable[[str], None], *, listen: Iterable[str] = (), connect: Iterable[str] = ()
) -> zenoh.Config:
    """Return the configuration of a Zenoh router.

    Args:
        warn: called with a text for each skipped pair of ZENOH_CONFIG_OVERRIDE.
        listen: endpoints that replace the configured ones, if any are given.
        connect: endpoints of other routers that replace the configured ones, if any are given.

    Raises:
        ZenohConfigError: a variable, file or endpoint is not usable.
    """
    config = _configuration(environ, "ZENOH_ROUTER_CONFIG_URI", {**_COMMON, **_ROUTER}, warn)
    for key, endpoints in (("listen/endpoints", list(listen)), ("connect/endpoints", list(connect))):
        if endpoints:
            insert(config, key, json.dumps(endpoints), where="router")
    return config


def router_attempts(environ: Mapping[str, str]) -> float:
    """Return how often a new session checks for a router, from ZENOH_ROUTER_CHECK_ATTEMPTS; `math.inf`: until found.

    Raises:
        ZenohConfigError: the variable is not a whole number.
    """
    text = environ.get("ZENOH_ROUTER_CHECK_ATTEMPTS", "")
    try:
        attempts = int(text) if text else 1
    except ValueError:
        raise ZenohConfigError(
            "ZENOH_ROUTER_CHECK_ATTEMPTS must be a whole number (0 waits for ever, a negative one does not look), "
            f"got {_quoted(text)}"
        ) from None
    return math.inf if attempts == 0 else max(0, attempts)


def is_humble(environ: Mapping[str, str]) -> bool:
    """Return True if Zenoh keys and tokens must have the format of Humble, not the format of later distributions.

    Raises:
        ZenohConfigError: the variable `FORMAT_VARIABLE` has another value than ``humble``.
    """
    text = environ.get(FORMAT_VARIABLE, "")
    if text not in ("", "humble"):
        raise ZenohConfigError(
            f"{FORMAT_VARIABLE} must be 'humble', or empty for later distributions, got {_quoted(text)}"
        )
    return text == "humble"


def insert(config: zenoh.Config, key: str, value: str, *, where: str) -> None:
    """Set a key of a configuration to a JSON5 text.

    Raises:
        ZenohConfigError: Zenoh refuses the key or value; the text begins with `where`, the origin of the value.
    """
    _require_shallow(value, f"{where}: {key}")
    try:
        config.insert_json5(key, value)
    except zenoh.ZError as error:
        raise ZenohConfigError(f"{where}: {key}={_quoted(value)}: {error_text(error)}") from None


def endpoints_of(config: zenoh.Config, kind: Literal["listen", "connect"]) -> list[str]:
    """Return the endpoints to listen on, or to connect to, that apply in the mode of a configuration."""
    endpoints = json.loads(config.get_json(f"{kind}/endpoints"))
    if isinstance(endpoints, dict):  # one list for each mode
        endpoints = endpoints.get(json.loads(config.get_json("mode")) or "peer") or []
    return [str(endpoint) for endpoint in endpoints]


def _configuration(
    environ: Mapping[str, str], variable: str, defaults: Mapping[str, object], warn: Callable[[str], None]
) -> zenoh.Config:
    path = environ.get(variable, "")
    if path:
        try:
            _require_shallow(Path(path).read_text("utf-8", "replace"), f"{variable}={_quoted(path)}")
            config: zenoh.Config = zenoh.Config.from_file(path)
        except (zenoh.ZError, OSError) as error:
            raise ZenohConfigError(f"{variable}={_quoted(path)}: {error_text(error)}") from None
    else:
        config = zenoh.Config()
        for key, value in defaults.items():
            insert(config, key, json.dumps(value), where="defaults of rmw_zenoh")
    for pair in filter(None, environ.get("ZENOH_CONFIG_OVERRIDE", "").split(";")):
        key, equals, value = pair.partition("=")
        try:
            if not equals or not value:
                raise ZenohConfigError(f"ZENOH_CONFIG_OVERRIDE: expected key=value, found {_quoted(pair)}")
            insert(config, key, value, where="ZENOH_CONFIG_OVERRIDE")
        except ZenohConfigError as error:
            hint = "; texts need quotes" if value and value.strip().isalpha() else ""
            warn(f"{error}{hint}; this pair has no effect")
    return config


def _require_shallow(text: str, where: str) -> None:
    depth = 0
    for bracket in _BRACKET.findall(text):
        depth += 1 if bracket in "[{" else -1
        if depth > _MAX_DEPTH:
            raise ZenohConfigError(f"{where}: expected at most {_MAX_DEPTH} nested brackets, found more")


def _quoted(text: str) -> str:
    return printable(repr(text if len(text) <= _MAX_QUOTED_CHARS else text[:_MAX_QUOTED_CHARS] + "..."))


def error_text(error: Exception) -> str:
    """Return the text of a Zenoh error without locations in Zenoh's sources and names of its types."""
    text = _SOURCE_LOCATION.sub("", str(error))
    message = _MESSAGE.search(text)
    if message is None:
        return printable(text.strip())
    reason = message[1].replace('\\"', '"').split("\\n")[-1].strip(" =")
    location = _LINE_COLUMN.search(text)
    return printable(f"{reason} (line {location[1]}, column {location[2]})" if location else reason)
