"""Requests that come before Cyclone is connected with their writer, as most do of a client that calls at once."""

from __future__ import annotations

import ctypes as ct
import time
from typing import Any

from rclpy_peer import Peer
from rclpy_worlds import fresh, service

from rosidl_py_gen.runtime.transport.cyclone import abi
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone

KIND = "std_srvs/srv/Trigger"
_Listener = ct.CFUNCTYPE(None, ct.c_int32, abi.MatchedStatus, ct.c_void_p)


def connect_late(reader: Any, delay_s: float) -> Any:
    """Let Cyclone pause before it connects that reader with a writer it has told us of; what has to be kept alive."""
    function = _Listener(lambda *_: time.sleep(delay_s))
    api, listener = cyclone._api, cyclone._api.create_listener(None)
    api.copy_listener(listener, reader._owner._listener)
    api.lset_subscription_matched_arg(listener, ct.cast(function, ct.c_void_p), None, True)
    assert api.set_listener(reader.entity, listener) == 0
    api.delete_listener(listener)
    return function


async def test_a_request_is_answered_that_came_before_its_writer_was_connected(dds: Any, shared_peer: Peer) -> None:
    """It is sent again behind the peer's next heartbeat, 3 s later. Seen to be lost every time without `catchup.py`."""
    name, cls = fresh("early"), service(shared_peer, KIND)
    server = dds.node("server").create_service(cls, name, lambda _: cls.Response(success=True, message="heard"))
    kept = connect_late(server._reader, 0.2)
    await shared_peer.ask("client", name=name, type=KIND)
    answers = await shared_peer.ask("call", name=name, requests_=[{}, {}], within_s=10)
    assert [answer["message"] for answer in answers] == ["heard", "heard"]
    del kept
