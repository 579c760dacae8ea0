"""Liveliness tokens, by which nodes and endpoints announce that they exist.

The text of a token is the only description of an endpoint, and its hash is the endpoint's GID in attachments. So the
text of own tokens is canonical, and those of peers are hashed as received, never after re-encoding.

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
"""Last chunk of a subscription that receives buffers of Lyrical in ordinary memory (`keys.cpu_buffer_key`)."""

_NODE_CHUNKS = 9
_ENDPOINT_CHUNKS = 13
_NUMBER = re.compile(r"[0-9]{1,20}\Z")
_ZID = re.compile(r"(?!0)[0-9a-f]{1,32}\Z")


class EntityKind(Enum):
    """Kind of the entity that a token announces."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVER = "SS"
    CLIENT = "SC"


_ENDPOINTS = {kind.value: kind for kind in EntityKind if kind is not EntityKind.NODE}


@dataclass(frozen=True, slots=True)
class NodeToken:
    """Token of a node.

    Attributes:
        zid: id of the session, as Zenoh prints it: hex without leading zeros.
        node_id: number of the session's counter, which counts nodes and endpoints from 0.
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
    """Token of an endpoint.

    Attributes:
        entity_id: number of the session's counter.
        name: fully qualified name of the topic or service.
        type: DDS name of the message, or of the service without Request and Response.
        type_hash: text in the token, see `keys.valid_hash_or_empty`; an empty one is written as in Humble.
        backends: chunk of Lyrical and later; else empty.
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
        """Return the text; raise `InvalidQoSError` for UNKNOWN policies."""
        backends = f"/{self.backends}" if self.backends else ""
        type_hash = self.type_hash or HASH_NOT_SUPPORTED
        return (
            f"{_chunks(self.node, self.entity_id, self.kind)}/{_mangled(self.name)}/{self.type}/{type_hash}"
            f"/{qos_text(self.qos)}{backends}"
        )


def tokens_of(domain_id: int) -> str:
    """Return the key expression of all tokens of a domain."""
    return f"{TOKEN_PREFIX}/{domain_id}/**"


def gid_of(token: str) -> bytes:
    """Return the GID, 16 bytes, of the entity of a token: XXH3-128 of its text, low half first."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def read_token(text: str) -> NodeToken | EndpointToken | None:
    """Parse a token; return None if it is not one of ROS, or not one that rmw_zenoh_cpp accepts.

    Further chunks are ignored, as by rmw_zenoh_cpp: later distributions may add some.
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
    return (
        f"{TOKEN_PREFIX}/{node.domain_id}/{node.zid}/{node.node_id}/{entity_id}/{kind.value}"
        f"/{_mangled(node.enclave)}/{_mangled(node.namespace)}/{_mangled(node.name)}"
    )


def _mangled(name: str) -> str:
    return name.replace("/", "%")
