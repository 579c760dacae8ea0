"""States why a writer and a reader of one topic do not exchange messages: a kind, and the texts for people.

The transport decides the kind; all texts are made here.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.qos_matching import check_compatible, describe_policies

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.qos import QoSPolicyKind

_MAX_TEXT = 600
"""Number of characters of a peer's type or hash in the text about both endpoints."""
_MAX_PEER_TYPE, _MAX_PEER_HASH = 300, 200
"""The same in the text about the peer."""


class IncompatibilityKind(Enum):
    """Property in which two endpoints differ."""

    TYPE = auto()
    DEFINITION = auto()
    """They have one type by different definitions."""
    QOS = auto()
    HASH_FORMAT = auto()
    """Only one of them announces a type hash, which Zenoh has in the names that it matches."""


@dataclass(frozen=True, slots=True)
class Incompatibility:
    """A writer and a reader that do not exchange messages, or misread them."""

    kind: IncompatibilityKind
    writer: DiscoveredEndpoint
    reader: DiscoveredEndpoint

    @property
    def mismatch_kind(self) -> Literal["type", "definition", "qos"]:
        """The kind as `Mismatch` and the callbacks for events have it, which know of no format of hashes."""
        if self.kind is IncompatibilityKind.TYPE:
            return "type"
        return "definition" if self.kind is IncompatibilityKind.DEFINITION else "qos"

    @property
    def policies(self) -> tuple[QoSPolicyKind, ...]:
        """The QoS policies that are incompatible; empty for other kinds."""
        if self.kind is not IncompatibilityKind.QOS:
            return ()
        return check_compatible(self.writer.qos, self.reader.qos).policies

    @property
    def reason(self) -> str:
        """The text about both endpoints."""
        if self.kind is IncompatibilityKind.TYPE:
            return f"types differ, {_type_text(self.writer)} and {_type_text(self.reader)}"
        if self.kind is IncompatibilityKind.DEFINITION:
            one, two = (printable(text, _MAX_TEXT) for text in _hashes(self.writer, self.reader))
            return f"they have {_type_text(self.writer)} by different definitions, {one} and {two}"
        if self.kind is IncompatibilityKind.HASH_FORMAT:
            from rosidl_py_gen.runtime.transport.zenoh.keys import FORMAT_VARIABLE

            return (
                "only one of them has a type hash, and Humble has none: all nodes of a domain have to use the format "
                f"of Humble ({FORMAT_VARIABLE}=humble), or none"
            )
        return f"their quality of service is incompatible. {check_compatible(self.writer.qos, self.reader.qos).reason}"

    def reason_of(self, peer: DiscoveredEndpoint, name: str) -> str:
        """Return the text about `peer`, one of the two, by the name of its node."""
        own = self.reader if peer.is_writer else self.writer
        if self.kind is IncompatibilityKind.TYPE:
            return f"{name} has another type, {_type_text(peer, _MAX_PEER_TYPE)}"
        if self.kind is IncompatibilityKind.DEFINITION:
            theirs, ours = (printable(text, _MAX_PEER_HASH) for text in _hashes(peer, own))
            of = "its type" if own.channel.kind != "topic" else printable(own.type, _MAX_PEER_TYPE)
            return f"{name} has another definition of {of}, {theirs}; here it is {ours}"
        policies = (one.name.lower() for one in self.policies)
        if differ := describe_policies(theirs=peer.qos, ours=own.qos, policies=policies):
            return f"{name} {'offers' if peer.is_writer else 'requests'} incompatible QoS: {differ}"
        return f"{name} does not match: {self.reason}"


def _type_text(endpoint: DiscoveredEndpoint, max_chars: int = _MAX_TEXT) -> str:
    return printable(endpoint.service_type or endpoint.type, max_chars)


def _hashes(one: DiscoveredEndpoint, other: DiscoveredEndpoint) -> tuple[str, str]:
    """Return the hashes that both announce: of the message, or else of the service."""
    if one.type_hash and other.type_hash:
        return one.type_hash, other.type_hash
    return one.service_hash or one.type_hash, other.service_hash or other.type_hash
