"""Topics and services with each peer, in both directions; everything else with the peer like rmw_zenoh_cpp."""

from __future__ import annotations

import asyncio
import signal
from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import String, UInt8MultiArray
from std_srvs.srv import SetBool
from support.waiting import until

from rosidl_py_gen.runtime import QoSProfile, ServerLostError
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import gid_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractAsyncContextManager

    from conftest import Peer
    from support.worlds import World

    Running = Callable[..., AbstractAsyncContextManager[Peer]]

STRING = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
LATCHED = QoSProfile().keep_last(5).transient_local()


@pytest.mark.parametrize("name", ["raw", "sdk", "zeros"])
async def test_topics_and_services_work_with_each_zenoh_peer(world: World, running: Running, name: str) -> None:
    node = world.node("ours")
    heard = node.create_subscription(String, "/from/peer", qos=100)
    node.create_subscription(UInt8MultiArray, "/bytes")  # its token has more chunks than they know
    publisher = node.create_publisher(String, "/to/peer")
    node.create_service(SetBool, "/ours/set", lambda request: SetBool.Response(success=request.data, message="ours"))
    client = node.create_client(SetBool, "/peer/set")
    async with running(name) as peer:
        first, second = (await heard.receive(15)).data, (await heard.receive(5)).data
        assert (first.split()[0], int(second.split()[1])) == (name, int(first.split()[1]) + 1)
        assert await publisher.wait_for_subscribers(10)
        publisher.publish(String(data="hello"))
        assert (await peer.wait_for("heard"))[0].startswith("hello ")
        assert await client.wait_for_service(10)
        for value in (True, False):
            response = await client.call(SetBool.Request(data=value), timeout_s=10)
            assert (response.success, response.message) == (value, name)
        assert await peer.wait_for("asked", 2) == ["1", "0"]
        peer.tell("call 1")
        assert await peer.wait_for("answered") == ["1 ours"]
        (info,) = node.get_publishers_info_by_topic("/from/peer")
        assert (info.topic_type, info.topic_type_hash[:15]) == ("std_msgs/msg/String", "RIHS01_df668c74")
        if name != "sdk":  # its GID is not the hash of its token
            assert [bytes(info.endpoint_gid).hex()] == peer.printed("ready")
    await until(lambda: node.count_publishers("/from/peer") == 0)


async def test_late_joiners_receive_latched_messages(world: World, running: Running) -> None:
    node = world.node("ours")
    publisher = node.create_publisher(String, "/latched/by_us", LATCHED)
    for number in range(8):
        publisher.publish(String(data=f"ours {number}"))
    async with running("raw") as peer:
        late = node.create_subscription(String, "/latched/by_peer", qos=LATCHED)
        assert [(await late.receive(10)).data for _ in range(5)] == [f"latched {number}" for number in range(4, 9)]
        peer.tell("latch")
        assert await peer.wait_for("latched", 5) == [f"ours {number}" for number in range(3, 8)]


async def test_peer_parses_liveliness_tokens_and_attachments(world: World, running: Running) -> None:
    node = world.node("ours", "/arm")
    publisher = node.create_publisher(String, "/to/peer", LATCHED.deadline(0.5))
    async with running("raw") as peer:
        peer.tell("tokens")
        await until(lambda: any("/%to%peer/" in token and "/MP/" in token for token in peer.printed("token")), 10)
        (token,) = [token for token in peer.printed("token") if "/MP/" in token and "/%to%peer/" in token]
        assert f"/MP/%/%arm/ours/%to%peer/{STRING}/" in token
        assert token.endswith(":1:,5:0,500000000:,:,,")
        await until(lambda: any(other.endswith("/NN/%/%arm/ours") for other in peer.printed("token")), 10)
        assert await publisher.wait_for_subscribers(10)
        publisher.publish(String(data="first"))
        publisher.publish(String(data="second"))
        gid = gid_of(token).hex()
        assert await peer.wait_for("heard", 2) == [f"first 1 {gid}", f"second 2 {gid}"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
async def test_ended_peer_disappears_and_fails_pending_calls(world: World, running: Running, number: int) -> None:
    node = world.node("ours")
    client = node.create_client(SetBool, "/peer/set")
    async with running("raw", "silent") as peer:
        assert await client.wait_for_service(10)
        call = asyncio.ensure_future(client.call(SetBool.Request(data=True), timeout_s=20))
        await peer.wait_for("asked")
        assert "/raw" in node.get_node_names()
        peer.process.send_signal(number)
        with pytest.raises(ServerLostError):
            await call
        await until(lambda: "/raw" not in node.get_node_names() and node.count_publishers("/from/peer") == 0, 5)


async def test_frozen_peer_disappears_after_its_lease(world: World, running: Running) -> None:
    # Its return is not tested: it depends on the router's gossip, and failed in 3 of some 80 runs. A token that appears
    # again is tested in `runtime/transport/zenoh/test_graph.py`.
    node = world.node("ours")
    async with running("raw", "2000") as peer:
        await until(lambda: node.count_publishers("/from/peer") == 1, 10)
        peer.process.send_signal(signal.SIGSTOP)
        try:
            await until(lambda: node.count_publishers("/from/peer") == 0, 10)
        finally:
            peer.process.send_signal(signal.SIGCONT)
