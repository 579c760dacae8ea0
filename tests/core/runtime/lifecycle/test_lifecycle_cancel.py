"""Cancelled lifecycle transitions, values of callbacks, and the constructor."""

from __future__ import annotations

import asyncio
import inspect
from typing import Any

import pytest
from support.waiting import until
from support.worlds import World

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.msgs.lifecycle_msgs.msg import Transition, TransitionEvent
from rosidl_py_gen.msgs.lifecycle_msgs.srv import ChangeState
from rosidl_py_gen.runtime import Context, LifecycleNode, Node
from rosidl_py_gen.runtime.lifecycle import State, TransitionCallbackReturn


class Slow(LifecycleNode):
    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name, context=context)
        self.release = asyncio.Event()
        self.log: list[str] = []
        self.recovers: Any = True
        self.stubborn = False
        self.error_takes_s = 0.0

    async def on_configure(self, state: State) -> None:
        self.log.append("configure")
        try:
            await self.release.wait()
        except asyncio.CancelledError:
            self.log.append("cancelled")
            if not self.stubborn:
                raise

    async def on_error(self, state: State) -> Any:
        self.log.append(f"error from {state.label}")
        await asyncio.sleep(self.error_takes_s)
        return self.recovers


def slow(world: World) -> Slow:
    node = Slow("n", world.context())
    world.nodes.append(node)
    return node


@pytest.mark.parametrize(("recovers", "state"), [(True, State.UNCONFIGURED), (False, State.FINALIZED)])
async def test_cancelled_transition_runs_error_processing(world: World, recovers: bool, state: State) -> None:
    events: list[tuple[int, int]] = []
    listener = world.node("listener")
    seen = listener.create_subscription(TransitionEvent, "/n/transition_event", None, 100)
    node = slow(world)
    await seen.wait_for_publishers(5)
    node.recovers = recovers
    with pytest.raises(asyncio.TimeoutError):
        await asyncio.wait_for(node.configure(), 0.05)
    assert node.state is state and node.log == ["configure", "cancelled", "error from unconfigured"]
    for _ in range(3):
        event = await seen.receive(5)
        events.append((event.start_state.id, event.goal_state.id))
    assert events == [(1, 10), (10, 15), (15, int(state))]
    if recovers:
        node.release.set()
        assert (
            await node.configure() is TransitionCallbackReturn.SUCCESS
            and await node.shutdown() is TransitionCallbackReturn.SUCCESS
        )


async def test_second_cancellation_ends_error_processing_in_finalized(world: World) -> None:
    node = slow(world)
    node.error_takes_s = 60
    task = asyncio.ensure_future(node.configure())
    await until(lambda: "configure" in node.log)
    task.cancel()
    await until(lambda: node.state is State.ERRORPROCESSING)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert node.state is State.FINALIZED


async def test_transition_succeeds_if_callback_suppresses_cancellation(world: World) -> None:
    node = slow(world)
    node.stubborn = True
    task = asyncio.ensure_future(node.configure())
    await until(lambda: "configure" in node.log)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert node.state is State.INACTIVE and node.log == ["configure", "cancelled"]


class Cancels(Slow):
    async def on_configure(self, state: State) -> None:
        raise asyncio.CancelledError

    def on_activate(self, state: State) -> None:
        raise asyncio.CancelledError


async def test_callback_that_raises_cancelled_error_fails_the_transition(world: World) -> None:
    node = Cancels("n", world.context())
    world.nodes.append(node)
    assert await node.configure() is TransitionCallbackReturn.ERROR and node.state is State.UNCONFIGURED
    client = world.node("other").create_client(ChangeState, "/n/change_state")
    assert not (await client.call(ChangeState.Request(transition=Transition(id=1)), 5)).success
    assert node.state is State.UNCONFIGURED and node.log == ["error from unconfigured"] * 2


async def test_closing_node_cancels_transition_started_by_service(world: World) -> None:
    node = slow(world)
    client = world.node("other").create_client(ChangeState, "/n/change_state")
    call = asyncio.ensure_future(client.call(ChangeState.Request(transition=Transition(id=1)), 5))
    await until(lambda: "configure" in node.log)
    node.close()
    await until(lambda: node.state is State.FINALIZED)
    assert node.log == ["configure", "cancelled"]
    call.cancel()
    with pytest.raises(ClosedError):
        await node.configure()


class ClosesItself(LifecycleNode):
    def on_shutdown(self, state: State) -> None:
        self.close()


async def test_lifecycle_callback_may_close_its_node(world: World) -> None:
    node = ClosesItself("n", context=world.context())
    assert await node.shutdown() is TransitionCallbackReturn.SUCCESS and node.state is State.FINALIZED


def test_lifecycle_node_has_the_constructor_signature_of_node(world: World) -> None:
    assert inspect.signature(LifecycleNode) == inspect.signature(Node)
    node = LifecycleNode(
        "n",
        "/ns",
        context=world.context(),
        parameter_overrides={"a": 5},
        automatically_declare_parameters_from_overrides=True,
    )
    world.nodes.append(node)
    assert node.get_parameter("a") == 5 and node.fully_qualified_name == "/ns/n"
    with pytest.raises(TypeError, match="unexpected keyword argument 'typo'"):
        LifecycleNode("m", typo=1)  # type: ignore[call-arg]
