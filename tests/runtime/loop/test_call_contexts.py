"""Each callback runs in a `contextvars` context of its own, and its failure is logged once."""

from __future__ import annotations

import asyncio
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int32
from std_srvs.srv import SetBool
from support.node_fixtures import until

from rosidl_py_gen import get_action
from rosidl_py_gen.runtime import SetResult

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node

Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
WHO: ContextVar[str] = ContextVar("WHO", default="nobody")
CALLS = 3


class Calls:
    def __init__(self, *, fails: bool = False) -> None:
        self.saw: list[str] = []
        self.fails = fails
        self.timer: Any = None

    def note(self, answer: object = None) -> Any:
        self.saw.append(WHO.get())
        WHO.set(f"call {len(self.saw)}")
        if self.timer is not None:
            if len(self.saw) == CALLS:
                self.timer.close()
            else:
                self.timer.reset()  # from in here, where the variable is set
        if self.fails:
            raise ValueError("no")
        return answer

    async def note_later(self, answer: object = None) -> Any:
        await asyncio.sleep(0)
        before = WHO.get()
        WHO.set("changed")
        await asyncio.sleep(0)
        assert WHO.get() == "changed"
        WHO.set(before)
        return self.note(answer)

    async def all_made(self) -> None:
        await until(lambda: len(self.saw) == CALLS)


async def _messages(alice: Node, bob: Node, calls: Calls, callback: Callable[[Int32], object]) -> None:
    bob.create_subscription(Int32, "n", callback)
    publisher = alice.create_publisher(Int32, "n")
    await publisher.wait_for_subscribers(5)
    WHO.set("the publisher")
    publisher.publish(Int32())
    publisher.publish(Int32())
    await until(lambda: len(calls.saw) == 2)
    publisher.publish(Int32())
    await calls.all_made()


async def plain_subscription(alice: Node, bob: Node, calls: Calls) -> None:
    await _messages(alice, bob, calls, lambda message: calls.note())


async def async_subscription(alice: Node, bob: Node, calls: Calls) -> None:
    async def callback(message: Int32) -> None:
        await calls.note_later()

    await _messages(alice, bob, calls, callback)


async def subscription_with_a_coroutine(alice: Node, bob: Node, calls: Calls) -> None:
    await _messages(alice, bob, calls, lambda message: calls.note_later())


async def _requests(alice: Node, bob: Node, calls: Calls, handler: Callable[[Any], Any]) -> None:
    bob.create_service(SetBool, "s", handler)
    client = alice.create_client(SetBool, "s")
    await client.wait_for_service(5)
    WHO.set("the client")
    requests = [asyncio.ensure_future(client.call(SetBool.Request())) for _ in range(CALLS)]
    await calls.all_made()
    if not calls.fails:
        await asyncio.gather(*requests)
    for request in requests:
        request.cancel()


async def plain_handler(alice: Node, bob: Node, calls: Calls) -> None:
    await _requests(alice, bob, calls, lambda request: calls.note(SetBool.Response()))


async def async_handler(alice: Node, bob: Node, calls: Calls) -> None:
    async def handler(request: object) -> Any:
        return await calls.note_later(SetBool.Response())

    await _requests(alice, bob, calls, handler)


async def plain_timer(alice: Node, bob: Node, calls: Calls) -> None:
    calls.timer = alice.create_timer(0.01, calls.note)
    await calls.all_made()


async def async_timer(alice: Node, bob: Node, calls: Calls) -> None:
    calls.timer = alice.create_timer(0.01, calls.note_later)
    await calls.all_made()


async def _goals(alice: Node, bob: Node, calls: Calls, execute: Callable[[Any], Any], **options: Any) -> list[Any]:
    alice.create_action_server(Fibonacci, "fib", execute, **options)
    client = bob.create_action_client(Fibonacci, "fib")
    assert await client.wait_for_server(5)
    WHO.set("the client")
    sent = [client.send_goal(Fibonacci.Goal(), timeout_s=5) for _ in range(CALLS)]
    return await asyncio.gather(*sent, return_exceptions=True)


async def async_execute(alice: Node, bob: Node, calls: Calls) -> None:
    async def execute(handle: object) -> Any:
        return await calls.note_later(Fibonacci.Result())

    await _goals(alice, bob, calls, execute, goal_policy="queue")  # the end of one goal begins the next
    await calls.all_made()


async def plain_execute(alice: Node, bob: Node, calls: Calls) -> None:
    await _goals(alice, bob, calls, lambda handle: calls.note(Fibonacci.Result()), goal_policy="queue")
    await calls.all_made()


async def plain_accept(alice: Node, bob: Node, calls: Calls) -> None:
    await _goals(alice, bob, calls, lambda handle: Fibonacci.Result(), goal_callback=lambda goal: calls.note(True))
    await calls.all_made()


async def async_on_cancel(alice: Node, bob: Node, calls: Calls) -> None:
    async def execute(handle: Any) -> Any:
        await handle.wait_for_cancel()
        return handle.canceled(Fibonacci.Result())

    async def on_cancel(handle: object) -> Any:
        return await calls.note_later(True)

    for handle in await _goals(alice, bob, calls, execute, cancel_callback=on_cancel):
        await asyncio.gather(handle.cancel(5), return_exceptions=True)
    await calls.all_made()


@dataclass
class Parameters:
    a: int = 0
    b: int = 0
    c: int = 0


async def _sets(alice: Node, bob: Node, calls: Calls, validator: Any = None, **add: Callable[[Any], Any]) -> None:
    bob.declare_parameters(Parameters, validator=validator)
    for kind, callback in add.items():
        getattr(bob, f"add_{kind}_callback")(callback)
    client = alice.create_parameter_client("bob")
    assert await client.wait_for_services(5)
    WHO.set("the client")
    await client.set({"a": 1, "b": 1, "c": 1}, 5)
    await calls.all_made()


async def validator(alice: Node, bob: Node, calls: Calls) -> None:
    await _sets(alice, bob, calls, lambda new: calls.note() if new != Parameters() else None)


async def pre_set(alice: Node, bob: Node, calls: Calls) -> None:
    await _sets(alice, bob, calls, pre_set=calls.note)


async def on_set(alice: Node, bob: Node, calls: Calls) -> None:
    await _sets(alice, bob, calls, on_set=lambda parameters: calls.note(SetResult(True)))


async def post_set(alice: Node, bob: Node, calls: Calls) -> None:
    await _sets(alice, bob, calls, post_set=lambda parameters: calls.note())


KINDS = [
    *(plain_subscription, async_subscription, subscription_with_a_coroutine, plain_handler, async_handler),
    *(plain_timer, async_timer, async_execute, plain_execute, plain_accept, async_on_cancel),
    *(validator, pre_set, on_set, post_set),
]


@pytest.mark.parametrize("kind", KINDS)
async def test_what_one_call_sets_the_next_does_not_see(world: World, kind: Any) -> None:
    alice, bob = world.pair()
    calls = Calls()
    await kind(alice, bob, calls)
    assert calls.saw == ["nobody"] * CALLS


@pytest.mark.parametrize("kind", KINDS)
async def test_each_failure_is_logged_once(world: World, kind: Any, caplog: pytest.LogCaptureFixture) -> None:
    alice, bob = world.pair()
    calls = Calls(fails=True)

    def failures() -> list[str]:
        return [record.getMessage() for record in caplog.records if record.exc_info]

    await kind(alice, bob, calls)
    await until(lambda: len(failures()) >= CALLS)
    await asyncio.sleep(0.01)
    assert len(failures()) == CALLS and len(set(failures())) == 1, failures()


async def test_a_call_sees_what_was_set_where_the_function_was_handed_in(world: World) -> None:
    alice, bob = world.pair()
    calls = Calls()
    WHO.set("its maker")
    await plain_subscription(alice, bob, calls)
    assert calls.saw == ["its maker"] * CALLS


async def test_an_async_function_is_cancelled_and_timed_out_as_in_any_task(world: World) -> None:
    alice, bob = world.pair()
    outcomes: list[str] = []

    async def callback(message: Int32) -> None:
        try:
            await asyncio.wait_for(asyncio.sleep(30), 0.01 if message.data else None)
        except asyncio.TimeoutError:
            outcomes.append("timed out")
        except asyncio.CancelledError:
            outcomes.append("cancelled")
            raise

    bob.create_subscription(Int32, "n", callback)
    publisher = alice.create_publisher(Int32, "n")
    await publisher.wait_for_subscribers(5)
    for number in (1, 1, 0):
        publisher.publish(Int32(data=number))
    await until(lambda: len(outcomes) == 2)
    await asyncio.sleep(0.02)
    bob.close()
    await until(lambda: len(outcomes) == 3)
    assert outcomes == ["timed out", "timed out", "cancelled"]
