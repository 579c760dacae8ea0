"""Findings of the checks of ``doctor``, and their redaction for public reports."""

from __future__ import annotations

import os
import re
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

OK, NOTE, WARNING, BROKEN = "ok", "note", "warning", "error"

_IPV4 = re.compile(r"\b(?!127\.|0\.0\.|2[2-5]\d\.)(\d{1,3}\.\d{1,3})\.\d{1,3}\.\d{1,3}\b")
_MIN_NAME = 4
"""Minimum length of texts that are redacted in public reports, such as a host name; shorter texts would match parts of
words."""
REDACTED_VARIABLES = (
    *("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "CYCLONEDDS_URI", "ROS_SECURITY_KEYSTORE"),
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"),
    *("ZENOH_SESSION_CONFIG_URI", "ZENOH_ROUTER_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"),
)
"""Environment variables whose values are removed from public reports."""


@dataclass(frozen=True)
class Finding:
    """Result of a check of ``doctor``.

    Attributes:
        level: OK, NOTE, WARNING or BROKEN.
        advice: way to fix the problem.
        public: text that replaces `text` in public reports, unless empty.
        data: additional values for JSON.
    """

    level: str
    text: str
    advice: str = ""
    public: str = ""
    data: dict[str, Any] = field(default_factory=dict)


def run_check(what: str, check: Callable[[], Iterable[Finding]]) -> list[Finding]:
    """Run a check and return its findings.

    An exception becomes a finding about `what`, as machines differ in unknown ways.
    """
    try:
        return list(check())
    except Exception as error:
        return [Finding(NOTE, f"{what} could not be checked: {type(error).__name__}: {error}")]


def redact_finding(finding: Finding) -> Finding:
    """Return a finding for public reports, without data and with texts redacted by `redact_text`."""
    text = redact_text(finding.public or finding.text)
    return Finding(finding.level, text, redact_text(finding.advice))


def redact_text(text: str) -> str:
    """Return a text without home folder, host name, ends of IPv4 addresses, and values of `REDACTED_VARIABLES`."""
    for name in REDACTED_VARIABLES:
        value = os.environ.get(name, "")
        if len(value) >= _MIN_NAME:
            text = text.replace(value, f"${name}").replace(repr(value)[1:-1], f"${name}")
    home = os.path.expanduser("~")
    if len(home) >= _MIN_NAME:
        text = text.replace(home, "~")
    host = socket.gethostname()
    if len(host) >= _MIN_NAME and host != "localhost":
        text = text.replace(host, "(host)")
    return _IPV4.sub(r"\1.x.x", text)
