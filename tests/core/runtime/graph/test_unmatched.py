"""Errors of waits that time out state why an endpoint has no peer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from geometry_msgs.msg import Point
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger
from support.inner_state import participant_of
from support.waiting import until

from rosidl_py_gen import compile_definition, get_action
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.runtime import ActionTimeoutError, CallTimeoutError, QoSProfile, WaitTimeoutError
from rosidl_py_gen.runtime.qos import BEST_AVAILABLE, DEFAULT, SENSOR_DATA
from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
from rosidl_py_gen.runtime.transport.qos import check_compatible, find_preset, resolve_best_available

if TYPE_CHECKING:
    from collections.abc import Awaitable

    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

TIMEOUT_S = 0.3


async def why(wait: Awaitable[Any]) -> str:
    with pytest.raises((WaitTimeoutError, CallTimeoutError, ActionTimeoutError)) as raised:
        await wait
    return str(raised.value)


@pytest.mark.every_transport
async def test_wait_timeout_names_peers_of_another_type_or_similar_names(world: World) -> None:
    alice, bob = world.pair()
    alice.create_publisher(String, "typed")
    alice.create_publisher(String, "r1/scan")
    alice.create_subscription(String, "r1/cmd")
    alice.create_service(Trigger, "add", lambda request: Trigger.Response())
    alice.create_service(Trigger, "r1/reset", lambda request: Trigger.Response())
    await until(lambda: bob.count_publishers("/r1/scan") and bob.count_services("/r1/reset"))
    await until(lambda: bob.count_publishers("typed") and bob.count_services("add") and bob.count_subscribers("r1/cmd"))
    typed = bob.create_subscription(Int32, "typed")
    for wait in (typed.wait_for_publishers(TIMEOUT_S), typed.receive(TIMEOUT_S)):
        assert "s: node /alice has another type, std_msgs/msg/String" in await why(wait)
    assert (await why(bob.create_subscription(String, "scan").receive(TIMEOUT_S))).endswith(
        's: no node publishes it; did you mean "/r1/scan"?'
    )
    assert 'no node subscribes to it; did you mean "/r1/cmd"?' in await why(
        bob.create_publisher(String, "cmd").wait_for_subscribers(TIMEOUT_S)
    )
    add = bob.create_client(AddTwoInts, "add")
    for wait in (add.wait_for_service(TIMEOUT_S), add.call(AddTwoInts.Request(), TIMEOUT_S)):
        assert "s: node /alice has another type, std_srvs/srv/Trigger" in await why(wait)
    assert 'no node serves it; did you mean "/r1/reset"?' in await why(
        bob.create_client(Trigger, "reset").wait_for_service(TIMEOUT_S)
    )
    assert (await why(bob.create_subscription(String, "unheard_of").receive(TIMEOUT_S))).endswith(
        "s: no node publishes it"
    )


@pytest.mark.every_transport
async def test_wait_timeout_names_the_incompatible_qos_policy_and_a_preset(world: World) -> None:
    if world.kind == "zenoh":
        pytest.skip("every quality of service matches on Zenoh")
    alice, bob = world.pair()
    for mine, theirs, reason in (
        (DEFAULT, SENSOR_DATA, "reliability BEST_EFFORT, here RELIABLE; use the preset SENSOR_DATA"),
        (DEFAULT.transient_local(), DEFAULT, "durability VOLATILE, here TRANSIENT_LOCAL; use the preset DEFAULT"),
        (DEFAULT.deadline(0.5), DEFAULT, "deadline none, here 0.5 s; use the preset DEFAULT"),
        (
            DEFAULT.manual_liveliness(2),
            DEFAULT.automatic_liveliness(3),
            "liveliness AUTOMATIC, here MANUAL_BY_TOPIC; liveliness lease 3 s, here 2 s; use the preset DEFAULT",
        ),
    ):
        publisher = alice.create_publisher(String, "chatter", theirs)
        await until(lambda: bob.count_publishers("chatter") == 1)
        subscription = bob.create_subscription(String, "chatter", qos=mine)
        for wait in (subscription.receive(TIMEOUT_S), subscription.wait_for_publishers(TIMEOUT_S)):
            assert (await why(wait)).endswith(f"s: node /alice offers incompatible QoS: {reason}")
        await until(lambda: alice.count_subscribers("chatter") == 1)
        assert "node /bob requests incompatible QoS: " in await why(publisher.wait_for_subscribers(TIMEOUT_S))
        publisher.close()
        subscription.close()
        await until(lambda: bob.count_publishers("chatter") == 0 == alice.count_subscribers("chatter"))


@pytest.mark.every_transport
async def test_receive_timeout_states_definition_mismatch_or_silent_publisher(world: World) -> None:
    old, new = (compile_definition("pkg/msg/X", text) for text in ("int32 a", "int32 a\nint32 b"))
    alice, bob = world.pair()
    publisher, quiet = alice.create_publisher(new, "x"), alice.create_publisher(Int32, "quiet")
    await until(lambda: bob.count_publishers("x") == bob.count_publishers("quiet") == 1)
    subscription, silent = bob.create_subscription(old, "x"), bob.create_subscription(Int32, "quiet")
    if world.kind != "zenoh":
        await publisher.wait_for_subscribers(20)
        publisher.publish(new())
    assert "s: node /alice has another definition of pkg/msg/X, RIHS01_" in await why(subscription.receive(1))
    await silent.wait_for_publishers(20)
    assert (await why(silent.receive(TIMEOUT_S))).endswith("s: 1 publisher connected, but sent nothing")
    assert quiet.subscription_count == 1


async def test_timeouts_of_actions_nodes_and_parameters_suggest_similar_names(memory: World) -> None:
    fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
    alice, bob = memory.node("alice", "/r1"), memory.node("bob")
    alice.create_action_server(fibonacci, "fib", lambda goal: None)
    client = bob.create_action_client(fibonacci, "fib")
    for wait in (client.wait_for_server(TIMEOUT_S), client.send_goal(fibonacci.Goal(), TIMEOUT_S)):
        assert (await why(wait)).endswith('no node serves it; did you mean "/r1/fib"?')
    for wait in (
        bob.wait_for_node("alice", TIMEOUT_S),
        bob.create_parameter_client("/alice").wait_for_services(TIMEOUT_S),
    ):
        assert 'did you mean "/r1/alice"?' in await why(wait)


async def test_wait_timeout_reports_that_no_other_participant_was_found(memory: World) -> None:
    node = memory.node("alone")
    subscription = node.create_subscription(String, "chatter")
    assert (await why(subscription.receive(0.01))).endswith("0.01 s: no other participant was found")
    with pytest.raises(WaitTimeoutError) as raised:
        await node.wait_for_node("other", 0.01)
    assert raised.value.reason == "no other participant was found"


async def test_timeout_text_about_many_or_hostile_peers_is_short(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("bob")
    evil = EndpointSpec(TopicKey("topic", "/hostile"), "\x1b[31m" * 100_000, DEFAULT, "\x1b" * 100_000, 1)
    participant_of(memory.node("evil")).create_writer(evil)
    text = await why(node.create_subscription(Point, "hostile").receive(2))
    for one in (text, caplog.text):
        assert "type" in one and "\x1b" not in one and len(one) < 2000
    for number in range(30):
        memory.node(f"{'a' * 200}{number}").create_publisher(String, "chatter")
    text = await why(node.create_subscription(Point, "chatter").receive(0.01))
    assert "; and 27 others" in text and len(text) < 1000


def test_did_you_mean_suggests_other_namespace_or_spelling() -> None:
    known = ["/robot_1/front/scan", "/r1/scan", "/map", "/"]
    for name, hint in (("/scan", "/r1/scan"), ("/r2/map", "/map"), ("/mop", "/map"), ("/r1/scam", "/r1/scan")):
        assert did_you_mean(name, known, in_namespaces=True) == f'; did you mean "{hint}"?'
    assert did_you_mean("/odometry", known, in_namespaces=True) == did_you_mean("/", known, in_namespaces=True) == ""
    long = ["/x" * 10_000 + str(number) for number in range(100)]
    assert did_you_mean("/x" * 10_000, long, in_namespaces=True) != ""


def test_suggested_qos_preset_matches_all_peers() -> None:
    profiles = [DEFAULT, SENSOR_DATA, DEFAULT.transient_local(), DEFAULT.deadline(1), QoSProfile().manual_liveliness(1)]
    for own in profiles:
        for peers in ([one] for one in profiles):
            for publisher in (True, False):
                name = find_preset(own, publisher=publisher, peers=peers)
                preset = {"DEFAULT": DEFAULT, "SENSOR_DATA": SENSOR_DATA, "BEST_AVAILABLE": BEST_AVAILABLE}[name]
                preset = resolve_best_available(preset, publisher=publisher, peers=peers)
                pair = (preset, peers[0]) if publisher else (peers[0], preset)
                assert check_compatible(*pair).matches
