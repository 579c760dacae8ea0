"""Blocking forms of awaitable methods."""

from __future__ import annotations

import asyncio
import inspect
from typing import TYPE_CHECKING, Any

import pytest
from support.worlds import World

from rosidl_py_gen import get_message, get_service, runtime
from rosidl_py_gen.runtime import WaitTimeoutError, WouldDeadlockError

if TYPE_CHECKING:
    from collections.abc import Iterator

String: Any = get_message("std_msgs/msg/String")
SetBool: Any = get_service("std_srvs/srv/SetBool")
WITHOUT_SYNC_FORM = {
    "AdaptiveSubscription": "made for loops that await; Node.wait_for_message_sync blocks",
    "Clock": "time.sleep, or a timer",
    "Rate": "made for loops that await",
    "Timer": "made for loops that await",
    "ServerGoal": "handlers are async, or have threads of their own",
    "SimTimePublisher": "made for tests that await",
    "ServiceRequest": "answered at once",
}


def awaitable_methods() -> Iterator[tuple[str, str, type]]:
    for class_name in dir(runtime):
        cls = getattr(runtime, class_name)
        if inspect.isclass(cls) and not issubclass(cls, BaseException):
            for name, member in inspect.getmembers(cls):
                if (
                    not name.startswith("_")
                    and not name.endswith("_sync")
                    and inspect.iscoroutinefunction(inspect.unwrap(member))
                ):
                    yield class_name, name, cls


def test_every_awaitable_method_has_a_sync_form_or_a_documented_exception() -> None:
    found = [(owner, name) for owner, name, _ in awaitable_methods()]
    assert {("Subscription", "receive"), ("Client", "call"), ("Node", "wait_for_node")} <= {*found}
    missing = [
        f"{owner}.{name}"
        for owner, name, cls in awaitable_methods()
        if owner not in WITHOUT_SYNC_FORM and not hasattr(cls, f"{name}_sync")
    ]
    assert missing == []
    assert {owner for owner, _ in found} >= WITHOUT_SYNC_FORM.keys() - {"SimTimePublisher", "ServiceRequest"}


@pytest.mark.every_transport
def test_sync_methods_receive_and_wait_without_event_loop(world: World) -> None:
    if world.kind == "zenoh":
        pytest.skip("the same code runs there")
    alice, bob = world.pair()
    publisher, subscription = alice.create_publisher(String, "t"), bob.create_subscription(String, "t")
    publisher.wait_for_subscribers_sync(20)
    subscription.wait_for_publishers_sync(timeout_s=20)
    publisher.publish(String(data="a"))
    assert subscription.receive_sync(20).data == "a"
    publisher.publish(String(data="b"))
    message, info = subscription.receive_with_info_sync(5)
    assert (message.data, info.publisher_gid) == ("b", publisher.gid)
    assert publisher.wait_for_acknowledged_sync(20) and bob.wait_for_node_sync("alice", 20)
    with pytest.raises(WaitTimeoutError, match="no message on /t"):
        subscription.receive_sync(0.01)


async def test_sync_method_on_the_event_loop_raises_would_deadlock_error(memory: World) -> None:
    subscription = memory.node("n").create_subscription(String, "t")
    with pytest.raises(
        WouldDeadlockError, match=r"receive_sync of Subscription\(/t.*use 'await \.\.\.receive\(\.\.\.\)'"
    ):
        subscription.receive_sync(1)


async def test_sync_method_in_another_thread_waits_while_the_loop_runs(memory: World) -> None:
    alice, bob = memory.pair()
    subscription, publisher = bob.create_subscription(String, "t"), alice.create_publisher(String, "t")
    await publisher.wait_for_subscribers(5)
    waiting = asyncio.ensure_future(asyncio.to_thread(subscription.receive_sync, 5))
    publisher.publish(String(data="across"))
    assert (await waiting).data == "across"
