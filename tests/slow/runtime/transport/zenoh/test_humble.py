"""Format of Humble, which has no type hashes, with a hand-written peer (docs/internals/zenoh.md 2.4, 9.1)."""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from sensor_msgs.msg import Image
from std_msgs.msg import String
from support.local_network import zenoh_environment
from support.waiting import until
from support.zenoh_peer import CDR, PlainPublisher

from rosidl_py_gen import type_hash
from rosidl_py_gen.runtime import Context, GoalStatus
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohConfigError

if TYPE_CHECKING:
    from support.worlds import World
    from support.zenoh_peer import Peer

    from rosidl_py_gen.runtime import ServerGoal

NO_HASH = "TypeHashNotSupported"
TEXT = f"std_msgs::msg::dds_::String_/{NO_HASH}"
ADD = f"example_interfaces::srv::dds_::AddTwoInts_/{NO_HASH}"
FORMAT = "ROSIDL_PY_GEN_ZENOH_FORMAT"
HUMBLE_TOKEN = re.compile(
    rf"@ros2_lv/\d+/[0-9a-f]+/\d+/\d+/(NN/[^/]+/[^/]+/[^/]+|"
    rf"(MP|MS|SS|SC)/[^/]+/[^/]+/[^/]+/%[^/]+/[^/]+/{NO_HASH}/"
    r"[0-3]?:[0-3]?:[0-3]?,\d*:\d*,\d*:\d*,\d*:[0134]?,\d*,\d*)"
)
"""Tokens that Humble reads: without hash and BEST_AVAILABLE."""


SEND_GOAL, GET_RESULT, FEEDBACK = (
    f"example_interfaces::action::dds_::Fibonacci_{name}_/{NO_HASH}"
    for name in ("SendGoal", "GetResult", "FeedbackMessage")
)
CANCEL = f"action_msgs::srv::dds_::CancelGoal_/{NO_HASH}"
STATUS = f"action_msgs::msg::dds_::GoalStatusArray_/{NO_HASH}"
SUCCEEDED = 4
GOAL_ID = bytes(range(16))


def text_message(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return CDR + struct.pack("<I", len(raw)) + raw


def sequence(*numbers: int) -> bytes:
    return struct.pack(f"<I{len(numbers)}i", len(numbers), *numbers)


@pytest.fixture
def humble(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FORMAT, "humble")


@pytest.mark.usefixtures("humble")
async def test_humble_format_exchanges_topics_and_services_in_both_directions(zenoh: World, peer: Peer) -> None:
    alice, bob = zenoh.pair()
    peer_publisher, received = PlainPublisher(peer, "/from/humble", TEXT), list[bytes]()
    peer.listen(peer.key("/to/humble", TEXT), received)
    peer.tell("MS", "/to/humble", TEXT)

    peer.serve("/humble/add", ADD, lambda request: struct.pack("<q", sum(struct.unpack_from("<qq", request))))

    subscription = alice.create_subscription(String, "/from/humble")
    publisher = alice.create_publisher(String, "/to/humble")
    inner_publisher = bob.create_publisher(String, "/from/humble")
    alice.create_service(AddTwoInts, "/ours/add", lambda request: AddTwoInts.Response(sum=request.a * request.b))
    client, inner = alice.create_client(AddTwoInts, "/humble/add"), bob.create_client(AddTwoInts, "/ours/add")

    assert await publisher.wait_for_subscribers(20) and await client.wait_for_service(20)
    publisher.publish(String(data="ours"))
    await until(lambda: received == [text_message("ours")])
    assert (await client.call(AddTwoInts.Request(a=3, b=4), timeout_s=20)).sum == 7
    await until(lambda: bool(peer.of_others("MS", "/from/humble") and peer.of_others("SS", "/ours/add")))
    peer_publisher.publish(text_message("theirs"))
    assert (await subscription.receive(20)).data == "theirs"
    responses = peer.call("/ours/add", ADD, struct.pack("<qq", 3, 4))
    await until(lambda: responses == [struct.pack("<q", 12)])
    assert await inner_publisher.wait_for_subscribers(20)
    inner_publisher.publish(String(data="bob"))
    assert (await subscription.receive(20)).data == "bob"
    assert (await inner.call(AddTwoInts.Request(a=5, b=6), timeout_s=20)).sum == 30


@pytest.mark.usefixtures("humble")
async def test_all_tokens_of_humble_format_are_readable_by_humble(zenoh: World, peer: Peer) -> None:
    node = zenoh.node("ours")
    node.create_subscription(Image, "/image", qos=presets.SENSOR_DATA)
    node.create_publisher(String, "/best", qos=presets.BEST_AVAILABLE)
    node.create_subscription(String, "/best", qos=presets.BEST_AVAILABLE)
    node.create_client(AddTwoInts, "/add", qos=presets.BEST_AVAILABLE)
    await until(lambda: bool(peer.of_others("SC", "/add")))
    assert len(peer.tokens) > 10
    assert [token for token in peer.tokens if not HUMBLE_TOKEN.fullmatch(token)] == []


async def test_humble_peers_do_not_match_without_humble_format_and_are_warned_about(
    zenoh: World, peer: Peer, caplog: pytest.LogCaptureFixture
) -> None:
    node = zenoh.node("ours")
    subscription = node.create_subscription(String, "/chatter")
    node.create_client(AddTwoInts, "/add")
    peer.tell("MS", "/parameter_events", f"rcl_interfaces::msg::dds_::ParameterEvent_/{NO_HASH}")
    await until(lambda: node.count_subscribers("/parameter_events") == 1)
    peer_publisher = PlainPublisher(peer, "/chatter", TEXT)
    peer.tell("SS", "/add", ADD)
    hint = r"only one of them has a type hash.*ROSIDL_PY_GEN_ZENOH_FORMAT=humble"
    await until(lambda: len(re.findall(hint, caplog.text)) >= 2)
    for end in (r"/chatter from node /peer to node /ours", r"/add from node /ours to node /peer"):
        assert len(re.findall(rf"no messages on {end}: {hint}", caplog.text)) == 1
    assert "no messages on /parameter_events" not in caplog.text
    await until(lambda: len(peer.of_others("MS", "/chatter")) == 1)
    peer_publisher.publish(text_message("without hash"))
    PlainPublisher(peer, "/chatter", f"std_msgs::msg::dds_::String_/{type_hash(String)}").publish(text_message("hash"))
    assert (await subscription.receive(20)).data == "hash"


def test_unknown_zenoh_format_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {**zenoh_environment(), FORMAT: "Humble"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(ZenohConfigError, match=r"ROSIDL_PY_GEN_ZENOH_FORMAT must be 'humble'.*got 'Humble'"):
        Context(transport="zenoh")


@pytest.mark.usefixtures("humble")
async def test_action_client_works_with_humble_server(zenoh: World, peer: Peer) -> None:
    feedback = PlainPublisher(peer, "/count/_action/feedback", FEEDBACK)
    PlainPublisher(peer, "/count/_action/status", STATUS)
    cancelled: list[bytes] = []

    def take_goal(request: bytes) -> bytes:
        goal_id, order = request[:16], *struct.unpack("<i", request[16:])
        feedback.publish(CDR + goal_id + sequence(order))
        return struct.pack("<?3xiI", True, 1, 2)

    def cancel(request: bytes) -> bytes:
        cancelled.append(request[:16])
        return struct.pack("<b3xI16siI", 0, 1, request[:16], 1, 2)

    peer.serve("/count/_action/send_goal", SEND_GOAL, take_goal)
    peer.serve("/count/_action/get_result", GET_RESULT, lambda _: struct.pack("<b3x", SUCCEEDED) + sequence(0, 1, 1))
    peer.serve("/count/_action/cancel_goal", CANCEL, cancel)

    client = zenoh.node("ours").create_action_client(Fibonacci, "/count")
    assert await client.wait_for_server(20)
    goal = await client.send_goal(Fibonacci.Goal(order=7), timeout_s=20)
    received = [list(message.sequence) async for message in goal.feedback()]
    status, result = await goal.result(20)
    assert (received, status, list(result.sequence)) == ([[7]], GoalStatus.SUCCEEDED, [0, 1, 1])
    other = await client.send_goal(Fibonacci.Goal(order=8), timeout_s=20)
    await other.cancel(20)
    assert cancelled == [other.goal_id]


@pytest.mark.usefixtures("humble")
async def test_action_server_works_with_humble_client(zenoh: World, peer: Peer) -> None:
    async def execute(goal: ServerGoal[Any]) -> Fibonacci.Result:
        goal.publish_feedback(Fibonacci.Feedback(sequence=[goal.request.order]))
        return Fibonacci.Result(sequence=[2, 3, 5])

    zenoh.node("ours").create_action_server(Fibonacci, "/primes", execute)
    feedback, statuses = list[bytes](), list[bytes]()
    for name, kind, received in (("feedback", FEEDBACK, feedback), ("status", STATUS, statuses)):
        peer.listen(peer.key(f"/primes/_action/{name}", kind), received)
        peer.tell("MS", f"/primes/_action/{name}", kind)
    await until(lambda: bool(peer.of_others("SS", "/primes/_action/get_result")))

    accepted = peer.call("/primes/_action/send_goal", SEND_GOAL, GOAL_ID + struct.pack("<i", 3))
    await until(lambda: len(accepted) == 1)
    assert accepted[0][0] == 1
    results = peer.call("/primes/_action/get_result", GET_RESULT, GOAL_ID)
    await until(lambda: len(results) == 1 and bool(statuses) and statuses[-1][4 + 28] == SUCCEEDED)
    assert results == [struct.pack("<b3x", SUCCEEDED) + sequence(2, 3, 5)]
    await until(lambda: feedback == [CDR + GOAL_ID + sequence(3)])
    # number of goals; id, time and status of each
    assert statuses[-1][4:24] == struct.pack("<I", 1) + GOAL_ID
