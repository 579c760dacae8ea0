"""Command ``doctor``, which runs checks and prints their findings, also redacted for public reports.

A check that raises an error is a finding, too. `machine` and `peers` have the checks.
"""

from __future__ import annotations

import os
import re
import socket
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rosidl_py_gen.command_support import CommandNode

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


_STYLES = {OK: "", NOTE: "", WARNING: "yellow", BROKEN: "bold red"}


@click.command("doctor")
@click.option(
    "--report", is_flag=True, help="Print a text for an issue, without names of hosts, nodes and home folders."
)
@options.paths
@options.as_json
@options.node_options
@verb
async def doctor(network: options.NetworkOptions, report: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Check this installation, the settings, the network and its peers.

    Each line begins with ok, warning or error. The exit code is 1 if there is an error; a warning may be a problem.

    \b
    rosidl-py doctor
    rosidl-py doctor --domain 42 --discovery localhost
    rosidl-py doctor --report > report.txt
    """
    sections: dict[str, list[Finding]] = {}

    def add_section(name: str, findings: list[Finding]) -> None:
        sections[name] = [*map(redact_finding, findings)] if report else findings
        if not as_json:
            _print(name, sections[name], as_report=report)

    from rosidl_py_gen.ros_cli.doctor.machine import interfaces, libraries, python, settings

    requested = network.get("domain_id"), network.get("discovery")
    add_section(
        "installation",
        [
            *run_check("Python", python),
            *run_check("installed packages", libraries),
            *run_check("interface packages", lambda: interfaces(paths)),
        ],
    )
    add_section("settings", run_check("the environment", lambda: settings(os.environ, *requested)))
    add_section("network", _network(network))
    add_section("peers", await _peers(network))
    is_broken = any(one.level == BROKEN for findings in sections.values() for one in findings)
    if as_json:
        rows = {name: list(map(_row, findings)) for name, findings in sections.items()}
        terminal_output.document({"broken": is_broken, **rows})
    return int(is_broken)


def _network(network: options.NetworkOptions) -> list[Finding]:
    from rosidl_py_gen.ros_cli.doctor.machine import (
        check_interfaces,
        network_interfaces,
        other_domains,
        socket_buffers,
        uses_zenoh,
    )
    from rosidl_py_gen.runtime import read_environment

    if uses_zenoh(os.environ):
        return []
    try:
        settings = read_environment(os.environ, domain_id=network.get("domain_id"), discovery=network.get("discovery"))
    except RosidlError:  # already a finding of the settings
        settings = None
    return [
        *run_check("network interfaces", lambda: check_interfaces(network_interfaces(), settings)),
        *run_check("socket buffers", socket_buffers),
        *run_check("other domains", lambda: other_domains(settings.domain_id if settings else -1)),
    ]


async def _peers(network: options.NetworkOptions) -> list[Finding]:
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.ros_cli.doctor.machine import uses_zenoh

    try:
        command_node = CommandNode(network)
    except Exception as error:  # any reason is a finding
        name = "" if isinstance(error, RosidlError) else f"{type(error).__name__}: "
        reason = str(error).partition(" The configuration was ")[0]
        middleware = "Zenoh" if uses_zenoh(os.environ) else "DDS"
        return [Finding(BROKEN, f"{middleware} does not start: {name}{reason}")]
    async with command_node:
        findings = run_check("services of Fast DDS nodes", lambda: _middleware(command_node))
        if command_node.context.settings.discovery_range.name == "OFF":
            return [*findings, Finding(NOTE, "discovery is off: this process discovers no peers and is not discovered")]
        return [*findings, *await _discovered(command_node)]


def _middleware(command_node: CommandNode) -> Iterator[Finding]:
    reason = command_node.context.services_unavailable_reason
    if command_node.context.middleware != "DDS":
        yield Finding(OK, f"this program and its peers use {command_node.context.middleware}")
        return
    yield Finding(
        OK, f"DDS is {command_node.context.ddsc_library}", data={"library": command_node.context.ddsc_library}
    )
    if reason is None:
        yield Finding(OK, "topics and services work with nodes on Cyclone DDS and Fast DDS")
    else:
        advice = "use another libddsc, from the wheel of cyclonedds or a library that ROSIDL_LIBDDSC names"
        text = f"topics work with all nodes, services only with nodes on Cyclone DDS: {reason}"
        yield Finding(WARNING, text, advice)
    for capability, state in command_node.context.library_capabilities.items():
        if state not in ("yes", reason):
            yield Finding(NOTE, f"{capability}: {state}", data={capability: state})


async def _discovered(command_node: CommandNode) -> list[Finding]:
    from rosidl_py_gen.ros_cli.doctor.peers import SelfTest, check_peers, duplicate_node_names, mismatches

    try:
        test = SelfTest(command_node)
    except OSError as error:
        return [Finding(NOTE, f"the second process of the self-test does not start: {error}")]
    try:
        result = await test.result()
        await command_node.wait_for_node_names()
        return [
            result,
            *run_check("the peers", lambda: check_peers(command_node, test.guid)),
            *run_check("names of nodes", lambda: duplicate_node_names(command_node.node)),
            *run_check("quality of service", lambda: mismatches(command_node.node)),
        ]
    finally:
        test.close()


def _row(finding: Finding) -> dict[str, Any]:
    return {name: value for name in ("level", "text", "advice", "data") if (value := getattr(finding, name))}


def _print(section: str, findings: list[Finding], *, as_report: bool) -> None:
    """Print a line for each finding of a section and one for its advice; both begin with the level of the finding."""
    for finding in findings:
        style = "" if as_report else _STYLES[finding.level]
        for text in (f"{section}: {finding.text}", *([f"-> {finding.advice}"] if finding.advice else [])):
            terminal_output.line(f"{finding.level:<7}  {' '.join(text.split())}", style)
