"""Peers of another ROS distribution with another definition of a type: messages are dropped, never misread."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import pytest
from support.announced_types import humble_node, without_hash
from support.inner_state import graph_of, participant_of, reader_of
from support.waiting import until

from rosidl_py_gen import compile_definition, get_message, to_dict, type_hash, type_loading
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.msgs.distribution_hashes import HASHES
from rosidl_py_gen.runtime import CallTimeoutError, SubscriptionEventCallbacks, WaitTimeoutError, qos
from rosidl_py_gen.runtime.transport.api import NodesAnnounced
from rosidl_py_gen.runtime.transport.memory import MemoryReader

if TYPE_CHECKING:
    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

Range: Any = get_message("sensor_msgs/msg/Range", distro="jazzy")
HumbleRange: Any = get_message("sensor_msgs/msg/Range", distro="humble")
Event: Any = get_message("lifecycle_msgs/msg/TransitionEvent", distro="jazzy")
LyricalEvent: Any = get_message("lifecycle_msgs/msg/TransitionEvent", distro="lyrical")
LATCHED = qos.DEFAULT.keep_last(5).transient_local()
HUMBLE_RANGE_TEXT = f"""
{"=" * 80}
MSG: sensor_msgs/Range
std_msgs/Header header
uint8 radiation_type
float32 field_of_view
float32 min_range
float32 max_range
float32 range
"""
HUMBLE_ADVICE = 'set ROS_DISTRO=humble, or pass distro="humble" to get_message'
_numbers = itertools.count()


def two(kind: str, text: str) -> tuple[Any, Any]:
    """Return the classes of a type that uses Range, of Jazzy and of Humble."""
    name = f"sonar_msgs/{kind}/Sonar{next(_numbers)}"
    return compile_definition(name, text), compile_definition(name, text + HUMBLE_RANGE_TEXT)


def lyrical_event() -> Any:
    event = LyricalEvent()
    event.stamp.sec, event.stamp.nanosec = 1_700_000_000, 5
    event.transition.id, event.transition.label = 3, "activate"
    return event


# --- topics -----------------------------------------------------------------------------------------------------------


@pytest.mark.every_transport
async def test_message_of_lyrical_definition_is_dropped_and_logged(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    subscription = bob.create_subscription(Event, "events")
    lyrical, jazzy = alice.create_publisher(LyricalEvent, "events"), alice.create_publisher(Event, "events")
    # On Zenoh the hash is a part of the key, and such messages do not arrive.
    await until(lambda: subscription.publisher_count == (1 if world.kind == "zenoh" else 2))
    for number in range(3):
        lyrical.publish(lyrical_event())
        jazzy.publish(Event(timestamp=number))
    assert [(await subscription.receive(20)).timestamp for _ in range(3)] == [0, 1, 2]
    if world.kind != "zenoh":
        await until(lambda: subscription.latest() is None or subscription.incompatible_dropped == 3)
    assert (subscription.latest(), subscription.undecodable) == (Event(timestamp=2), 0)
    start = "no messages on /events from node /alice to node /bob: their definitions of lifecycle_msgs/msg/Transition"

    def warnings_of_bob() -> list[str]:
        records = [record for record in caplog.records if (record.name, record.levelname) == ("bob", "WARNING")]
        return [record.message for record in records if record.message.startswith(start)]

    await until(lambda: bool(warnings_of_bob()))  # as soon as the name of the node is known
    (warning,) = warnings_of_bob()
    assert warning == (
        f"{start}Event differ: {type_hash(LyricalEvent)} and {type_hash(Event)}. The definition of node /alice belongs "
        'to ROS 2 lyrical: set ROS_DISTRO=lyrical, or pass distro="lyrical" to get_message'
    )


@pytest.mark.parametrize("form", ["callback", "dict", "raw", "latest", "take"])
async def test_every_way_to_receive_skips_messages_of_another_definition(memory: World, form: str) -> None:
    alice, bob = memory.pair()
    received: list[Any] = []
    other, publisher = (alice.create_publisher(cls, "range") for cls in (HumbleRange, Range))
    options: dict[str, Any] = {"raw": True} if form == "raw" else {}
    source = "sensor_msgs/msg/Range" if form == "dict" else Range
    subscription = bob.create_subscription(source, "range", received.append if form == "callback" else None, **options)
    assert await publisher.wait_for_subscribers(20) and await other.wait_for_subscribers(5)
    expected = Range(range=2.5)
    publisher.publish(expected)
    other.publish(HumbleRange(range=1.5))
    if form == "callback":
        await until(lambda: subscription.incompatible_dropped == 1)
        assert received == [expected]
        return
    await until(lambda: len(reader_of(subscription).queue.items) == 2)
    got = {"latest": subscription.latest, "take": subscription.take}.get(form, lambda: None)()
    got = await subscription.receive(5) if got is None else got
    assert got == {"dict": to_dict(expected), "raw": expected.encode()}.get(form, expected)
    assert subscription.take() is None and subscription.incompatible_dropped == 1


async def test_warning_for_type_containing_a_changed_type_names_its_distribution(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two("msg", "sensor_msgs/Range[] all\nint32 number\n")
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(ours, "t", arrays=True), alice.create_publisher(theirs, "t")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish(theirs(all=[HumbleRange(range=1.0), HumbleRange(range=2.0)], number=7))
    with pytest.raises(WaitTimeoutError, match=r"node /alice has another definition of .*; dropped 1 message"):
        await subscription.receive(0.1)
    await until(lambda: f"The definition of node /alice belongs to ROS 2 humble: {HUMBLE_ADVICE}" in caplog.text)


@pytest.mark.parametrize(("mode", "is_received"), [("error", False), ("warn", False), ("off", True)])
async def test_type_hash_check_mode_selects_drop_or_delivery(
    memory: World, mode: Any, is_received: bool, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = memory.node("alice", type_hash_check="off"), memory.node("bob", context=memory.context())
    subscription = bob.create_subscription(Event, "t", type_hash_check=mode)
    publisher = alice.create_publisher(LyricalEvent, "t")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish(lyrical_event())
    if is_received:
        assert (await subscription.receive(5)).timestamp == (5 << 32) + 1_700_000_000
        assert "their definitions" not in caplog.text
        return
    with pytest.raises(WaitTimeoutError):
        await subscription.receive(0.1)
    assert subscription.incompatible_dropped == 1
    await until(lambda: "no messages on /t from node /alice to node /bob: their definitions of" in caplog.text)
    assert "delivered anyway" not in caplog.text


async def test_warning_between_nodes_of_one_context_states_that_messages_are_dropped(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    unknown: Any = compile_definition("sensor_msgs/msg/Range", f"int32 x{next(_numbers)}")
    node = memory.node("node", type_hash_check="warn")
    subscription, publisher = node.create_subscription(unknown, "t"), node.create_publisher(Range, "t")
    publisher.publish(Range())
    await until(lambda: "no messages on /t from node /node to node /node" in caplog.text)
    assert (subscription.take(), subscription.incompatible_dropped) == (None, 1)
    assert "The definition of node /node belongs to ROS 2" in caplog.text


@pytest.mark.every_transport
@pytest.mark.parametrize("mode", ["error", "warn"])
async def test_publishers_of_another_distribution_are_reported_as_incompatible(world: World, mode: Any) -> None:
    alice, bob = world.pair()
    types: list[Any] = []
    callbacks = SubscriptionEventCallbacks(incompatible_type=types.append)
    bob.create_subscription(Range, "t", event_callbacks=callbacks, type_hash_check=mode)
    alice.create_publisher(HumbleRange, "t")
    await until(lambda: bool(types))
    assert types[-1].total_count == 1 and types[-1].reason.startswith("their definitions of sensor_msgs/msg/Range")


PAIRS = [
    (name, our_hash, their_hash)
    for name, hashes in HASHES.items()
    for our_hash, their_hash in itertools.permutations(hashes, 2)
    if not name.startswith("rmw_dds_common/")  # of the transport
]


@pytest.mark.parametrize(("name", "our_hash", "their_hash"), PAIRS, ids=lambda one: one.rpartition("/")[2][:14])
def test_messages_between_all_pairs_of_distributions_are_dropped_and_named(
    memory: World, name: str, our_hash: str, their_hash: str
) -> None:
    ours, theirs = (get_message(name, distro=HASHES[name][text].split()[0]) for text in (our_hash, their_hash))
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(ours, "t"), alice.create_publisher(theirs, "t")
    publisher.publish(theirs())
    assert (subscription.take(), subscription.incompatible_dropped, subscription.undecodable) == (None, 1, 0)
    variants = type_loading.DistributionVariants.find(name, our_hash)
    assert variants is not None and " ".join(variants.with_hash(their_hash)) == HASHES[name][their_hash]


# --- writers without hash ---------------------------------------------------------------------------------------------


@pytest.mark.every_transport
@pytest.mark.without_zenoh
async def test_definition_of_writer_without_hash_is_detected_by_sample_size(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    subscription = bob.create_subscription(Range, "range")
    publisher = alice.create_publisher(without_hash(HumbleRange), "range")
    assert await publisher.wait_for_subscribers(20)
    for _ in range(2):
        publisher.publish_raw(HumbleRange(range=1.5).encode())
        with pytest.raises(WaitTimeoutError, match="node /alice announces no type hash, and its messages do not fit"):
            await subscription.receive(1)
        publisher.publish_raw(Range(range=1.5, variance=2.0).encode())
        assert await subscription.receive(5) == Range(range=1.5, variance=2.0)
    assert (subscription.incompatible_dropped, subscription.undecodable) == (2, 0)
    await until(lambda: "are dropped" in caplog.text)
    (record,) = [record for record in caplog.records if "are dropped" in record.message]
    assert (record.name, record.levelname) == ("bob", "WARNING")
    assert record.message == (
        "messages on /range from node /alice are dropped: it announces no type hash, and its messages do not fit the "
        f"definition of sensor_msgs/msg/Range in use here, but the definition of humble; {HUMBLE_ADVICE}"
    )


async def test_dropped_samples_without_hash_are_logged_once_for_each_participant(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    subscription = memory.node("reader").create_subscription(Range, "range")
    for name in ("alice", "bob"):
        publisher = memory.node(name, context=memory.context()).create_publisher(without_hash(Range), "range")
        assert await publisher.wait_for_subscribers(5)
        for _ in range(2):
            publisher.publish_raw(HumbleRange().encode())
    await until(lambda: subscription.take() is None and subscription.incompatible_dropped == 4)
    for name in ("alice", "bob"):
        await until(lambda name=name: f"messages on /range from node /{name} are dropped" in caplog.text)
    assert caplog.text.count("are dropped") == 2


async def test_sample_that_fits_no_definition_is_dropped_without_advice(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = memory.pair()
    subscription = bob.create_subscription(Range, "range")
    publisher = alice.create_publisher(without_hash(Range), "range")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish_raw(b"\0\1\0\0\7")
    publisher.publish_raw(Range(range=3.0).encode() + bytes(4))
    publisher.publish_raw(Range(range=3.0).encode())
    assert (await subscription.receive(5)).range == 3.0
    assert subscription.incompatible_dropped == 2
    await until(lambda: "do not fit the definition of sensor_msgs/msg/Range in use here" in caplog.text)
    assert "ROS_DISTRO" not in caplog.text


@pytest.mark.parametrize("mode", ["error", "warn"])
async def test_humble_participant_is_detected_by_its_graph_messages(
    dds: World, mode: Any, caplog: pytest.LogCaptureFixture
) -> None:
    alice = humble_node(dds, "alice")
    bob, carol = dds.node("bob", type_hash_check=mode), dds.node("carol", type_hash_check="off")
    # Its bytes have the size of both definitions.
    publisher = alice.create_publisher(without_hash(Event), "t")
    subscription, loose = bob.create_subscription(LyricalEvent, "t"), carol.create_subscription(LyricalEvent, "t")
    assert await publisher.wait_for_subscribers(5, count=2)
    await bob.wait_for_node("alice", 10)
    publisher.publish_raw(Event(timestamp=123 << 32).encode())
    assert (await loose.receive(20)).stamp.nanosec == 123
    await until(lambda: subscription.take() is None and subscription.incompatible_dropped == 1)
    await until(lambda: "messages on /t from node /alice are dropped" in caplog.text)
    (record,) = [record for record in caplog.records if "are dropped" in record.message]
    assert record.message == (
        "messages on /t from node /alice are dropped: it announces no type hash, and it is of ROS 2 Humble, whose "
        f"definition of lifecycle_msgs/msg/TransitionEvent is another one; {HUMBLE_ADVICE}"
    )
    assert bob.context.participants()
    await until(lambda: caplog.text.count("a node of ROS 2 Humble is in this domain") == 2)  # bob's and carol's


async def test_humble_writer_with_same_definition_is_examined_only_once(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = humble_node(dds, "alice").create_publisher(without_hash(Event), "t")
    bob = dds.node("bob")
    subscription = bob.create_subscription(Event, "t")
    assert await publisher.wait_for_subscribers(20)
    await bob.wait_for_node("alice", 10)
    publisher.publish_raw(Event(timestamp=1).encode())
    assert (await subscription.receive(20)).timestamp == 1
    monkeypatch.setattr(type(graph_of(bob)), "is_humble", lambda *_: pytest.fail("examined again"))
    publisher.publish_raw(Event(timestamp=2).encode())
    assert (await subscription.receive(20)).timestamp == 2


async def test_ros_participant_without_node_names_is_treated_as_humble(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    alice, bob = memory.pair()
    monkeypatch.setattr(graph_of(bob), "is_humble", lambda guid: None)
    events, ranges = bob.create_subscription(LyricalEvent, "events"), bob.create_subscription(Range, "ranges")
    event = alice.create_publisher(without_hash(Event), "events")
    distance = alice.create_publisher(without_hash(Range), "ranges")
    assert await event.wait_for_subscribers(20) and await distance.wait_for_subscribers(5)
    for is_ros in (True, False):
        monkeypatch.setattr(graph_of(bob), "is_ros", lambda guid, is_ros=is_ros: is_ros)
        event.publish_raw(Event(timestamp=1).encode())
        await until(lambda: len(reader_of(events).queue.items) == 1)
        # All that is known of a program without ROS is the size.
        assert (events.take() is None) is is_ros
        distance.publish_raw(Range(range=2.0).encode())
        assert (await ranges.receive(5)).range == 2.0
    assert (events.incompatible_dropped, ranges.incompatible_dropped) == (1, 0)


async def test_new_definition_published_by_humble_node_is_dropped(memory: World) -> None:
    """A bag of a newer distribution is played on Humble."""
    reader, peer = memory.node("reader"), memory.node("peer", context=memory.context())
    subscription = reader.create_subscription(Range, "played")
    hashless = without_hash(Range)
    publisher = peer.create_publisher(hashless, "played")
    await publisher.wait_for_subscribers(10)
    await until(lambda: subscription.publisher_count == 1)
    for participant in graph_of(reader).participants():
        participant_of(reader).endpoint_index.apply([NodesAnnounced(participant.guid, (), is_humble=True)])
    publisher.publish(hashless(range=1.0, variance=9.0))
    with pytest.raises(WaitTimeoutError, match="announces no type hash, and it is of ROS 2 Humble"):
        await subscription.receive(timeout_s=0.5)
    assert subscription.incompatible_dropped == 1


async def test_unreadable_definitions_of_other_distributions_are_logged(
    memory: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> None:
        raise DefinitionError.__new__(DefinitionError)

    monkeypatch.setattr(type_loading, "DistributionVariants", fail)
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(Range, "t"), alice.create_publisher(without_hash(Range), "t")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish_raw(Range(range=3.0).encode())
    assert (await subscription.receive(5)).range == 3.0
    assert "the definitions of sensor_msgs/msg/Range of other distributions cannot be read" in caplog.text


# --- services and actions ---------------------------------------------------------------------------------------------


@pytest.mark.every_transport
@pytest.mark.parametrize("mode", ["error", "warn"])
async def test_client_does_not_call_server_of_another_definition(
    world: World, mode: Any, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two("srv", "sensor_msgs/Range seen\n---\nsensor_msgs/Range seen\n")
    alice, bob = world.pair()
    requests: list[Any] = []
    alice.create_service(theirs, "s", requests.append)
    client = bob.create_client(ours, "s", type_hash_check=mode)
    await until(lambda: bool(bob.count_services("s")))
    with pytest.raises(CallTimeoutError, match="node /alice has another definition of its type"):
        await client.call(ours.Request(), 0.3)
    assert requests == []
    advice = 'belongs to ROS 2 humble: set ROS_DISTRO=humble, or pass distro="humble" to get_service'
    await until(lambda: advice in caplog.text)


async def test_goals_are_not_sent_to_action_server_of_another_definition(memory: World) -> None:
    ours, theirs = two("action", "sensor_msgs/Range goal\n---\nsensor_msgs/Range end\n---\nsensor_msgs/Range now\n")
    alice, bob = memory.pair()
    goals: list[Any] = []
    alice.create_action_server(theirs, "act", goals.append)
    client = bob.create_action_client(ours, "act")
    await until(lambda: bool(bob.count_services("act/_action/send_goal")))
    with pytest.raises(TimeoutError, match="node /alice has another definition of its type"):
        await client.send_goal(ours.Goal(), timeout_s=0.3)
    assert goals == []


async def test_server_drops_requests_without_hash_that_do_not_fit_its_definition(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two("srv", "sensor_msgs/Range seen\n---\nint32 a\n")
    alice, bob = memory.pair()
    requests: list[Any] = []
    server = alice.create_service(ours, "s", lambda request: requests.append(request) or ours.Response(a=1))
    of_humble, of_jazzy = service_without_hash(theirs), service_without_hash(ours)
    old, new = (bob.create_client(cls, "s", type_hash_check="off") for cls in (of_humble, of_jazzy))
    assert await old.wait_for_service(20) and await new.wait_for_service(5)
    with pytest.raises(CallTimeoutError):
        await old.call(of_humble.Request(seen=HumbleRange(range=3.0)), 0.3)
    assert (requests, server.incompatible_dropped) == ([], 1)
    assert (await new.call(of_jazzy.Request(seen=Range(range=2.0)), 5)).a == 1
    assert requests == [ours.Request(seen=Range(range=2.0))]
    await until(lambda: "messages on /s from node /bob are dropped: it announces no type hash" in caplog.text)
    assert 'set ROS_DISTRO=humble, or pass distro="humble" to get_service' in caplog.text


async def test_client_drops_responses_without_hash_that_do_not_fit_its_definition(memory: World) -> None:
    ours, theirs = two("srv", "int32 a\n---\nsensor_msgs/Range seen\n")
    alice, bob = memory.pair()
    of_humble = service_without_hash(theirs)
    alice.create_service(of_humble, "s", lambda request: of_humble.Response(), type_hash_check="off")
    client = bob.create_client(ours, "s")
    assert await client.wait_for_service(5)
    with pytest.raises(CallTimeoutError, match=r"no response from /s .*: node /alice announces no type hash, and its"):
        await client.call(ours.Request(), 0.3)
    assert client.incompatible_dropped == 1


def service_without_hash(cls: Any) -> Any:
    """Return a service that a client of Humble would have: it announces no hashes."""
    members = {"__slots__": (), "Request": without_hash(cls.Request), "Response": without_hash(cls.Response)}
    return type("NoHash", (without_hash(cls),), members)


# --- closed writers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_known", [True, False], ids=["of a distribution", "unknown"])
async def test_sample_of_another_definition_is_dropped_after_its_writer_closed(memory: World, is_known: bool) -> None:
    ours, theirs = Range, HumbleRange
    if not is_known:
        name = f"sonar_msgs/msg/Numbers{next(_numbers)}"
        ours, theirs = compile_definition(name, "int32 a\n"), compile_definition(name, "float32 a\n")
    subscription = memory.node("reader").create_subscription(ours, "left", qos=LATCHED)
    node = memory.node("peer", context=memory.context())
    publisher = node.create_publisher(theirs, "left", qos=LATCHED)
    await publisher.wait_for_subscribers(10)
    await until(lambda: subscription.publisher_count == 1)
    publisher.publish(theirs())
    node.context.close()
    await until(lambda: subscription.publisher_count == 0)
    assert (subscription.take(), subscription.incompatible_dropped) == (None, 1)


async def test_sample_of_unknown_writer_is_dropped_unless_it_fits_the_definition(
    memory: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(MemoryReader, "writer_guid", lambda self, handle: None)
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(Range, "t"), alice.create_publisher(Range, "t")
    assert await publisher.wait_for_subscribers(5)
    for data in (HumbleRange(range=1.0).encode(), Range(range=2.0).encode(), HumbleRange(range=3.0).encode()):
        publisher.publish_raw(data)
    assert (await subscription.receive(5)).range == 2.0
    assert (subscription.take(), subscription.incompatible_dropped) == (None, 2)
    assert caplog.text.count("messages on /t from an unknown node are dropped: they do not fit the definition of") == 1


async def test_unlogged_drop_is_logged_when_context_closes(memory: World, caplog: pytest.LogCaptureFixture) -> None:
    reader, peer = memory.node("reader", context=memory.context()), memory.node("peer", context=memory.context())
    subscription, publisher = reader.create_subscription(Range, "t"), peer.create_publisher(without_hash(Range), "t")
    assert await publisher.wait_for_subscribers(5)
    for participant in graph_of(reader).participants():
        participant_of(reader).endpoint_index.set_nodes(participant.guid, ())  # their names may arrive seconds later
    publisher.publish_raw(HumbleRange(range=1.0).encode())
    await until(lambda: subscription.take() is None and subscription.incompatible_dropped == 1)
    assert "are dropped" not in caplog.text
    reader.context.close()
    assert "messages on /t from an unknown node are dropped" in caplog.text
