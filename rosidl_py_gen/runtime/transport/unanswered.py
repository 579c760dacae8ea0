"""How a transport tells a client that nobody will answer a request any more: by a sample that is no response.

Decides that such a sample has an encapsulation that does not exist, so that no response is taken for one, not even one
without any content; and what a person reads behind "the server of /add".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.port import IDENTITY_BYTES, identified, identity_of

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.port import Identity, Payload

_NO_ENCAPSULATION = b"\xff\xff"


def unanswered(identity: Identity, reason: str = "went away before it answered") -> bytes:
    """The sample that tells a client: no server is left that could answer this request."""
    return identified(_NO_ENCAPSULATION + b"\0\0" + reason.encode(), identity)


def why_unanswered(data: Payload) -> str | None:
    """What `unanswered` was told; None when it is something else."""
    if data[:2] != _NO_ENCAPSULATION or identity_of(data) is None:
        return None
    return bytes(data[4 + IDENTITY_BYTES :]).decode(errors="replace")
