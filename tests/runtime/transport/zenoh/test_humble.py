"""The format of Humble, which has no type hashes, with a peer that is spoken by hand.

Source: docs/internals/zenoh.md 2.4, 9.1.
"""

from __future__ import annotations

import asyncio
import json
import re
import struct
import sys
from typing import TYPE_CHECKING, Any

import pytest
import zenoh
from example_interfaces.srv import AddTwoInts
from sensor_msgs.msg import Image
from std_msgs.msg import String
from support.node_fixtures import ROOT, start_process, until, zenoh_environment
from support.zenoh_peer import PlainPublisher, attachment

from rosidl_py_gen import type_hash
from rosidl_py_gen.runtime import Context
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.runtime.transport.zenoh.config import ZenohConfigError

if TYPE_CHECKING:
    from support.node_fixtures import World
    from support.zenoh_peer import Peer

NO_HASH = "TypeHashNotSupported"
TEXT = f"std_msgs::msg::dds_::String_/{NO_HASH}"
ADD = f"example_interfaces::srv::dds_::AddTwoInts_/{NO_HASH}"
FORMAT = "ROSIDL_PY_GEN_ZENOH_FORMAT"
HUMBLE_TOKEN = re.compile(
    rf"@ros2_lv/\d+/[0-9a-f]+/\d+/\d+/(NN/[^/]+/[^/]+/[^/]+|"
    rf"(MP|MS|SS|SC)/[^/]+/[^/]+/[^/]+/%[^/]+/[^/]+/{NO_HASH}/"
    r"[0-3]?:[0-3]?:[0-3]?,\d*:\d*,\d*:\d*,\d*:[0134]?,\d*,\d*)"
)
"""What Humble reads: no hash, none of the policies that are called BEST_AVAILABLE later."""


def text_message(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(raw)) + raw


@pytest.fixture
def humble(monkeypatch: pytest.MonkeyPatch) -> None:
    """Our contexts have the format of Humble."""
    monkeypatch.setenv(FORMAT, "humble")


def call_of_humble(peer: Peer, name: str, data: bytes) -> list[bytes]:
    """Call a service; what comes back is added to the list."""
    replies: list[bytes] = []
    gid = peer.tell("SC", name, ADD)
    querier = peer.session.declare_querier(
        peer.key(name, ADD),
        target=zenoh.QueryTarget.ALL_COMPLETE,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=20.0,
    )

    def take(reply: Any) -> None:
        number, _, _, to = struct.unpack("<qqB16s", reply.ok.attachment.to_bytes())
        assert (number, to) == (1, gid)
        replies.append(reply.ok.payload.to_bytes())

    peer.keep(querier)
    querier.get(zenoh.handlers.Callback(take, indirect=False), payload=data, attachment=attachment(1, gid))
    return replies


@pytest.mark.usefixtures("humble")
async def test_topics_and_services_of_humble_work_both_ways_in_its_format(zenoh: World, peer: Peer) -> None:
    alice, bob = zenoh.pair()
    theirs, heard = PlainPublisher(peer, "/from/humble", TEXT), list[bytes]()
    peer.listen(peer.key("/to/humble", TEXT), heard)
    peer.tell("MS", "/to/humble", TEXT)

    def answer(query: Any) -> None:
        a, b = struct.unpack_from("<qq", query.payload.to_bytes(), 4)
        reply = b"\0\1\0\0" + struct.pack("<q", a + b)
        query.reply(str(query.key_expr), reply, attachment=query.attachment.to_bytes())
        query.drop()

    peer.serve(peer.key("/humble/add", ADD), answer)
    peer.tell("SS", "/humble/add", ADD)

    subscription, publisher = (
        alice.create_subscription(String, "/from/humble"),
        alice.create_publisher(String, "/to/humble"),
    )
    among_us = bob.create_publisher(String, "/from/humble")
    alice.create_service(AddTwoInts, "/ours/add", lambda request: AddTwoInts.Response(sum=request.a * request.b))
    client, inner = alice.create_client(AddTwoInts, "/humble/add"), bob.create_client(AddTwoInts, "/ours/add")

    assert await publisher.wait_for_subscribers(5) and await client.wait_for_service(5)
    publisher.publish(String(data="ours"))
    await until(lambda: heard == [text_message("ours")])
    assert (await client.call(AddTwoInts.Request(a=3, b=4), timeout_s=5)).sum == 7
    await until(lambda: bool(peer.of_others("MS", "/from/humble") and peer.of_others("SS", "/ours/add")))
    theirs.publish(text_message("theirs"))
    assert (await subscription.receive(5)).data == "theirs"
    replies = call_of_humble(peer, "/ours/add", b"\0\1\0\0" + struct.pack("<qq", 3, 4))
    await until(lambda: replies == [b"\0\1\0\0" + struct.pack("<q", 12)])
    # and ours with each other
    assert await among_us.wait_for_subscribers(5)
    among_us.publish(String(data="bob"))
    assert (await subscription.receive(5)).data == "bob"
    assert (await inner.call(AddTwoInts.Request(a=5, b=6), timeout_s=5)).sum == 30


@pytest.mark.usefixtures("humble")
async def test_humble_reads_every_token_of_its_format(zenoh: World, peer: Peer) -> None:
    node = zenoh.node("ours")
    node.create_subscription(Image, "/image", qos=presets.SENSOR_DATA)
    node.create_publisher(String, "/best", qos=presets.BEST_AVAILABLE)
    node.create_subscription(String, "/best", qos=presets.BEST_AVAILABLE)
    node.create_client(AddTwoInts, "/add", qos=presets.BEST_AVAILABLE)
    await until(lambda: bool(peer.of_others("SC", "/add")))
    assert len(peer.tokens) > 10
    assert [token for token in peer.tokens if not HUMBLE_TOKEN.fullmatch(token)] == []


async def test_without_its_format_nothing_comes_of_humble_and_a_warning_says_why(
    zenoh: World, peer: Peer, caplog: pytest.LogCaptureFixture
) -> None:
    node = zenoh.node("ours")
    subscription = node.create_subscription(String, "/chatter")
    node.create_client(AddTwoInts, "/add")
    peer.tell("MS", "/parameter_events", f"rcl_interfaces::msg::dds_::ParameterEvent_/{NO_HASH}")
    await until(lambda: node.count_subscribers("/parameter_events") == 1)
    theirs = PlainPublisher(peer, "/chatter", TEXT)
    peer.tell("SS", "/add", ADD)
    hint = r"only one of them has a type hash.*ROSIDL_PY_GEN_ZENOH_FORMAT=humble"
    await until(lambda: len(re.findall(hint, caplog.text)) >= 2)
    for end in (r"/chatter from node /peer to node /ours", r"/add from node /ours to node /peer"):
        assert len(re.findall(rf"no messages on {end}: {hint}", caplog.text)) == 1
    assert "no messages on /parameter_events" not in caplog.text
    await until(lambda: len(peer.of_others("MS", "/chatter")) == 1)
    theirs.publish(text_message("without hash"))
    PlainPublisher(peer, "/chatter", f"std_msgs::msg::dds_::String_/{type_hash(String)}").publish(text_message("hash"))
    assert (await subscription.receive(5)).data == "hash"


async def test_another_definition_is_a_warning_and_the_same_one_is_none(
    zenoh: World, peer: Peer, caplog: pytest.LogCaptureFixture
) -> None:
    publisher = zenoh.node("ours").create_publisher(String, "/chatter")
    peer.tell("MS", "/chatter", f"std_msgs::msg::dds_::String_/{type_hash(String)}")
    peer.tell("MS", "/chatter", f"std_msgs::msg::dds_::String_/RIHS01_{0:064x}")
    said = (
        "no messages on /chatter from node /ours to node /peer: they have std_msgs/msg/String by different definitions"
    )
    await until(lambda: said in caplog.text)
    assert caplog.text.count("no messages on") == 1 and len(publisher._writer.matched_readers()) == 1


def test_a_format_that_is_not_known_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {**zenoh_environment(), FORMAT: "Humble"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(ZenohConfigError, match=r"ROSIDL_PY_GEN_ZENOH_FORMAT must be 'humble'.*got 'Humble'"):
        Context(transport="zenoh")


async def test_the_command_line_listens_to_humble(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    publisher = PlainPublisher(peer, "/chatter", TEXT)
    monkeypatch.setenv(FORMAT, "humble")
    process = await start_process(
        *(sys.executable, "-m", "rosidl_py_gen.ros_cli", "topic", "echo", "/chatter", "--once", "--json"),
        cwd=ROOT,
        stdout=asyncio.subprocess.PIPE,
    )
    await until(lambda: len(peer.of_others("MS", "/chatter")) == 1, 20)
    publisher.publish(text_message("from humble"))
    output, _ = await asyncio.wait_for(process.communicate(), 20)
    assert json.loads(output) == {"data": "from humble"}
