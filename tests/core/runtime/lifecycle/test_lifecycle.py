"""Lifecycle nodes on the memory transport (docs/internals/protocol.md 12.2)."""

from __future__ import annotations

import asyncio
import gc
import time
import weakref
from typing import Any

import numpy as np
import pytest
from support.waiting import until
from support.worlds import World, entity

from rosidl_py_gen import get_message, type_hash
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as TimeMessage
from rosidl_py_gen.msgs.lifecycle_msgs.msg import Transition, TransitionEvent
from rosidl_py_gen.msgs.lifecycle_msgs.srv import (
    ChangeState,
    GetAvailableStates,
    GetAvailableTransitions,
    GetState,
)
from rosidl_py_gen.runtime import Context, LifecycleNode, MatchedStatus, PublisherEventCallbacks
from rosidl_py_gen.runtime.lifecycle import State, TransitionCallbackReturn, TransitionError

pytestmark = pytest.mark.on_zenoh


class Managed(LifecycleNode):
    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name, context=context)
        self.calls: list[tuple[str, State]] = []
        self.answers: dict[str, Any] = {}
        self.may_continue: asyncio.Event | None = None

    async def _note(self, name: str, state: State) -> Any:
        self.calls.append((name, state))
        if self.may_continue is not None:
            await self.may_continue.wait()
        answer = self.answers.get(name)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def on_configure(self, state: State) -> Any:
        return self._note("configure", state)

    def on_cleanup(self, state: State) -> Any:
        return self._note("cleanup", state)

    def on_activate(self, state: State) -> Any:
        return self._note("activate", state)

    async def on_deactivate(self, state: State) -> Any:
        return await self._note("deactivate", state)

    async def on_shutdown(self, state: State) -> Any:
        return await self._note("shutdown", state)


class Recovering(Managed):
    def on_error(self, state: State) -> Any:
        self.calls.append(("error", state))
        return self.answers.get("error", True)


def managed(world: World, cls: type[Managed] = Managed) -> Managed:
    node = cls("n", world.context())
    world.nodes.append(node)
    return node


@pytest.mark.every_transport
async def test_lifecycle_transitions_call_callbacks_and_publish_events(world: World) -> None:
    seen: list[tuple[int, int]] = []
    stamps: list[int] = []

    def note(event: TransitionEvent) -> None:
        seen.append((event.start_state.id, event.goal_state.id))
        stamps.append(event.timestamp + event.transition.id)

    world.node("listener").create_subscription(TransitionEvent, "/n/transition_event", note, 100)
    node = managed(world)
    await until(lambda: entity(node, "/transition_event").has_subscriptions)
    assert node.state == State.UNCONFIGURED
    for step in (node.configure, node.activate, node.deactivate, node.cleanup, node.shutdown):
        assert await step() is TransitionCallbackReturn.SUCCESS
    assert node.state.label == "finalized"
    assert node.calls == [
        ("configure", State.UNCONFIGURED),
        ("activate", State.INACTIVE),
        ("deactivate", State.ACTIVE),
        ("cleanup", State.INACTIVE),
        ("shutdown", State.UNCONFIGURED),
    ]
    await until(lambda: len(seen) == 10)
    expected = [(1, 10), (10, 2), (2, 13), (13, 3), (3, 14), (14, 2), (2, 11), (11, 1), (1, 12), (12, 4)]
    assert seen == expected and set(stamps) == {0}


@pytest.mark.every_transport
@pytest.mark.parametrize("distro", ["lyrical", "rolling"])
async def test_transition_events_of_lyrical_contain_stamp_and_transition(
    world: World, monkeypatch: pytest.MonkeyPatch, distro: str
) -> None:
    lyrical: Any = get_message("lifecycle_msgs/msg/TransitionEvent", distro="lyrical")
    seen: list[Any] = []
    subscription = world.node("listener").create_subscription(lyrical, "/n/transition_event", seen.append, 100)
    with monkeypatch.context() as patch:
        patch.setenv("ROS_DISTRO", distro)
        node = managed(world)
    await until(lambda: entity(node, "/transition_event").has_subscriptions)
    found = world.nodes[0].get_publishers_info_by_topic
    await until(lambda: [one.topic_type_hash for one in found("/n/transition_event")] == [type_hash(lyrical)])
    before_s = time.time()
    await node.configure()
    node.answers["activate"] = False
    await node.activate()
    await until(lambda: len(seen) == 4)
    transitions = [(event.transition.id, event.transition.label) for event in seen]
    assert transitions == [(1, "configure"), (10, "transition_success"), (3, "activate"), (31, "transition_failure")]
    assert all(before_s - 1 < event.stamp.sec + event.stamp.nanosec * 1e-9 < time.time() + 1 for event in seen)
    assert [event.goal_state.label for event in seen] == ["configuring", "inactive", "activating", "inactive"]
    assert subscription.incompatible_dropped == 0


@pytest.mark.parametrize(
    ("answer", "outcome", "state"),
    [
        (False, TransitionCallbackReturn.FAILURE, State.UNCONFIGURED),
        (True, TransitionCallbackReturn.SUCCESS, State.INACTIVE),
        (RuntimeError("no motor"), TransitionCallbackReturn.ERROR, State.FINALIZED),
        (TransitionCallbackReturn.ERROR, TransitionCallbackReturn.ERROR, State.FINALIZED),
        (np.array([1, 2]), TransitionCallbackReturn.ERROR, State.FINALIZED),  # has no truth value
    ],
)
async def test_callback_return_value_determines_transition_outcome(
    world: World, answer: Any, outcome: TransitionCallbackReturn, state: State, caplog: pytest.LogCaptureFixture
) -> None:
    node = managed(world)
    node.answers["configure"] = answer
    assert await node.configure() is outcome and node.state is state
    assert ("no motor" in caplog.text) is isinstance(answer, Exception)


@pytest.mark.parametrize(
    ("answer", "state"),
    [(True, State.UNCONFIGURED), (False, State.FINALIZED), (TransitionCallbackReturn.ERROR, State.FINALIZED)],
)
async def test_error_processing_may_recover(world: World, answer: Any, state: State) -> None:
    node = managed(world, Recovering)
    node.answers.update(activate=RuntimeError("x"), error=answer)
    await node.configure()
    assert await node.activate() is TransitionCallbackReturn.ERROR and node.state is state
    assert node.calls[-1] == ("error", State.INACTIVE)


async def test_impossible_transition_raises_error_that_lists_possible_ones(world: World) -> None:
    node = managed(world)
    with pytest.raises(TransitionError, match="'activate' is not possible in state unconfigured; possible: conf"):
        await node.activate()


@pytest.mark.every_transport
async def test_lifecycle_services_change_and_report_the_state(world: World) -> None:
    node = managed(world)
    other = world.node("other")
    change = other.create_client(ChangeState, "/n/change_state")
    get = other.create_client(GetState, "/n/get_state")

    async def request(number: int, label: str = "") -> bool:
        message = ChangeState.Request(transition=Transition(id=number, label=label))
        return bool((await change.call(message, timeout_s=20)).success)

    async def state() -> tuple[int, str]:
        current = (await get.call(GetState.Request(), timeout_s=20)).current_state
        return current.id, current.label

    assert await state() == (1, "unconfigured")
    assert await request(1) and await state() == (2, "inactive")
    assert not await request(1)
    assert await request(99, "activate") and await state() == (3, "active")
    node.answers["deactivate"] = False
    assert not await request(4) and await state() == (3, "active")
    states = other.create_client(GetAvailableStates, "/n/get_available_states")
    answer = await states.call(GetAvailableStates.Request(), 20)
    assert [s.id for s in answer.available_states] == [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]
    possible = other.create_client(GetAvailableTransitions, "/n/get_available_transitions")
    rows = (await possible.call(GetAvailableTransitions.Request(), 20)).available_transitions
    assert [(r.transition.id, r.transition.label, r.start_state.id, r.goal_state.id) for r in rows] == [
        (4, "deactivate", 3, 14),
        (7, "shutdown", 3, 12),
    ]
    graph = other.create_client(GetAvailableTransitions, "/n/get_transition_graph")
    assert len((await graph.call(GetAvailableTransitions.Request(), 20)).available_transitions) == 25


async def test_second_transition_is_refused_while_one_is_running(world: World) -> None:
    node = managed(world)
    node.may_continue = asyncio.Event()
    first = asyncio.ensure_future(node.configure())
    await until(lambda: node.state is State.CONFIGURING)
    with pytest.raises(TransitionError, match="in state configuring; possible: nothing"):
        await node.shutdown()
    node.may_continue.set()
    assert await first is TransitionCallbackReturn.SUCCESS


async def test_lifecycle_publishers_drop_messages_while_inactive(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = managed(world)
    received: list[int] = []
    world.node("listener").create_subscription(TimeMessage, "t", lambda m: received.append(m.sec))
    told: list[MatchedStatus] = []
    callbacks = PublisherEventCallbacks(matched=told.append)
    publisher = node.create_lifecycle_publisher(TimeMessage, "t", event_callbacks=callbacks)
    assert await publisher.wait_for_subscribers(5)
    await until(lambda: told == [MatchedStatus(1, 1, 1, 1)])
    publisher.publish(TimeMessage(sec=1))
    await node.configure()
    publisher.publish(TimeMessage(sec=2))
    publisher.publish_raw(TimeMessage(sec=2).encode())
    await node.activate()
    publisher.publish(TimeMessage(sec=3))
    publisher.publish_raw(TimeMessage(sec=4).encode())
    await node.deactivate()
    publisher.publish(TimeMessage(sec=5))
    await until(lambda: len(received) == 2)
    assert received == [3, 4] and publisher.silenced == 4
    assert caplog.text.count("while the node is not active") == 1


def test_closed_lifecycle_node_is_garbage_collected(world: World) -> None:
    node = managed(world)
    reference = weakref.ref(node)
    world.nodes.remove(node)
    node.close()
    del node
    gc.collect()
    assert reference() is None
