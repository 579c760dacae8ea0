"""``doctor``: what is installed, how the network is, what is set, and who answers.

Decides the order of the checks, how their findings are printed, and that a check that fails ends nothing.
"""

from __future__ import annotations

import os
import shutil
import sys
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import options, terminal_output, verb
from rosidl_py_gen.ros_cli.doctor.findings import BROKEN, NOTE, OK, WARNING, Finding, redact_finding, run_check

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
    from rosidl_py_gen.runtime import DomainSettings


_STYLES = {OK: "", NOTE: "cyan", WARNING: "yellow", BROKEN: "bold red"}
_INDENT = 11
Sections = dict[str, list[Finding]]


@click.command("doctor")
@click.option("--report", is_flag=True, help="Print a text for an issue: no names of hosts, nodes and home folders.")
@options.paths
@options.as_json
@options.node_options
@verb
async def doctor(network: NetworkOptions, report: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Check this installation, the network and the settings, and tell who answers.

    Ends with 1 when something is broken; what deserves a look is a warning.

    \b
    rosidl-py doctor
    rosidl-py doctor --domain 42 --discovery localhost
    rosidl-py doctor --report > report.txt
    """
    sections: Sections = {}

    def done(name: str, findings: list[Finding]) -> None:
        sections[name] = [redact_finding(one) for one in findings] if report else findings
        if not as_json:
            _print(name, sections[name], as_report=report)

    done("installation", _installation(paths))
    done("settings", _settings(network))
    done("network", _network(_domain_settings(network)))
    done("peers", await _answers(network))
    broken = any(one.level == BROKEN for findings in sections.values() for one in findings)
    if as_json:
        terminal_output.document(
            {"broken": broken, **{name: list(map(_row, found)) for name, found in sections.items()}}
        )
    return int(broken)


def _installation(paths: tuple[str, ...]) -> list[Finding]:
    from rosidl_py_gen.ros_cli.doctor import machine as doctor_machine

    return [
        *run_check("Python", doctor_machine.python),
        *run_check("what is installed", doctor_machine.libraries),
        *run_check("interface packages", lambda: doctor_machine.interfaces(paths)),
    ]


def _settings(network: NetworkOptions) -> list[Finding]:
    from rosidl_py_gen.ros_cli.doctor import machine as doctor_machine

    wanted = (network.get("domain_id"), network.get("discovery"))
    return run_check("the environment", lambda: doctor_machine.settings(os.environ, *wanted))


def _network(settings: DomainSettings | None) -> list[Finding]:
    from rosidl_py_gen.ros_cli.doctor import machine as doctor_machine
    from rosidl_py_gen.ros_cli.doctor import network as doctor_network

    if doctor_machine.on_zenoh(os.environ):
        return run_check("network interfaces", lambda: doctor_network.list_interfaces(doctor_network.interfaces()))
    return [
        *run_check(
            "network interfaces", lambda: doctor_network.check_interfaces(doctor_network.interfaces(), settings)
        ),
        *run_check("socket buffers", doctor_machine.socket_buffers),
        *run_check("other domains", lambda: doctor_network.other_domains(settings.domain_id if settings else -1)),
    ]


def _domain_settings(network: NetworkOptions) -> DomainSettings | None:
    """None when they are wrong, which is a finding already."""
    from rosidl_py_gen.runtime import read_environment

    try:
        return read_environment(os.environ, domain_id=network.get("domain_id"), discovery=network.get("discovery"))
    except RosidlError:
        return None


async def _answers(network: NetworkOptions) -> list[Finding]:
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.doctor import machine as doctor_machine

    try:
        session = CommandNode(network)
    except Exception as error:  # whatever keeps it from starting is what the doctor is here for
        name = "" if isinstance(error, RosidlError) else f"{type(error).__name__}: "
        reason = str(error).partition(" The configuration was ")[0]
        middleware = "Zenoh" if doctor_machine.on_zenoh(os.environ) else "DDS"
        return [Finding(BROKEN, f"{middleware} does not start: {name}{reason}")]
    async with session:
        fast_dds = run_check("services of Fast DDS nodes", lambda: _fast_dds(session))
        if session.context.settings.discovery_range.name == "OFF":
            return [*fast_dds, Finding(NOTE, "discovery is off: nobody is looked for, and nobody finds this process")]
        return [*fast_dds, *await _found(session)]


def _fast_dds(session: CommandNode) -> Iterator[Finding]:

    refusal = session.context.services_unavailable_reason
    if session.context.middleware != "DDS":
        yield Finding(OK, f"this program and all it sees are on {session.context.middleware}")
        return
    yield Finding(OK, f"DDS is {session.context.ddsc_library}", data={"library": session.context.ddsc_library})
    if refusal is None:
        yield Finding(OK, "topics and services work with nodes on Cyclone DDS and Fast DDS")
    else:
        advice = "another libddsc may do: that of the wheel of cyclonedds, or one that ROSIDL_LIBDDSC names"
        yield Finding(
            WARNING, f"topics work with all nodes, services with those on Cyclone DDS only: {refusal}", advice
        )
    for what, answer in session.context.library_capabilities.items():
        if answer not in ("yes", refusal):
            yield Finding(NOTE, f"{what}: {answer}", data={what: answer})


async def _found(session: CommandNode) -> list[Finding]:
    from rosidl_py_gen.ros_cli.doctor import peers as doctor_peers

    test = None
    try:
        test = doctor_peers.SelfTest(session)
        results = [await test.result()]
        await session.wait_for_node_names()
        node, other = session.node, test.guid
        results += run_check("the peers", lambda: doctor_peers.peers(session, other))
        results += run_check("names of nodes", lambda: doctor_peers.duplicate_node_names(node))
        results += run_check("quality of service", lambda: doctor_peers.mismatches(node))
        return results
    except OSError as error:
        return [Finding(NOTE, f"the second process of the self-test does not start: {error}")]
    finally:
        if test is not None:
            test.close()


def _row(finding: Finding) -> dict[str, Any]:
    row: dict[str, Any] = {"level": finding.level, "text": finding.text}
    if finding.advice:
        row["advice"] = finding.advice
    return {**row, **({"data": finding.data} if finding.data else {})}


def _print(name: str, findings: list[Finding], *, as_report: bool) -> None:
    terminal_output.line(name.capitalize(), "" if as_report else "bold")
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else 100 if as_report else 10_000
    for finding in findings:
        terminal_output.block(_wrapped(f"  {finding.level:<8} ", finding.text, width), _STYLES[finding.level])
        if finding.advice:
            terminal_output.block(_wrapped(" " * _INDENT + "-> ", finding.advice, width))


def _wrapped(head: str, text: str, width: int) -> str:
    import textwrap

    flat = " ".join(text.split())
    return textwrap.fill(
        flat, max(width, 30), initial_indent=head, subsequent_indent=" " * len(head), break_on_hyphens=False
    )
