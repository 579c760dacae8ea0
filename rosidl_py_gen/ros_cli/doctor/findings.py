"""What a check finds out, and what of it may be told to strangers."""

from __future__ import annotations

import os
import re
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

OK, NOTE, WARNING, BROKEN = "ok", "note", "warning", "broken"

_IPV4 = re.compile(r"\b(?!127\.|0\.0\.|2[2-5]\d\.)(\d{1,3}\.\d{1,3})\.\d{1,3}\.\d{1,3}\b")
_SHORTEST_NAME = 3
REDACTED_VARIABLES = (
    *("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "CYCLONEDDS_URI", "ROS_SECURITY_KEYSTORE"),
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"),
    *("ZENOH_SESSION_CONFIG_URI", "ZENOH_ROUTER_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"),
)
"""Environment variables whose values stay out of reports."""


@dataclass(frozen=True)
class Finding:
    """One line of the answer.

    Attributes:
        level: OK, NOTE, WARNING or BROKEN.
        advice: what to do about it.
        public: what a report says instead of `text`.
        data: for JSON.
    """

    level: str
    text: str
    advice: str = ""
    public: str = ""
    data: dict[str, Any] = field(default_factory=dict)


def run_check(what: str, check: Callable[[], Iterable[Finding]]) -> list[Finding]:
    """The findings of a check; one that fails is a finding, too: nobody knows all machines."""
    try:
        return list(check())
    except Exception as error:
        return [Finding(NOTE, f"{what} could not be looked at: {type(error).__name__}: {error}")]


def redact_finding(finding: Finding) -> Finding:
    """Without what says whose machine this is: home folder, host name, the last parts of addresses."""
    text = redact_text(finding.public or finding.text)
    return Finding(finding.level, text, redact_text(finding.advice))


def redact_text(text: str) -> str:
    """See `redact_finding`."""
    for name in REDACTED_VARIABLES:
        value = os.environ.get(name, "")
        if len(value) > _SHORTEST_NAME:
            text = text.replace(value, f"${name}").replace(repr(value)[1:-1], f"${name}")
    home = os.path.expanduser("~")
    if len(home) > _SHORTEST_NAME:
        text = text.replace(home, "~")
    host = socket.gethostname()
    if len(host) > _SHORTEST_NAME and host != "localhost":
        text = text.replace(host, "(host)")
    return _IPV4.sub(r"\1.x.x", text)
