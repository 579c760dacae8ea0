"""Checks of what answers: a second process of our own, the members of the domain, and whether they fit together.

Decides what is said about the make of others. A GUID begins with the number of the vendor; ROS participants say that
they are; type hashes came with Iron. Nothing else is known of a peer, so nothing else is said.
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

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.ros_cli.doctor.echo import topics
from rosidl_py_gen.ros_cli.doctor.findings import BROKEN, NOTE, OK, WARNING, Finding
from rosidl_py_gen.runtime import WaitTimeoutError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.ros_cli.command_node import CommandNode
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
"""Numbers of the OMG (dds-foundation.org, "DDS-RTPS vendor and product ids"); the first byte is 1."""
_ROS = {True: "ROS Iron or later", False: "ROS Humble or earlier (no type hashes)", None: "ROS"}
_ON_ZENOH = "does `rosidl-py zenoh-router` run on each machine, and do the routers connect with each other?"
_START_S, _FOUND_S, _ANSWER_S, _END_S = 20.0, 10.0, 10.0, 2.0
_MAX_NAMES, _MAX_MISMATCHES = 20, 20


# ----------------------------------------------------------------------------------------------------------- self-test


class SelfTest:
    """A second process that joins the same domain in the same way, and sends a message back."""

    def __init__(self, session: CommandNode) -> None:
        self._session = session
        self._mark = f"p{os.getpid()}"
        settings = session.context.settings
        arguments = (str(settings.domain_id), settings.discovery_range.value, self._mark)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rosidl_py_gen.ros_cli.doctor.echo", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self.guid = b""
        """Of its participant, once it was found."""

    async def result(self) -> Finding:
        """Wait for it."""
        there, back = topics(self._mark)
        node = self._session.node
        out, answers = node.create_publisher(Time, there), node.create_subscription(Time, back)
        if not await self._has_started():
            return Finding(NOTE, f"the second process of the self-test did not start within {_START_S:.0f} s")
        began = monotonic()
        try:
            await out.wait_for_subscribers(_FOUND_S)
            await answers.wait_for_publishers(_FOUND_S)
        except WaitTimeoutError:
            return self._failed(f"two processes of this machine did not find each other within {_FOUND_S:.0f} s")
        found_s = monotonic() - began
        self.guid = node.get_publishers_info_by_topic(back)[0].participant_guid
        try:
            for number in range(2):  # the first may wait until the other side has found us, too
                began = monotonic()
                out.publish(Time(sec=number))
                await answers.receive(_ANSWER_S)
        except RosidlError:
            return self._failed("two processes of this machine found each other, but a message did not get through")
        trip_ms = (monotonic() - began) * 1e3
        text = f"two processes of this machine found each other ({found_s:.1f} s), a message went there and back"
        return Finding(OK, f"{text} ({trip_ms:.1f} ms)", data={"found_s": found_s, "round_trip_ms": trip_ms})

    async def _has_started(self) -> bool:
        """Whether it has its node, or has ended; on a busy machine that takes longer than to be found."""
        assert self._process.stdout is not None
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(asyncio.to_thread(self._process.stdout.readline), _START_S)
            return True
        return False

    def _failed(self, text: str) -> Finding:
        if self._process.poll() not in (None, 0):
            return Finding(NOTE, f"the second process of the self-test ended with {self._process.returncode}")
        advice = (
            "a firewall on this machine? UDP has to pass on all its interfaces, multicast included; "
            "try `rosidl-py doctor --discovery localhost`, and unset CYCLONEDDS_URI"
        )
        return Finding(BROKEN, text, advice if _is_dds(self._session) else _ON_ZENOH)

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


# --------------------------------------------------------------------------------------------------------------- peers


def peers(session: CommandNode, without: bytes) -> Iterator[Finding]:
    """Who is in the domain, by make; `without` is the participant of the self-test."""
    found = [one for one in session.context.participants() if not one.is_own and one.guid != without]
    if not found:
        yield _nobody(session)
        return
    groups: defaultdict[str, list[ParticipantInfo]] = defaultdict(list)
    for one in found:
        groups[middleware_text(one, session.context.middleware)].append(one)
    for name, members in sorted(groups.items()):
        yield _group(name, members)


def middleware_text(one: ParticipantInfo, middleware: str = "DDS") -> str:
    """The middleware, and what is known of the distribution."""
    vendor = _VENDORS.get(one.guid[1]) if one.guid[0] == 1 else None
    name = middleware if middleware != "DDS" else vendor or f"DDS of vendor {one.guid[:2].hex('.')}"
    if not one.is_ros:
        return f"{name}, no ROS"
    return f"{name}, {_ROS[one.announces_type_hashes]}"


def _group(name: str, members: list[ParticipantInfo]) -> Finding:
    nodes = sorted(node.fully_qualified_name for one in members for node in one.nodes)
    shown = ", ".join(nodes[:_MAX_NAMES]) + (", ..." if len(nodes) > _MAX_NAMES else "")
    public = f"{name}: {_counted(len(members), 'participant')}, {_counted(len(nodes), 'node')}"
    most = max(len(one.nodes) for one in members)
    if most > 1:
        public += f", up to {most} in one participant"
    data = {"make": name, "participants": len(members), "nodes": nodes}
    return Finding(OK, f"{public}{f': {shown}' if nodes else ''}", public=public, data=data)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _is_dds(session: CommandNode) -> bool:
    return session.context.middleware == "DDS"


def _nobody(session: CommandNode) -> Finding:
    settings = session.context.settings
    first = 7400 + 250 * settings.domain_id
    advice = (
        f"do the others have ROS_DOMAIN_ID={settings.domain_id}, and a ROS_AUTOMATIC_DISCOVERY_RANGE that fits "
        f"{settings.discovery_range.name}?"
    )
    if settings.discovery_range.name != "LOCALHOST":
        advice += (
            f" Between machines UDP ports {first} to {first + 249} and multicast to 239.255.0.1 have to pass "
            "firewalls; else name the machines in ROS_STATIC_PEERS"
        )
    if not _is_dds(session):
        advice = f"do the others have ROS_DOMAIN_ID={settings.domain_id}? If so, {_ON_ZENOH}"
    return Finding(NOTE, f"nobody else answers in domain {settings.domain_id}", advice)


# ------------------------------------------------------------------------------------------------------- fit together


def duplicate_node_names(node: Node) -> Iterator[Finding]:
    """Nodes of one name, whose services and parameters get mixed up."""
    for name, count in Counter(node.get_node_names()).items():
        if count > 1:
            public = f"{count} nodes have the same name"
            advice = "give one another name: --ros-args -r __node:=name"
            yield Finding(WARNING, f"{public}: {name}", advice, public=public)


def mismatches(node: Node) -> Iterator[Finding]:
    """Publishers and subscriptions, clients and servers that do not connect, at most 20."""
    found = (
        finding
        for topic, _ in node.get_topic_names_and_types()
        for one in node.incompatible_endpoints_of_topic(topic)
        for finding in _mismatch(node, topic, one)
    )
    yield from islice(chain(found, _service_mismatches(node)), _MAX_MISMATCHES)


def _service_mismatches(node: Node) -> Iterator[Finding]:
    for service, _ in node.get_service_names_and_types():
        for found in node.incompatible_endpoints_of_service(service):
            said = f"no calls of {service} from {found.writer.node_text} to {found.reader.node_text}: {found.reason}"
            advice = "give both one type by one definition" if found.kind != "qos" else ""
            yield Finding(WARNING, said, advice, public="a client and a server of one name do not connect")


def _mismatch(node: Node, topic: str, one: Mismatch) -> Iterator[Finding]:
    said = f"no messages on {topic} from {one.writer.node_text} to {one.reader.node_text}: {one.reason}"
    if one.kind == "type":
        yield Finding(WARNING, said, public="types differ on a topic")
    elif one.kind == "qos":
        advice, public = "", "two ends of a topic do not connect"
        if node.context.middleware != "Zenoh":  # there the reason may name a type
            advice = "give both the same reliability and durability, or the publisher the stronger ones"
            public += f": {one.reason}"
        yield Finding(WARNING, said, advice, public=public)
    else:
        advice = "bring both to one definition; until then our nodes do not use what arrives, and others may misread it"
        yield Finding(WARNING, said, advice, public="definitions differ on a topic")
