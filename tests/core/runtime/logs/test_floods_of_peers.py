"""Peers cannot fill the log: repeated faults of their messages and endpoints take few, short lines."""

from __future__ import annotations

import asyncio
import random
import time
from typing import TYPE_CHECKING, Any

import pytest
from support.inner_state import participant_of, transport_end_of
from support.waiting import until

from rosidl_py_gen.cdr.layout import Header
from rosidl_py_gen.msgs.lifecycle_msgs.msg import Transition
from rosidl_py_gen.msgs.lifecycle_msgs.srv import ChangeState
from rosidl_py_gen.robot.urdf import parse_urdf
from rosidl_py_gen.runtime import CallTimeoutError, LifecycleNode, qos
from rosidl_py_gen.runtime.transport.api import EndpointSpec, NodeEntities, TopicKey
from rosidl_py_gen.runtime.transport.dds import discovery_info
from rosidl_py_gen.runtime.transport.qos import QoSProfile

if TYPE_CHECKING:
    from support.worlds import World

COUNT = 500
STRING = "std_msgs/msg/String"
GRAPH = EndpointSpec(
    TopicKey("unmangled", discovery_info.DISCOVERY_TOPIC),
    "rmw_dds_common/msg/ParticipantEntitiesInfo",
    QoSProfile().keep_all().transient_local(),
)


def lines(caplog: pytest.LogCaptureFixture, words: str) -> list[str]:
    return [record.getMessage() for record in caplog.records if words in record.getMessage()]


def malformed(guid: bytes, number: int) -> bytes:
    """Return a graph message that has neither layout: random, with a count of 2**32 - 1, or cut off."""
    generator = random.Random(number)
    valid = discovery_info.encode_message(guid, [])
    return (Header.BYTES + generator.randbytes(24), valid[:-4] + b"\xff" * 4, valid[: 4 * generator.randrange(2, 5)])[
        number % 3
    ]


async def test_malformed_graph_messages_are_logged_once_a_second(dds: World, caplog: pytest.LogCaptureFixture) -> None:
    observer, attacker = dds.pair()
    sender: Any = participant_of(attacker)
    raw = sender.create_writer(GRAPH)  # retains its messages until the observer has discovered it
    start_s = time.monotonic()
    for number in range(COUNT):
        raw.write(malformed(sender.guid, number))
    raw.write(discovery_info.encode_message(sender.guid, [NodeEntities("/", "last", frozenset(), frozenset())]))
    await until(lambda: any("last" in str(one) for one in observer.get_nodes()))
    found = lines(caplog, "ignored a graph message of participant")
    assert 1 <= len(found) <= 2 + time.monotonic() - start_s
    assert max(map(len, found)) < 300


async def test_incompatible_endpoints_are_summarized_after_the_first_ten(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = memory.pair()
    alice.create_subscription(STRING, "chatter")
    for _ in range(COUNT):
        bob.create_publisher(STRING, "chatter", qos.SENSOR_DATA)
    await until(lambda: len(lines(caplog, "256 incompatible endpoints so far")) == 2)  # a line of each node
    found = lines(caplog, "no messages on /chatter from node /bob to node /alice")
    assert len([line for line in found if "so far" not in line]) == 20
    assert len([line for line in found if "so far" in line]) == 10  # 16, 32, 64, 128 and 256
    alice.create_subscription("std_msgs/msg/Bool", "other")
    bob.create_publisher("std_msgs/msg/Empty", "other")
    await until(lambda: lines(caplog, "on /other from node"))


async def test_refused_lifecycle_state_changes_are_logged_once_a_second(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = LifecycleNode("robot", context=memory.context())
    client = memory.node("peer").create_client(ChangeState, "/robot/change_state")
    start_s = time.monotonic()
    for _ in range(COUNT):
        request = ChangeState.Request(transition=Transition(label="\x1b[2J" + "x" * 100_000))
        assert not (await client.call(request, timeout_s=10)).success
    found = lines(caplog, "refused a change of state")
    assert 1 <= len(found) <= 2 + time.monotonic() - start_s
    assert len(found[0]) < 300 and "\x1b" not in found[0]
    node.close()


async def test_responses_without_client_reader_are_logged_once_a_second(
    memory: World, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    alice, bob = memory.pair()
    server: Any = alice.create_service("std_srvs/srv/Trigger", "stop", lambda request: {})
    monkeypatch.setattr(transport_end_of(server), "can_reach_client", lambda _: False)
    client = bob.create_client("std_srvs/srv/Trigger", "stop")
    results = await asyncio.gather(*(client.call({}, timeout_s=20) for _ in range(5)), return_exceptions=True)
    assert {type(result) for result in results} == {CallTimeoutError}
    assert len(lines(caplog, "its client's reader never appeared")) == 1


def test_faulty_joints_of_a_robot_description_are_logged_at_most_ten_times(caplog: pytest.LogCaptureFixture) -> None:
    links = "".join(f'<link name="l{number}"/>' for number in range(COUNT + 1))
    joints = "".join(
        f'<joint name="j{number}" type="continuous"><parent link="l{number}"/><child link="l{number + 1}"/>'
        '<axis xyz="0 0 0"/></joint>'
        for number in range(COUNT)
    )
    assert len(parse_urdf(f'<robot name="r">{links}{joints}</robot>')) == COUNT
    assert len(lines(caplog, "is not published: its axis has length 0.0")) == 10
    assert lines(caplog, "further") == ["490 further warnings about this robot description are not logged"]
