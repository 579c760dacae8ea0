"""Liveliness tokens: how nodes and endpoints tell that they exist.

Decides the text of a token, reads those of others, and makes GIDs of them. The text is the only description of an
endpoint there is, and its hash is the endpoint's name in attachments: what is written has to be canonical, and what was
read is hashed as it came, never after it was put together again.

Source: docs/internals/zenoh.md 3 (rmw_zenoh_cpp, liveliness_utils.cpp).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

import xxhash

from rosidl_py_gen.runtime.transport.qos import QoSProfile
from rosidl_py_gen.runtime.transport.zenoh.keys import HASH_NOT_SUPPORTED
from rosidl_py_gen.runtime.transport.zenoh.qos import qos_text, read_qos

TOKEN_PREFIX = "@ros2_lv"
CPU_BACKEND = "backends:cpu:"
"""Last chunk of a subscription that takes buffers of Lyrical from the CPU's memory (`keys.cpu_buffer_key`)."""

_NODE_CHUNKS, _ENDPOINT_CHUNKS = 9, 13
_NUMBER = re.compile(r"[0-9]{1,20}\Z")
_ZID = re.compile(r"(?!0)[0-9a-f]{1,32}\Z")


class EntityKind(Enum):
    """What a token stands for."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVER = "SS"
    CLIENT = "SC"


_ENDPOINTS = {kind.value: kind for kind in EntityKind if kind is not EntityKind.NODE}


@dataclass(frozen=True, slots=True)
class NodeToken:
    """A node of a session.

    Attributes:
        zid: of the session, as Zenoh prints it: hex without leading zeros.
        node_id: from the session's counter, which counts nodes and endpoints from 0.
        namespace: ``/`` or ``/robot1``.
    """

    domain_id: int
    zid: str
    node_id: int
    name: str
    namespace: str = "/"
    enclave: str = "/"

    def __str__(self) -> str:
        return _chunks(self, self.node_id, EntityKind.NODE)


@dataclass(frozen=True, slots=True)
class EndpointToken:
    """An endpoint of a node.

    Attributes:
        entity_id: from the session's counter.
        name: fully qualified, of the topic or service.
        type: DDS name of the message, or of the service without Request and Response.
        type_hash: as the token has it; `keys.valid_hash_or_empty` tells whether it is one. Empty is written as
        Humble does. backends: of Lyrical and later, else empty.
    """

    node: NodeToken
    entity_id: int
    kind: EntityKind
    name: str
    type: str
    type_hash: str
    qos: QoSProfile
    backends: str = ""

    def __str__(self) -> str:
        """Raises `InvalidQoSError` for UNKNOWN policies."""
        end = f"/{self.backends}" if self.backends else ""
        type_hash = self.type_hash or HASH_NOT_SUPPORTED
        return (
            f"{_chunks(self.node, self.entity_id, self.kind)}/{_mangled(self.name)}/{self.type}/{type_hash}"
            f"/{qos_text(self.qos)}{end}"
        )


def tokens_of(domain_id: int) -> str:
    """The key expression of all tokens of a domain."""
    return f"{TOKEN_PREFIX}/{domain_id}/**"


def gid_of(token: str) -> bytes:
    """The GID, 16 bytes, of whom a token stands for: XXH3-128 of its text, low half first."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def read_token(text: str) -> NodeToken | EndpointToken | None:
    """What a token tells; None when it is not one of ROS, or not one that rmw_zenoh_cpp would take.

    Chunks behind those that are known are left alone, as rmw_zenoh_cpp does: later distributions may add some.
    """
    chunks = text.split("/")
    if len(chunks) < _NODE_CHUNKS or chunks[0] != TOKEN_PREFIX or not all(chunks):
        return None
    domain_id, zid, node_id, entity_id, kind = chunks[1:6]
    if not (_ZID.match(zid) and all(map(_NUMBER.match, (domain_id, node_id, entity_id)))):
        return None
    enclave, namespace, name = (chunk.replace("%", "/") for chunk in chunks[6:_NODE_CHUNKS])
    node = NodeToken(int(domain_id), zid, int(node_id), name, namespace, enclave)
    if kind == EntityKind.NODE.value:
        return node
    if kind not in _ENDPOINTS or len(chunks) < _ENDPOINT_CHUNKS:
        return None
    topic, type_name, type_hash, qos_chunk, *more = chunks[_NODE_CHUNKS:]
    qos = read_qos(qos_chunk)
    if qos is None:
        return None
    backends = more[0] if more else ""
    name = topic.replace("%", "/")
    return EndpointToken(node, int(entity_id), _ENDPOINTS[kind], name, type_name, type_hash, qos, backends)


def _chunks(node: NodeToken, entity_id: int, kind: EntityKind) -> str:
    """Chunks 0 to 8, which all tokens have."""
    return (
        f"{TOKEN_PREFIX}/{node.domain_id}/{node.zid}/{node.node_id}/{entity_id}/{kind.value}"
        f"/{_mangled(node.enclave)}/{_mangled(node.namespace)}/{_mangled(node.name)}"
    )


def _mangled(name: str) -> str:
    return name.replace("/", "%")
