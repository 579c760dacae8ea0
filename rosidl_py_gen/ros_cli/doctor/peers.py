"""Checks of peers: a self-test with a second process, the participants of the domain, and incompatible endpoints.

The middleware of a peer is derived from three facts: its GUID begins with a vendor id, ROS participants announce that
they belong to ROS, and type hashes exist since ROS Iron.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections import Counter, defaultdict
from contextlib import suppress
from itertools import chain, islice
from time import monotonic
from typing import TYPE_CHECKING

from rosidl_py_gen.command_support import CommandNode
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.ros_cli.doctor import BROKEN, NOTE, OK, WARNING, Finding
from rosidl_py_gen.ros_cli.doctor.machine import FIRST_PORT, PORTS_PER_DOMAIN
from rosidl_py_gen.runtime import SecurityError, WaitTimeoutError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.runtime import Mismatch, Node, ParticipantInfo

_VENDORS = {
    1: "RTI Connext",
    2: "OpenSplice",
    3: "OpenDDS",
    5: "InterCOM DDS",
    6: "CoreDX",
    10: "RTI Connext Micro",
    15: "Fast DDS",
    16: "Cyclone DDS",
    17: "GurumDDS",
    18: "RustDDS",
}
"""DDS implementations by second byte of the vendor id (dds-foundation.org, "DDS-RTPS vendor and product ids")."""
_ROS = {True: "ROS Iron or later", False: "ROS Humble or earlier (no type hashes)", None: "ROS"}
_ZENOH_ADVICE = "check that `rosidl-py zenoh-router` runs on each machine, and that the routers are connected"
START_TIMEOUT_S = 20.0
_DISCOVERY_TIMEOUT_S = 10.0
_REPLY_TIMEOUT_S = 10.0
_END_TIMEOUT_S = 2.0
_MAX_NAMES = 20
_MAX_MISMATCHES = 20
_SECOND_PROCESS = "from rosidl_py_gen.command_support import run_self_test_peer; run_self_test_peer(*sys.argv[1:])"


# ----------------------------------------------------------------------------------------------------------- self-test


def _python_command(statements: str, *arguments: str) -> list[str]:
    """Return the command line of a Python process that runs the given statements with the import path of this process.

    The arguments are in ``sys.argv[1:]``. A process started with ``-m``, or with ``-c`` alone, would import modules of
    the current folder first, which are not trusted.
    """
    return [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {statements}", *arguments]


class SelfTest:
    """Self-test with a second process that joins the same domain with the same settings and sends messages back."""

    def __init__(self, command_node: CommandNode) -> None:
        self._command_node = command_node
        hidden = f"/_rosidl_py_doctor/p{os.getpid()}"
        self._topics = f"{hidden}/there", f"{hidden}/back"
        settings = command_node.context.settings
        self._process = subprocess.Popen(
            _python_command(_SECOND_PROCESS, str(settings.domain_id), settings.discovery_range.value, *self._topics),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self.guid = b""
        """GUID of the participant of the second process; empty until the participant is discovered."""

    async def result(self) -> Finding:
        """Run the self-test and return its finding: the second process was found and sent a message back, or not."""
        there, back = self._topics
        node = self._command_node.node
        try:
            out, replies = node.create_publisher(Time, there), node.create_subscription(Time, back)
        except SecurityError as error:
            return Finding(NOTE, f"no self-test: {error}")
        if not await self._has_started():
            return Finding(NOTE, f"the second process of the self-test did not start within {START_TIMEOUT_S:.0f} s")
        start_s = monotonic()
        try:
            await out.wait_for_subscribers(_DISCOVERY_TIMEOUT_S)
            await replies.wait_for_publishers(_DISCOVERY_TIMEOUT_S)
        except WaitTimeoutError:
            return self._failed(
                f"two processes of this machine did not find each other within {_DISCOVERY_TIMEOUT_S:.0f} s"
            )
        found_s = monotonic() - start_s
        self.guid = node.get_publishers_info_by_topic(back)[0].participant_guid
        try:
            for number in range(2):  # the first one may wait until the process has discovered this node
                start_s = monotonic()
                out.publish(Time(sec=number))
                await replies.receive(_REPLY_TIMEOUT_S)
        except RosidlError:
            return self._failed("two processes of this machine found each other, but a message did not get through")
        trip_ms = (monotonic() - start_s) * 1e3
        text = f"two processes of this machine found each other ({found_s:.1f} s), a message went there and back"
        return Finding(OK, f"{text} ({trip_ms:.1f} ms)", data={"found_s": found_s, "round_trip_ms": trip_ms})

    async def _has_started(self) -> bool:
        """Wait until the second process has its node or has ended; return False if it takes longer than 20 s."""
        assert self._process.stdout is not None
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(asyncio.to_thread(self._process.stdout.readline), START_TIMEOUT_S)
            return True
        return False

    def _failed(self, text: str) -> Finding:
        if self._process.poll() not in (None, 0):
            return Finding(NOTE, f"the second process of the self-test ended with {self._process.returncode}")
        advice = (
            "check the firewall: it must pass UDP on all interfaces of this machine, multicast included; "
            "try `rosidl-py doctor --discovery localhost`, and unset CYCLONEDDS_URI"
        )
        return Finding(BROKEN, text, advice if _is_dds(self._command_node) else _ZENOH_ADVICE)

    def close(self) -> None:
        """End the second process of the self-test."""
        self._process.terminate()
        try:
            self._process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


# --------------------------------------------------------------------------------------------------------------- peers


def check_peers(command_node: CommandNode, without: bytes) -> Iterator[Finding]:
    """Report the participants of other processes by middleware, without the participant whose GUID is `without` (the
    self-test).
    """
    participants = [one for one in command_node.context.participants() if not one.is_own and one.guid != without]
    if not participants:
        yield _no_peers(command_node)
        return
    groups: defaultdict[str, list[ParticipantInfo]] = defaultdict(list)
    for one in participants:
        groups[middleware_text(one, command_node.context.middleware)].append(one)
    for name, members in sorted(groups.items()):
        yield _group(name, members)


def middleware_text(one: ParticipantInfo, middleware: str = "DDS") -> str:
    """Return a text with the middleware and the range of ROS distributions of a participant."""
    vendor = _VENDORS.get(one.vendor[1]) if one.vendor[:1] == b"\1" else None
    if one.vendor != one.guid[:2]:
        vendor = f"secured {vendor or 'DDS, probably Cyclone DDS'}"
    name = middleware if middleware != "DDS" else vendor or f"DDS of vendor {one.guid[:2].hex('.')}"
    if not one.is_ros:
        return f"{name}, not ROS"
    return f"{name}, {_ROS[one.announces_type_hashes]}"


def _group(name: str, members: list[ParticipantInfo]) -> Finding:
    nodes = sorted(node.fully_qualified_name for one in members for node in one.nodes)
    names = ", ".join(nodes[:_MAX_NAMES]) + (", ..." if len(nodes) > _MAX_NAMES else "")
    public = f"{name}: {_counted(len(members), 'participant')}, {_counted(len(nodes), 'node')}"
    max_nodes = max(len(one.nodes) for one in members)
    if max_nodes > 1:
        public += f", up to {max_nodes} in one participant"
    data = {"make": name, "participants": len(members), "nodes": nodes}
    return Finding(OK, f"{public}{f': {names}' if nodes else ''}", public=public, data=data)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _is_dds(command_node: CommandNode) -> bool:
    return command_node.context.middleware == "DDS"


def _no_peers(command_node: CommandNode) -> Finding:
    settings = command_node.context.settings
    first = FIRST_PORT + PORTS_PER_DOMAIN * settings.domain_id
    last = first + PORTS_PER_DOMAIN - 1
    advice = (
        f"check that the other nodes use ROS_DOMAIN_ID={settings.domain_id}, and a ROS_AUTOMATIC_DISCOVERY_RANGE that "
        f"fits {settings.discovery_range.name}."
    )
    if settings.discovery_range.name != "LOCALHOST":
        advice += (
            f" Firewalls between machines must pass UDP ports {first} to {last} and multicast to 239.255.0.1; "
            "otherwise set ROS_STATIC_PEERS to the machines"
        )
    if not _is_dds(command_node):
        advice = f"check that the other nodes use ROS_DOMAIN_ID={settings.domain_id}; {_ZENOH_ADVICE}"
    return Finding(NOTE, f"no other participant was found in domain {settings.domain_id}", advice)


# ------------------------------------------------------------------------------------------------------- fit together


def duplicate_node_names(node: Node) -> Iterator[Finding]:
    """Report nodes with the same name, whose services and parameters are mixed up."""
    for name, count in Counter(node.get_node_names()).items():
        if count > 1:
            public = f"{count} nodes have the same name"
            advice = "rename one of them: --ros-args -r __node:=name"
            yield Finding(WARNING, f"{public}: {name}", advice, public=public)


def mismatches(node: Node) -> Iterator[Finding]:
    """Report at most 20 incompatible pairs of publishers and subscriptions, or clients and servers."""
    topic_findings = (
        finding
        for topic, _ in node.get_topic_names_and_types()
        for one in node.incompatible_endpoints_of_topic(topic)
        for finding in _mismatch(node, topic, one)
    )
    yield from islice(chain(topic_findings, _service_mismatches(node)), _MAX_MISMATCHES)


def _service_mismatches(node: Node) -> Iterator[Finding]:
    for service, _ in node.get_service_names_and_types():
        for one in node.incompatible_endpoints_of_service(service):
            text = f"no calls of {service} from {one.writer.node_text} to {one.reader.node_text}: {one.reason}"
            advice = f"use the same type and {_definition_text(node)} for both" if one.kind != "qos" else ""
            yield Finding(WARNING, text, advice, public="a client and a server of a service are incompatible")


def _mismatch(node: Node, topic: str, one: Mismatch) -> Iterator[Finding]:
    text = f"no messages on {topic} from {one.writer.node_text} to {one.reader.node_text}: {one.reason}"
    if one.kind == "type":
        yield Finding(WARNING, text, public="types differ on a topic")
    elif one.kind == "qos":
        advice = "use the same reliability and durability for both, or the stronger ones for the publisher"
        public = f"a publisher and a subscription of a topic are incompatible: {one.reason}"
        yield Finding(WARNING, text, advice, public=public)
    else:
        advice = f"use the same {_definition_text(node)} for both"
        if node.context.middleware != "Zenoh":  # Zenoh does not connect them
            advice += "; nodes of this package drop such messages, others may misread them"
        yield Finding(WARNING, text, advice, public="definitions differ on a topic")


def _definition_text(node: Node) -> str:
    return "definition and format of Zenoh keys" if node.context.middleware == "Zenoh" else "definition"
