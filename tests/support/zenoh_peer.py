"""Node on Zenoh made of messages by hand, in one process with our nodes.

Nothing of ours makes or reads what it says; it is written from docs/internals/zenoh.md 2 to 4, 9.
"""

from __future__ import annotations

import itertools
import json
import struct
import time
from typing import TYPE_CHECKING, Any

import xxhash
import zenoh

from support.local_network import domain_id, zenoh_router

if TYPE_CHECKING:
    from collections.abc import Callable

CDR = b"\0\1\0\0"
PLAIN = "::,10:,:,:,,"
"""Text of the default profile."""


class Peer:
    """Session with a node `/peer`."""

    def __init__(self) -> None:
        config = zenoh.Config()
        for key, value in (
            ("connect/endpoints", [zenoh_router()]),
            ("listen/endpoints", ["tcp/127.0.0.1:0"]),
            ("scouting/multicast/enabled", False),
            ("timestamping/enabled", {"router": True, "peer": True, "client": True}),
        ):
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self.domain = domain_id()
        self._ids = itertools.count()
        self._kept: list[Any] = [self.session.liveliness().declare_token(self._token("NN"))]
        self.tokens: set[str] = set()
        """Tokens of other sessions."""
        self._listen = self.session.liveliness().declare_subscriber(
            f"@ros2_lv/{self.domain}/**", zenoh.handlers.Callback(self._on_token, indirect=False), history=True
        )

    def _token(self, kind: str) -> str:
        return f"@ros2_lv/{self.domain}/{self.session.zid()}/0/{next(self._ids)}/{kind}/%/%/peer"

    def _on_token(self, sample: Any) -> None:
        change = self.tokens.add if sample.kind == zenoh.SampleKind.PUT else self.tokens.discard
        if str(self.session.zid()) not in str(sample.key_expr):
            change(str(sample.key_expr))

    def of_others(self, kind: str, name: str) -> list[list[str]]:
        """Return the chunks of other sessions' tokens of a topic or service."""
        tokens = (token.split("/") for token in sorted(self.tokens))
        return [chunks for chunks in tokens if chunks[5] == kind and chunks[9] == name.replace("/", "%")]

    def key(self, name: str, type_and_hash: str) -> str:
        return f"{self.domain}{name}/{type_and_hash}"

    def tell(self, kind: str, name: str, type_and_hash: str, end: str = PLAIN) -> bytes:
        """Declare the token of an endpoint; return its GID."""
        token = f"{self._token(kind)}/{name.replace('/', '%')}/{type_and_hash}/{end}"
        self._kept.append(self.session.liveliness().declare_token(token))
        return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")

    def listen(self, key: str, heard: list[bytes]) -> None:
        """Declare a subscriber without token."""
        take = zenoh.handlers.Callback(lambda sample: heard.append(sample.payload.to_bytes()), indirect=False)
        self._kept.append(self.session.declare_subscriber(key, take))

    def serve(self, name: str, type_and_hash: str, respond: Callable[[bytes], bytes]) -> None:
        """Create a server; requests and responses have no CDR header."""

        def answer(query: Any) -> None:
            body = respond(query.payload.to_bytes()[4:])
            query.reply(str(query.key_expr), CDR + body, attachment=query.attachment.to_bytes())
            query.drop()

        take = zenoh.handlers.Callback(answer, indirect=False)
        self._kept.append(self.session.declare_queryable(self.key(name, type_and_hash), take, complete=True))
        self.tell("SS", name, type_and_hash)

    def call(self, name: str, type_and_hash: str, request: bytes) -> list[bytes]:
        """Call a service; responses without CDR header are added to the returned list."""
        responses: list[bytes] = []
        gid = self.tell("SC", name, type_and_hash)

        def take(reply: Any) -> None:
            number, _, _, to = struct.unpack("<qqB16s", reply.ok.attachment.to_bytes())
            assert (number, to) == (1, gid)
            responses.append(reply.ok.payload.to_bytes()[4:])

        querier = self.session.declare_querier(
            self.key(name, type_and_hash),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=20.0,
        )
        self._kept.append(querier)
        until_s = time.monotonic() + 20
        while not querier.matching_status.matching and time.monotonic() < until_s:
            time.sleep(0.01)
        callback = zenoh.handlers.Callback(take, indirect=False)
        querier.get(callback, payload=CDR + request, attachment=attachment(1, gid))
        return responses

    def close(self) -> None:
        self.session.close()


def attachment(number: int, gid: bytes) -> bytes:
    return struct.pack("<qqB16s", number, time.time_ns(), 16, gid)


class PlainPublisher:
    """Publisher of Jazzy, or of Humble, which differs by `type_and_hash`."""

    def __init__(self, peer: Peer, name: str, type_and_hash: str) -> None:
        self.peer, self.name = peer, name
        self.base = peer.key(name, type_and_hash)
        self.numbers = itertools.count(1)
        self.gid = peer.tell("MP", name, type_and_hash)

    def put(self, key: str, data: bytes) -> None:
        self.peer.session.put(key, data, attachment=attachment(next(self.numbers), self.gid))

    def publish(self, data: bytes) -> None:
        self.put(self.base, data)
