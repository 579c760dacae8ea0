"""Peers of another ROS distribution with another definition of a type: messages are converted, never misread."""

from __future__ import annotations

import asyncio
import itertools
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.announced_types import humble_node, without_hash
from support.changed_definitions import changed_worlds
from support.definition_strategies import numbers, texts
from support.example_counts import examples
from support.node_fixtures import World, until, zenoh_environment

from rosidl_py_gen import compile_definition, get_message, to_dict, type_hash
from rosidl_py_gen.base.descriptions import individual_descriptions
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.errors import DefinitionError, EncodeError
from rosidl_py_gen.msgs.distribution_hashes import HASHES
from rosidl_py_gen.runtime import CallTimeoutError, SubscriptionEventCallbacks, WaitTimeoutError, qos
from rosidl_py_gen.runtime.transport.api import NodesAnnounced
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader
from rosidl_py_gen.type_loading import peer_definitions
from rosidl_py_gen.type_loading.peer_definitions import PeerDefinition, converter_from

if TYPE_CHECKING:
    from support.reference_cdr import Reference

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
_numbers = itertools.count()


def two(kind: str, text: str) -> tuple[Any, Any]:
    """Return the classes of a type that uses Range, of Jazzy and of Humble."""
    name = f"sonar_msgs/{kind}/Sonar{next(_numbers)}"
    return compile_definition(name, text), compile_definition(name, text + HUMBLE_RANGE_TEXT)


def lyrical_event() -> Any:
    event = LyricalEvent()
    event.stamp.sec, event.stamp.nanosec = 1_700_000_000, 5
    event.transition.id, event.transition.label = 3, "activate"
    event.goal_state.label = "active"
    return event


async def reach(subscription: Any, publisher: Any, message: Any) -> None:
    """Send a message until one arrives; Zenoh loses the first ones while the other key is new. None is left."""
    publisher.publish(message)
    while subscription.take() is None:
        await asyncio.sleep(0.05)
        publisher.publish(message)
    await asyncio.sleep(0.1)
    while subscription.take() is not None:
        pass


def expect_event(event: Any) -> None:
    assert (event.timestamp, event.transition.id, event.transition.label) == (0, 3, "activate")
    assert (event.start_state.label, event.goal_state.label) == ("", "active")


# --- topics -----------------------------------------------------------------------------------------------------------


@pytest.mark.every_transport
async def test_an_event_of_lyrical_is_not_misread(world: World, caplog: pytest.LogCaptureFixture) -> None:
    alice, bob = world.pair()
    subscription = bob.create_subscription(Event, "events")
    publisher = alice.create_publisher(LyricalEvent, "events")
    await until(lambda: subscription.publisher_count == 1)
    await reach(subscription, publisher, lyrical_event())
    before = subscription.converted
    for _ in range(3):
        publisher.publish(lyrical_event())
    for _ in range(3):
        expect_event(await subscription.receive(5))
    assert (subscription.converted, subscription.incompatible_dropped, subscription.undecodable) == (before + 3, 0, 0)
    await until(lambda: "are converted" in caplog.text)  # as soon as the name of the node is known
    records = [record for record in caplog.records if "are converted" in record.message]
    assert [(record.name, record.levelname) for record in records] == [("bob", "WARNING")]
    said = records[0].message
    assert said.startswith("messages on /events from node /alice are converted: its definition of lifecycle_msgs/msg/")
    assert f"TransitionEvent is that of lyrical, {type_hash(LyricalEvent)}; here it is {type_hash(Event)}; " in said
    assert said.endswith(
        "; dropped: lifecycle_msgs/msg/TransitionEvent.stamp; "
        "set to the default: lifecycle_msgs/msg/TransitionEvent.timestamp"
    )


@pytest.mark.every_transport
async def test_writers_of_both_definitions_are_read_side_by_side(world: World) -> None:
    alice, bob = world.pair()
    subscription = bob.create_subscription(Range, "range")
    old, new = alice.create_publisher(HumbleRange, "range"), alice.create_publisher(Range, "range")
    await until(lambda: subscription.publisher_count == 2)
    await reach(subscription, old, HumbleRange())
    await reach(subscription, new, Range())
    before = subscription.converted
    for number in range(3):
        old.publish(HumbleRange(range=number))
        assert await subscription.receive(5) == Range(range=number)
        new.publish(Range(range=number, variance=4.0))
        assert await subscription.receive(5) == Range(range=number, variance=4.0)
    assert subscription.converted == before + 3


@pytest.mark.every_transport
async def test_a_late_subscription_gets_what_was_latched(world: World) -> None:
    alice, bob = world.pair()
    publisher = alice.create_publisher(HumbleRange, "range", LATCHED)
    publisher.publish(HumbleRange(max_range=2.5))
    await until(lambda: bob.count_publishers("range") == 1)
    subscription = bob.create_subscription(Range, "range", qos=LATCHED)
    assert (await subscription.receive(10)).max_range == 2.5


@pytest.mark.parametrize("form", ["callback", "dict", "raw", "latest", "take"])
async def test_every_way_to_read_gets_the_own_definition(memory: World, form: str) -> None:
    alice, bob = memory.pair()
    publisher, received = alice.create_publisher(HumbleRange, "range"), list[Any]()
    options: dict[str, Any] = {"raw": True} if form == "raw" else {}
    source = "sensor_msgs/msg/Range" if form == "dict" else Range
    subscription = bob.create_subscription(source, "range", received.append if form == "callback" else None, **options)
    assert await publisher.wait_for_subscribers(5)
    publisher.publish(HumbleRange(range=1.5))
    expected = Range(range=1.5)
    if form == "callback":
        await until(lambda: received == [expected])
        return
    await until(lambda: subscription._items)
    got = {"latest": subscription.latest, "take": subscription.take}.get(form, lambda: None)()
    got = await subscription.receive(5) if got is None else got
    assert got == {"dict": to_dict(expected), "raw": expected.encode()}.get(form, expected)


async def test_a_type_that_contains_the_changed_one_is_known_as_well(memory: World) -> None:
    ours, theirs = two("msg", "sensor_msgs/Range[] all\nint32 number\n")
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(ours, "t", arrays=True), alice.create_publisher(theirs, "t")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish(theirs(all=[HumbleRange(range=1.0), HumbleRange(range=2.0)], number=7))
    got = await subscription.receive(5)
    assert ([one.range for one in got.all], [one.variance for one in got.all], got.number) == ([1, 2], [0, 0], 7)


@pytest.mark.parametrize(("mode", "is_received"), [("error", False), ("warn", True), ("convert", True)])
async def test_the_mode_decides(memory: World, mode: Any, is_received: bool, caplog: pytest.LogCaptureFixture) -> None:
    alice, bob = memory.pair()
    subscription = bob.create_subscription(Event, "t", type_hash_check=mode)
    publisher = alice.create_publisher(LyricalEvent, "t")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish(lyrical_event())
    if is_received:
        expect_event(await subscription.receive(5))
        return
    with pytest.raises(WaitTimeoutError):
        await subscription.receive(0.1)
    assert (subscription.incompatible_dropped, subscription.converted) == (1, 0)
    await until(lambda: "no messages on /t from node /alice to node /bob: their definitions of" in caplog.text)
    assert "are converted" not in caplog.text


@pytest.mark.every_transport
@pytest.mark.parametrize(("mode", "is_reported"), [("error", True), ("convert", False), ("warn", False)])
async def test_publishers_whose_messages_are_converted_are_not_reported_as_incompatible(
    world: World, mode: Any, is_reported: bool
) -> None:
    alice, bob = world.pair()
    types: list[Any] = []
    callbacks = SubscriptionEventCallbacks(incompatible_type=types.append)
    bob.create_subscription(Range, "t", event_callbacks=callbacks, type_hash_check=mode)
    alice.create_publisher(HumbleRange, "t")
    await until(lambda: bob.count_publishers("t") == 1)
    alice.create_publisher(Event, "t")
    await until(lambda: bool(types) and types[-1].total_count == 1 + is_reported)
    await asyncio.sleep(0.2)
    assert types[-1].total_count == 1 + is_reported and types[-1].reason.startswith("types differ")


async def test_bytes_that_the_peers_definition_does_not_have_are_counted(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(Range, "t"), alice.create_publisher(HumbleRange, "t")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish_raw(b"\0\1\0\0\7")
    publisher.publish(HumbleRange(range=3))
    assert (await subscription.receive(5)).range == 3
    assert subscription.undecodable == 1
    assert "dropped a sample on /t that is not a sensor_msgs/msg/Range (1 so far): sensor_msgs/msg/Range.header" in (
        caplog.text
    )


def test_a_definition_that_cannot_be_converted_is_refused_by_name(
    memory: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = known_pair(monkeypatch, "string x\nint32 y", "int32 x\nint32 y")
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(ours, "t"), alice.create_publisher(theirs, "t")
    publisher.publish(theirs(x=1, y=2))
    assert subscription.take() is None and subscription.incompatible_dropped == 1
    name = ours._TYPE.name
    assert (
        f"messages of the definition of {name} of humble cannot be converted: {name}.x: int32 cannot become string"
        in (caplog.text)
    )
    assert "rule" not in caplog.text


def known_pair(monkeypatch: pytest.MonkeyPatch, ours: str, theirs: str) -> tuple[Any, Any]:
    """Return two classes of a type; the second is known as the definition of a distribution."""
    name = f"known_msgs/msg/Known{next(_numbers)}"
    own, other = compile_definition(name, ours), compile_definition(name, theirs)
    individuals = individual_descriptions(type_description(other))
    definition = PeerDefinition(name, type_hash(other), ("humble",), individuals)
    monkeypatch.setitem(peer_definitions._by_hash, (name, type_hash(own)), {type_hash(other): definition})
    return own, other


# --- writers without hash ---------------------------------------------------------------------------------------------


@pytest.mark.every_transport
@pytest.mark.without_zenoh
async def test_a_range_of_humble_without_hash_is_known_by_its_size(world: World) -> None:
    alice, bob = world.pair()
    subscription = bob.create_subscription(Range, "range")
    publisher = alice.create_publisher(without_hash(HumbleRange), "range")
    assert await publisher.wait_for_subscribers(5)
    publisher.publish_raw(HumbleRange(range=1.5).encode())
    assert await subscription.receive(5) == Range(range=1.5)
    publisher.publish_raw(Range(range=1.5, variance=2.0).encode())  # not of Humble
    assert await subscription.receive(5) == Range(range=1.5, variance=2.0)


async def test_a_participant_of_humble_is_known_by_its_graph_messages(
    dds: World, caplog: pytest.LogCaptureFixture
) -> None:
    alice = humble_node(dds, "alice")
    bob, carol = dds.node("bob"), dds.node("carol", type_hash_check="error")
    # Its bytes have the size of both definitions.
    publisher = alice.create_publisher(without_hash(Event), "t")
    subscription, strict = bob.create_subscription(LyricalEvent, "t"), carol.create_subscription(LyricalEvent, "t")
    assert await publisher.wait_for_subscribers(5, count=2)
    await bob.wait_for_node("alice", 10)
    publisher.publish_raw(Event(timestamp=123 << 32).encode())
    assert await subscription.receive(5) == LyricalEvent()
    assert (await strict.receive(5)).stamp.nanosec == 123, "as before"
    assert bob.context.participants()
    await until(lambda: caplog.text.count("a node of ROS 2 Humble is in this domain") == 2)  # bob's and carol's


async def test_a_writer_of_humble_with_the_definition_of_the_reader_is_examined_once(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    publisher = humble_node(dds, "alice").create_publisher(without_hash(Event), "t")
    bob = dds.node("bob")
    subscription = bob.create_subscription(Event, "t")
    assert await publisher.wait_for_subscribers(5)
    await bob.wait_for_node("alice", 10)
    publisher.publish_raw(Event(timestamp=1).encode())
    assert (await subscription.receive(5)).timestamp == 1
    monkeypatch.setattr(type(bob._scope.graph), "is_humble", lambda *_: pytest.fail("examined again"))
    publisher.publish_raw(Event(timestamp=2).encode())
    assert (await subscription.receive(5)).timestamp == 2
    assert not subscription.converted


# --- services and actions ---------------------------------------------------------------------------------------------


@pytest.mark.every_transport
@pytest.mark.parametrize("mode", ["convert", "warn"])
async def test_a_server_with_the_definition_of_another_distribution_is_not_called(world: World, mode: Any) -> None:
    ours, theirs = two("srv", "sensor_msgs/Range seen\n---\nsensor_msgs/Range seen\n")
    alice, bob = world.pair()
    requests: list[Any] = []
    alice.create_service(theirs, "s", requests.append)
    client = bob.create_client(ours, "s", type_hash_check=mode)
    await until(lambda: bool(bob.count_services("s")))
    with pytest.raises(CallTimeoutError, match="node /alice has another definition of its type"):
        await client.call(ours.Request(), 0.3)
    assert requests == []


async def test_goals_are_not_sent_to_a_server_with_the_definition_of_another_distribution(memory: World) -> None:
    ours, theirs = two("action", "sensor_msgs/Range goal\n---\nsensor_msgs/Range end\n---\nsensor_msgs/Range now\n")
    alice, bob = memory.pair()
    goals: list[Any] = []
    alice.create_action_server(theirs, "act", goals.append)
    client = bob.create_action_client(ours, "act")
    await until(lambda: bool(bob.count_services("act/_action/send_goal")))
    with pytest.raises(TimeoutError, match="node /alice has another definition of its type"):
        await client.send_goal(ours.Goal(), timeout_s=0.3)
    assert goals == []


async def test_a_server_drops_requests_without_hash_that_do_not_fit_its_definition(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    ours, theirs = two("srv", "sensor_msgs/Range seen\n---\nint32 a\n")
    alice, bob = memory.pair()
    requests: list[Any] = []
    server = alice.create_service(ours, "s", lambda request: requests.append(request) or ours.Response(a=1))
    of_humble, of_jazzy = service_without_hash(theirs), service_without_hash(ours)
    old, new = (bob.create_client(cls, "s", type_hash_check="off") for cls in (of_humble, of_jazzy))
    assert await old.wait_for_service(5) and await new.wait_for_service(5)
    with pytest.raises(CallTimeoutError):
        await old.call(of_humble.Request(seen=HumbleRange(range=3.0)), 0.3)
    assert (requests, server.incompatible_dropped) == ([], 1)
    assert (await new.call(of_jazzy.Request(seen=Range(range=2.0)), 5)).a == 1
    assert requests == [ours.Request(seen=Range(range=2.0))]
    await until(lambda: "messages on /s from node /bob are dropped: it announces no type hash" in caplog.text)
    assert 'set ROS_DISTRO=humble, or pass distro="humble" to get_message' in caplog.text


def service_without_hash(cls: Any) -> Any:
    """Return a service that a client of Humble would have: it announces no hashes."""
    members = {"__slots__": (), "Request": without_hash(cls.Request), "Response": without_hash(cls.Response)}
    return type("NoHash", (without_hash(cls),), members)


# --- properties -------------------------------------------------------------------------------------------------------

PAIRS = [
    (name, our_hash, their_hash)
    for name, hashes in HASHES.items()
    for our_hash, their_hash in itertools.permutations(hashes, 2)
    if not name.startswith("rmw_dds_common/")  # of the transport
]


def by_hash(name: str, wanted: str) -> Any:
    return get_message(name, distro=HASHES[name][wanted].split()[0])


def messages(cls: Any) -> st.SearchStrategy[Any]:
    """Return a strategy for messages without arrays."""
    fields = {}
    for field in cls._TYPE.fields:
        assert field.type.arity is Arity.SCALAR
        if field.cls is not None:
            fields[field.py_name] = messages(field.cls)
        elif field.type.is_string:
            fields[field.py_name] = texts().filter(lambda text: "\0" not in text)
        else:
            fields[field.py_name] = numbers(field.type.base)
    return st.builds(cls, **fields)


def expect_converted(got: dict[str, Any], sent: dict[str, Any], default: dict[str, Any]) -> None:
    """Check that common fields have the value that was sent, and the others their default."""
    for name, value in got.items():
        if name not in sent:
            assert repr(value) == repr(default[name])
        elif isinstance(value, dict):
            expect_converted(value, sent[name], default[name])
        else:
            assert repr(value) == repr(sent[name])


@pytest.mark.parametrize(("name", "our_hash", "their_hash"), PAIRS, ids=lambda one: one.rpartition("/")[2][:14])
def test_all_values_of_each_pair_of_distributions_arrive(
    memory: World, name: str, our_hash: str, their_hash: str
) -> None:
    ours, theirs = by_hash(name, our_hash), by_hash(name, their_hash)
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(ours, "t"), alice.create_publisher(theirs, "t")

    @settings(max_examples=examples(60), deadline=None)
    @given(messages(theirs))
    def check(sent: Any) -> None:
        publisher.publish(sent)
        expect_converted(to_dict(subscription.take()), to_dict(sent), to_dict(ours()))

    check()
    assert subscription.converted and not subscription.undecodable


@settings(max_examples=examples(100), deadline=None)
@given(changed_worlds())
def test_a_random_change_of_a_random_definition_is_delivered_right_or_refused(
    case: tuple[Any, Any, Reference, dict[str, Any]],
) -> None:
    old_world, new_world, reference, value = case
    old = old_world.compile()
    try:
        new = new_world.compile()
    except DefinitionError:
        assume(False)
    assume(type_hash(old) != type_hash(new))
    message, name = reference.build(old, value), old_world.top
    definition = PeerDefinition(name, type_hash(old), ("humble",), individual_descriptions(type_description(old)))
    known = {type_hash(old): definition}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(peer_definitions._by_hash, (name, type_hash(new)), known)
        world = World("memory")
        try:
            alice, bob = world.pair()
            subscription, publisher = bob.create_subscription(new, "t"), alice.create_publisher(old, "t")
            publisher.publish(message)
            got = subscription.take()
            counted = subscription.incompatible_dropped, subscription.undecodable
        finally:
            world.close()
    if got is None:
        assert sum(counted) == 1
        with pytest.raises((peer_definitions.UnconvertibleDefinitionError, EncodeError)):
            converter_from(definition, new).convert(message).encode()
        return
    assert counted == (0, 0)
    received, sent, otherwise = to_dict(got), to_dict(message), to_dict(new())
    old_types = {field.ros_name: field.type for field in old._TYPE.fields}
    for field in new._TYPE.fields:
        if field.ros_name not in sent:
            assert repr(received[field.ros_name]) == repr(otherwise[field.ros_name])
        elif field.cls is None and field.type == old_types[field.ros_name]:
            assert repr(received[field.ros_name]) == repr(sent[field.ros_name])


async def test_a_conversion_is_logged_at_the_latest_when_the_context_closes(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    reader, peer = memory.node("reader", context=memory.context()), memory.node("peer", context=memory.context())
    subscription, publisher = reader.create_subscription(Range, "t"), peer.create_publisher(HumbleRange, "t")
    assert await publisher.wait_for_subscribers(5)
    for participant in reader._scope.graph.participants():
        reader._scope.graph.set_nodes(participant.guid, ())  # their names may arrive seconds later
    publisher.publish(HumbleRange(range=1.0))
    assert (await subscription.receive(5)).range == 1.0
    assert "are converted" not in caplog.text
    reader.context.close()
    assert "messages on /t from an unknown node are converted" in caplog.text


# -------------------------------------------------------------------------------------------- writers that have left


async def take_after_the_peer_left(world: World, ours: Any, theirs: Any, message: Any) -> tuple[Any, Any]:
    subscription = world.node("reader").create_subscription(ours, "left", qos=LATCHED)
    node = world.node("peer", context=world.context())
    publisher = node.create_publisher(theirs, "left", qos=LATCHED)
    await publisher.wait_for_subscribers(10)
    await until(lambda: subscription.publisher_count == 1)
    publisher.publish(message)
    context = node.context
    node.close()
    context.close()
    await until(lambda: subscription.publisher_count == 0)
    return subscription, subscription.take()


async def test_a_converted_sample_of_a_writer_that_left_is_logged(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    subscription, message = await take_after_the_peer_left(memory, Range, HumbleRange, HumbleRange(range=4.0))
    assert (message.range, message.variance, subscription.converted) == (4.0, 0.0, 1)
    await until(lambda: "messages on /left" in caplog.text and "converted" in caplog.text)


async def test_a_sample_of_an_unknown_definition_is_dropped_after_its_writer_left(memory: World) -> None:
    name = f"sonar_msgs/msg/Numbers{next(_numbers)}"
    ours, theirs = compile_definition(name, "int32 a\n"), compile_definition(name, "float32 a\n")
    subscription, message = await take_after_the_peer_left(memory, ours, theirs, theirs(a=1.0))
    assert (message, subscription.incompatible_dropped) == (None, 1)


async def test_bytes_of_the_new_definition_from_a_node_of_humble_keep_their_values(memory: World) -> None:
    """A bag of a newer distribution is played on Humble."""
    reader, peer = memory.node("reader"), memory.node("peer", context=memory.context())
    subscription = reader.create_subscription(Range, "played")
    hashless = without_hash(Range)
    publisher = peer.create_publisher(hashless, "played")
    await publisher.wait_for_subscribers(10)
    await until(lambda: subscription.publisher_count == 1)
    for participant in reader._scope.graph.participants():
        reader._scope.graph.apply(NodesAnnounced(participant.guid, (), is_humble=True))
    publisher.publish(hashless(range=1.0, variance=9.0))
    message = await subscription.receive(timeout_s=10)
    assert (message.range, message.variance) == (1.0, 9.0)


async def test_a_sample_on_the_key_of_another_definition_is_converted_without_its_writer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On Zenoh a token may disappear before the last samples of its writer are taken, and the key tells the hash."""
    for key, value in zenoh_environment().items():
        monkeypatch.setenv(key, value)
    monkeypatch.setattr(ZenohReader, "writer_guid", lambda self, handle: bytes(16))
    world = World("zenoh")
    try:
        alice, bob = world.pair()
        subscription, publisher = bob.create_subscription(Range, "t"), alice.create_publisher(HumbleRange, "t")
        same = alice.create_publisher(Range, "t")
        await reach(subscription, publisher, HumbleRange())
        reader, received = subscription._reader, list[Any]()
        for sender, message in ((publisher, HumbleRange(range=1.0)), (same, Range(range=2.0, variance=3.0))):
            sender.publish(message)
            await until(lambda: bool(subscription._items))
            received.append(subscription._items[-1])
            subscription._items.clear()
        hashes = [reader.type_hash_of(sample[2]) for sample in received]
        assert hashes == [type_hash(HumbleRange), ""]
        subscription._items.extend(received)
        assert [subscription.take(), subscription.take()] == [Range(range=1.0), Range(range=2.0, variance=3.0)]
    finally:
        world.close()
