"""Requests that arrive before Cyclone DDS has matched their writer, as most do of a client that calls at once."""

from __future__ import annotations

import ctypes as ct
import time
from typing import TYPE_CHECKING, Any

import pytest
from peer_helpers import fresh, service
from support.node_fixtures import until

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.cyclone import c_api
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.early_samples import request_samples
from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy_peer import Peer

KIND = "std_srvs/srv/Trigger"
_Listener = ct.CFUNCTYPE(None, ct.c_int32, c_api.DdsMatchedStatus, ct.c_void_p)


def delay_match(reader: Any, delay_s: float) -> Any:
    """Delay Cyclone's match of a reader; return the object to keep alive."""
    function = _Listener(lambda *_: time.sleep(delay_s))  # Cyclone does not notify of a suitable moment
    api, listener = cyclone._api, cyclone._api.create_listener(None)
    api.copy_listener(listener, reader._owner._listener)
    api.lset_subscription_matched_arg(listener, ct.cast(function, ct.c_void_p), None, True)
    assert api.set_listener(reader.entity, listener) == 0
    api.delete_listener(listener)
    return function


async def test_a_request_is_answered_that_came_before_its_writer_was_connected(dds: Any, shared_peer: Peer) -> None:
    """The request is repeated after the peer's next heartbeat, 3 s later; without the early-request mechanism it is
    lost.
    """
    name, cls = fresh("early"), service(shared_peer, KIND)
    server = dds.node("server").create_service(cls, name, lambda _: cls.Response(success=True, message="heard"))
    function = delay_match(server._transport_server._reader, 0.2)
    await shared_peer.do("client", name=name, type=KIND)
    answers = await shared_peer.do("call", name=name, requests_=[{}, {}], within_s=10)
    assert [answer["message"] for answer in answers] == ["heard", "heard"]
    del function


@pytest.mark.about_fast_dds("only its writers are asked")
async def test_a_new_writer_is_asked_once_what_it_has_written(
    dds: Any, shared_peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested: list[tuple[bytes, bytes]] = []

    def record(pairs: Sequence[tuple[bytes, bytes]], addresses: str, *, is_local: bool) -> None:
        requested.extend(pairs)
        request_samples(pairs, addresses, is_local=is_local)

    name, cls = fresh("asked"), service(shared_peer, KIND)
    node = dds.node("server")
    server = node.create_service(cls, name, lambda _: cls.Response(success=True, message="heard"))
    node.create_subscription("std_msgs/msg/String", f"{name}/best_effort", qos=QoSProfile().best_effort())
    reader, best_effort = server._transport_server.endpoints[0], list(node._scope.participant.readers.values())[-1].guid
    monkeypatch.setattr(cyclone, "request_samples", record)
    await shared_peer.do("publisher", topic=f"{name}/best_effort", type="std_msgs/msg/String")
    await shared_peer.do("client", name=name, type=KIND)
    await shared_peer.do("call", name=name, requests_=[{}], within_s=10)
    await until(lambda: any(pair[0] == reader for pair in requested))
    of_service = [end.guid for end in node._scope.graph.endpoints_on(TopicKey("request", name), writers=True)]
    assert len(of_service) == 1
    assert [pair for pair in requested if pair[0] == reader] == [(reader, of_service[0])]
    assert best_effort not in {pair[0] for pair in requested}
