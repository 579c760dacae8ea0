"""Incompatibility of a writer and a reader of one topic: its kind, which the transport decides, and the texts."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.qos_matching import check_compatible, describe_policies

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.qos import QoSPolicyKind

_MAX_TEXT_CHARS = 600
"""Maximum length of a type or hash in the text about both endpoints."""
_MAX_PEER_TYPE_CHARS = 300
"""Maximum length of a type in the text about a peer."""
_MAX_PEER_HASH_CHARS = 200
"""Maximum length of a hash in the text about a peer."""


class IncompatibilityKind(Enum):
    """Property in which two endpoints differ."""

    TYPE = auto()
    DEFINITION = auto()
    """The definitions of the type differ."""
    QOS = auto()
    HASH_FORMAT = auto()
    """Only one of them announces a type hash, which is part of the key that Zenoh matches."""


@dataclass(frozen=True, slots=True)
class Incompatibility:
    """A writer and a reader that do not exchange messages, or misread them."""

    kind: IncompatibilityKind
    writer: DiscoveredEndpoint
    reader: DiscoveredEndpoint

    @property
    def mismatch_kind(self) -> Literal["type", "definition", "qos"]:
        """Kind in the terms of `Mismatch` and of event callbacks."""
        if self.kind is IncompatibilityKind.TYPE:
            return "type"
        return "definition" if self.kind is IncompatibilityKind.DEFINITION else "qos"

    @property
    def policies(self) -> tuple[QoSPolicyKind, ...]:
        """Incompatible QoS policies; empty for other kinds."""
        if self.kind is not IncompatibilityKind.QOS:
            return ()
        return check_compatible(self.writer.qos, self.reader.qos).policies

    @property
    def reason(self) -> str:
        """Text about both endpoints."""
        if self.kind is IncompatibilityKind.TYPE:
            return f"types differ, {_type_text(self.writer)} and {_type_text(self.reader)}"
        if self.kind is IncompatibilityKind.DEFINITION:
            writer_hash, reader_hash = (printable(text, _MAX_TEXT_CHARS) for text in _hashes(self.writer, self.reader))
            return f"their definitions of {_type_text(self.writer)} differ: {writer_hash} and {reader_hash}"
        if self.kind is IncompatibilityKind.HASH_FORMAT:
            from rosidl_py_gen.runtime.transport.zenoh.keys import FORMAT_VARIABLE

            return (
                "only one of them has a type hash, and Humble has none: all nodes of a domain have to use the format "
                f"of Humble ({FORMAT_VARIABLE}=humble), or none"
            )
        return f"their quality of service is incompatible. {check_compatible(self.writer.qos, self.reader.qos).reason}"

    def reason_of(self, peer: DiscoveredEndpoint, name: str) -> str:
        """Return the text about `peer`, one of the two endpoints, which belongs to the node `name`."""
        own = self.reader if peer.is_writer else self.writer
        if self.kind is IncompatibilityKind.TYPE:
            return f"{name} has another type, {_type_text(peer, _MAX_PEER_TYPE_CHARS)}"
        if self.kind is IncompatibilityKind.DEFINITION:
            theirs, ours = (printable(text, _MAX_PEER_HASH_CHARS) for text in _hashes(peer, own))
            of = "its type" if own.topic_key.kind != "topic" else printable(own.type, _MAX_PEER_TYPE_CHARS)
            return f"{name} has another definition of {of}, {theirs}; here it is {ours}"
        policies = (policy.name.lower() for policy in self.policies)
        if differ := describe_policies(theirs=peer.qos, ours=own.qos, policies=policies):
            return f"{name} {'offers' if peer.is_writer else 'requests'} incompatible QoS: {differ}"
        return f"{name} does not match: {self.reason}"


def _type_text(endpoint: DiscoveredEndpoint, max_chars: int = _MAX_TEXT_CHARS) -> str:
    return printable(endpoint.service_type or endpoint.type, max_chars)


def _hashes(one: DiscoveredEndpoint, other: DiscoveredEndpoint) -> tuple[str, str]:
    """Return the hashes that both announce: of the message, or else of the service."""
    if one.type_hash and other.type_hash:
        return one.type_hash, other.type_hash
    return one.service_hash or one.type_hash, other.service_hash or other.type_hash
