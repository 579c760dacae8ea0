"""Servers and clients that are closed or killed, and restarted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from peer_helpers import fresh, service
from rclpy_peer import Peer
from support.node_fixtures import SOON_MISSED, until

KIND = "std_srvs/srv/Trigger"


@pytest.mark.parametrize("end", ["close", "kill"])
async def test_a_server_of_theirs_that_ends_is_missed_and_may_return(
    dds: Any, shared_peer: Peer, start_mortal: Callable[[str], Peer], end: str
) -> None:
    name, cls = fresh("mortal"), service(shared_peer, KIND)
    client = dds.node("tester").create_client(cls, name)
    for note in ("first", "second"):
        peer = start_mortal("mortal")
        await peer.do("serve", name=name, type=KIND, how="trigger", note=note)
        assert await client.wait_for_service(timeout_s=10)
        assert (await client.call(cls.Request(), 10)).message == note
        getattr(peer, end)()
        await until(lambda: not client.service_is_available())


async def test_a_server_of_ours_that_ends_is_missed_and_may_return(
    dds: Any, shared_peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(*SOON_MISSED)
    name, cls = fresh("mortal"), service(shared_peer, KIND)
    await shared_peer.do("client", name=name, type=KIND, wait=False)
    for note in ("first", "second"):
        context = dds.context()
        dds.node("server", context=context).create_service(
            cls, name, lambda _, note=note: cls.Response(success=True, message=note)
        )
        await shared_peer.do("ready", name=name)
        assert await shared_peer.do("call", name=name, requests_=[{}]) == [{"success": True, "message": note}]
        context.close()
        if note == "first":  # which takes the time of a lease: Fast DDS does not take Cyclone's word for it
            await shared_peer.do("ready", name=name, expected=False)


async def test_our_server_outlives_clients_that_are_killed(
    dds: Any, shared_peer: Peer, start_mortal: Callable[[str], Peer]
) -> None:
    name, cls = fresh("survivor"), service(shared_peer, KIND)
    dds.node("server").create_service(cls, name, lambda _: cls.Response(message="still here"))
    for _ in range(3):
        peer = start_mortal("victim")
        await peer.do("client", name=name, type=KIND)
        assert (await peer.do("call", name=name, requests_=[{}]))[0]["message"] == "still here"
        peer.start("call", name=name, requests_=[{}] * 5)
        peer.kill()
