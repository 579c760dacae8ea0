"""What Zenoh sessions and routers are opened with: the defaults of rmw_zenoh_cpp, and its environment variables.

Decides every value that differs from Zenoh's own defaults. The two that matter most: sessions listen on this machine
only and find each other through a router, never by multicast. It reads a mapping, never `os.environ`.

Source: docs/internals/zenoh.md 1 (rmw_zenoh_cpp of Jazzy, its two configuration files and zenoh_config.cpp).
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import zenoh

from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.runtime.transport.zenoh.keys import FORMAT_VARIABLE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

ROUTER_PORT = 7447
_MAX_SHOWN = 200
_MAX_DEPTH = 100
"""Levels of brackets that Zenoh's parser gets to see: some thousands end the process."""
_BRACKET = re.compile(r"[\[{}\]]")
_PLACE = re.compile(r" at \S+\.rs:\d+\.?")
_MESSAGE = re.compile(r'(?:msg: |Str\()"((?:[^"\\]|\\.)*)"')
_LOCATION = re.compile(r"line: (\d+), column: (\d+)")

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
    "transport/shared_memory/enabled": False,  # used when somebody turns it on at both ends
    "transport/shared_memory/transport_optimization/pool_size": 48 << 20,
    "transport/shared_memory/transport_optimization/message_size_threshold": 512,
    "adminspace/enabled": True,
}
_MAX_CONGESTION_WAIT_US = 250_000
"""How long a large message waits for a link that is congested before it is dropped, where rmw_zenoh_cpp waits 50 ms: on
a busy machine that lost one image of ten. After the first that waited in vain Zenoh drops without waiting.
"""
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
_ROUTER: dict[str, object] = {
    "mode": "router",
    "listen/endpoints": [f"tcp/[::]:{ROUTER_PORT}"],
}
IPV4_ONLY = f"tcp/0.0.0.0:{ROUTER_PORT}"
"""Where a router listens on machines without IPv6, which refuse the default."""


class ZenohConfigError(RosidlError, ValueError):
    """The configuration for Zenoh cannot be used; names the variable or key, and quotes what it holds."""


def session_config(environ: Mapping[str, str], warn: Callable[[str], None]) -> zenoh.Config:
    """What the session of a context is opened with.

    Args:
        warn: told of pairs in ZENOH_CONFIG_OVERRIDE that had to be left out.

    Raises `ZenohConfigError`, as the other functions here do.
    """
    return _configuration(environ, "ZENOH_SESSION_CONFIG_URI", {**_COMMON, **_SESSION}, warn)


def router_config(
    environ: Mapping[str, str],
    warn: Callable[[str], None],
    *,
    listen: Iterable[str] = (),
    connect: Iterable[str] = (),
) -> zenoh.Config:
    """What a router is opened with; endpoints that are given win over file and variables."""
    config = _configuration(environ, "ZENOH_ROUTER_CONFIG_URI", {**_COMMON, **_ROUTER}, warn)
    for key, endpoints in (("listen/endpoints", list(listen)), ("connect/endpoints", list(connect))):
        if endpoints:
            insert(config, key, json.dumps(endpoints), where="router")
    return config


def router_attempts(environ: Mapping[str, str]) -> float:
    """How often a new session looks for a router, once a second: 0 for never, `math.inf` for until there is one."""
    text = environ.get("ZENOH_ROUTER_CHECK_ATTEMPTS", "")
    try:
        attempts = int(text) if text else 1
    except ValueError:
        raise ZenohConfigError(
            "ZENOH_ROUTER_CHECK_ATTEMPTS must be a whole number (0 waits for ever, a negative one does not look), "
            f"got {_shown(text)}"
        ) from None
    return math.inf if attempts == 0 else max(0, attempts)


def is_humble(environ: Mapping[str, str]) -> bool:
    """Whether keys and tokens shall be as in Humble, and not as in all later distributions."""
    text = environ.get(FORMAT_VARIABLE, "")
    if text not in ("", "humble"):
        raise ZenohConfigError(f"{FORMAT_VARIABLE} must be 'humble', or nothing for later ROS, got {_shown(text)}")
    return text == "humble"


def insert(config: zenoh.Config, key: str, value: str, *, where: str) -> None:
    """Set `key` to a JSON5 text; `where` is what the user wrote it in."""
    _require_shallow(value, f"{where}: {key}")
    try:
        config.insert_json5(key, value)
    except zenoh.ZError as error:
        raise ZenohConfigError(f"{where}: {key}={_shown(value)}: {error_text(error)}") from None


def endpoints_of(config: zenoh.Config, what: str) -> list[str]:
    """Endpoints to "listen" on or to "connect" with, those of the mode that the configuration has."""
    found = json.loads(config.get_json(f"{what}/endpoints"))
    if isinstance(found, dict):  # one list for each mode
        found = found.get(json.loads(config.get_json("mode")) or "peer") or []
    return [str(endpoint) for endpoint in found]


def _configuration(
    environ: Mapping[str, str], variable: str, defaults: Mapping[str, object], warn: Callable[[str], None]
) -> zenoh.Config:
    path = environ.get(variable, "")
    if path:
        try:
            _require_shallow(Path(path).read_text("utf-8", "replace"), f"{variable}={_shown(path)}")
            config: zenoh.Config = zenoh.Config.from_file(path)
        except (zenoh.ZError, OSError) as error:
            raise ZenohConfigError(f"{variable}={_shown(path)}: {error_text(error)}") from None
    else:
        config = zenoh.Config()
        for key, value in defaults.items():
            insert(config, key, json.dumps(value), where="defaults of rmw_zenoh")
    for pair in filter(None, environ.get("ZENOH_CONFIG_OVERRIDE", "").split(";")):
        key, equals, value = pair.partition("=")
        try:
            if not equals or not value:
                raise ZenohConfigError(f"ZENOH_CONFIG_OVERRIDE: expected key=value, found {_shown(pair)}")
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
            raise ZenohConfigError(f"{where}: expected at most {_MAX_DEPTH} brackets within each other, found more")


def _shown(text: str) -> str:
    return printable(repr(text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "..."))


def error_text(error: Exception) -> str:
    """What Zenoh says, without places in its sources and names of its types."""
    text = _PLACE.sub("", str(error))
    message = _MESSAGE.search(text)
    if message is None:
        return printable(text.strip())
    said = message[1].replace('\\"', '"').split("\\n")[-1].strip(" =")
    where = _LOCATION.search(text)
    return printable(f"{said} (line {where[1]}, column {where[2]})" if where else said)
