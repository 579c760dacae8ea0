"""Exceptions of callbacks with `on_error="raise"`."""

from __future__ import annotations

import asyncio
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import Int64, String
from std_srvs.srv import SetBool

from rosidl_py_gen.runtime import Context, Duration, LifecycleNode, MemoryTransport, Node, State, run, spin

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator

BAD = "the wheel came off"


@pytest.fixture
def context() -> Iterator[Context]:
    with Context(0, transport=MemoryTransport(), args=["test"]) as made:
        yield made


def fails(*_: object) -> Any:
    raise AssertionError(BAD)


async def fails_later(*_: object) -> Any:
    await asyncio.sleep(0)
    raise AssertionError(BAD)


async def call_service(node: Node, handler: Callable[..., Any]) -> None:
    node.create_service(SetBool, "s", handler)
    await node.create_client(SetBool, "s").call(SetBool.Request())


async def publish(node: Node, callback: Callable[..., Any]) -> None:
    node.create_subscription(String, "t", callback)
    node.create_publisher(String, "t").publish(String())


async def send_goal(node: Node, **functions: Any) -> None:
    node.create_action_server(Fibonacci, "a", functions.pop("execute", lambda goal: Fibonacci.Result()), **functions)
    goal = await node.create_action_client(Fibonacci, "a").send_goal(Fibonacci.Goal(), timeout_s=5)
    await goal.cancel()


async def set_parameter(node: Node, kind: str) -> None:
    node.declare_parameter("p", 1)
    getattr(node, f"add_{kind}_set_callback")(fails)
    node.set_parameters({"p": 2})


async def until_canceled(goal: Any) -> None:
    await goal.wait_for_cancel()


@dataclass
class Speed:
    top: float = 1.0


async def declare(node: Node) -> None:
    calm = [True]

    def validator(speed: Speed) -> str | None:
        return None if calm else cast("str", fails())

    node.declare_parameters(Speed, validator=validator)
    calm.clear()
    node.set_parameters({"top": 2.0})


async def jump(node: Node) -> None:
    node.clock.create_jump_callback(post=fails, on_clock_change=True)
    node.clock.enable_ros_time_override()


async def tick(node: Node, callback: Callable[..., Any]) -> None:
    node.create_timer(0.001, callback)


WAYS: dict[str, Callable[[Node], Coroutine[Any, Any, None]]] = {
    "subscription": lambda node: publish(node, fails),
    "async subscription": lambda node: publish(node, fails_later),
    "lambda around async": lambda node: publish(node, lambda message: fails_later()),
    "timer": lambda node: tick(node, fails),
    "async timer": lambda node: tick(node, fails_later),
    "service": lambda node: call_service(node, fails),
    "async service": lambda node: call_service(node, fails_later),
    "action in a thread": lambda node: send_goal(node, execute=fails),
    "async action": lambda node: send_goal(node, execute=fails_later),
    "accept": lambda node: send_goal(node, goal_callback=fails),
    "on_cancel": lambda node: send_goal(node, execute=until_canceled, cancel_callback=fails),
    "validator": lambda node: declare(node),
    "pre-set": lambda node: set_parameter(node, "pre"),
    "on-set": lambda node: set_parameter(node, "on"),
    "post-set": lambda node: set_parameter(node, "post"),
    "jump": jump,
}


@pytest.mark.parametrize("way", WAYS)
def test_run_ends_with_what_any_function_of_the_user_raised(context: Context, way: str) -> None:
    node = Node("n", context=context, on_error="raise")

    async def main() -> None:
        await WAYS[way](node)
        await asyncio.Event().wait()

    with pytest.raises(AssertionError, match=BAD) as caught:
        run(main)
    assert "fails" in {entry.name for entry in caught.traceback} | {entry.name[:5] for entry in caught.traceback}


@pytest.mark.parametrize("way", ["subscription", "async service", "post-set", "action in a thread"])
async def test_async_with_ends_with_it_on_a_loop_that_is_not_ours(context: Context, way: str) -> None:
    with pytest.raises(AssertionError, match=BAD):
        async with Node("n", context=context, on_error="raise") as node:
            await WAYS[way](node)
            await asyncio.Event().wait()
    assert node.is_closed
    await asyncio.sleep(0)  # the cancellation is over


async def test_a_context_gives_its_nodes_the_choice_and_is_ended_as_a_whole() -> None:
    with pytest.raises(AssertionError, match=BAD):
        async with Context(0, transport=MemoryTransport(), args=["test"], on_error="raise") as context:
            await publish(Node("n", context=context), fails)
            await asyncio.Event().wait()


def test_a_lifecycle_callback_counts_too(context: Context) -> None:
    class Part(LifecycleNode):
        def on_configure(self, state: State) -> None:
            fails()

    node = Part("n", context=context, on_error="raise")

    async def main() -> None:
        await node.configure()
        await asyncio.Event().wait()

    with pytest.raises(AssertionError, match=BAD):
        run(main)


def test_spin_ends_with_it(context: Context) -> None:
    node = Node("n", context=context, on_error="raise")
    node.create_timer(0.001, fails)
    with pytest.raises(AssertionError, match=BAD):
        spin(node)
    assert node.is_closed


def test_a_blocking_call_ends_with_it(context: Context) -> None:
    with pytest.raises(AssertionError, match=BAD), Node("n", context=context, on_error="raise") as node:
        node.create_service(SetBool, "s", fails)
        node.create_client(SetBool, "s").call_sync(SetBool.Request())


def test_what_nobody_could_take_ends_the_with_block(context: Context) -> None:
    with pytest.raises(AssertionError, match=BAD), Node("n", context=context, on_error="raise") as node:
        node.declare_parameter("p", 1)
        node.add_post_set_callback(fails)
        node.set_parameters({"p": 2})


def test_the_first_of_several_counts(context: Context) -> None:
    def other(_: object) -> None:
        raise ValueError("and so did the door")

    with pytest.raises(ValueError, match="so did the door"), Node("n", context=context, on_error="raise") as node:
        node.declare_parameter("p", 1)
        node.add_post_set_callback(fails)
        node.add_post_set_callback(other)
        node.set_parameters({"p": 2})


async def test_an_exception_of_the_block_itself_and_a_foreign_cancellation_pass(context: Context) -> None:
    with pytest.raises(KeyError):
        async with Node("n", context=context, on_error="raise") as node:
            await set_parameter(node, "post")
            raise KeyError("mine")

    async def wait() -> None:
        async with Node("m", context=context, on_error="raise"):
            await asyncio.Event().wait()

    task = asyncio.create_task(wait())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


async def test_by_default_all_goes_on(context: Context) -> None:
    heard: list[int] = []

    def callback(message: Int64) -> None:
        heard.append(message.data)
        if message.data == 1:
            fails()

    async with Node("n", context=context) as node:
        node.create_subscription(Int64, "t", callback)
        publisher = node.create_publisher(Int64, "t")
        for number in (1, 2):
            publisher.publish(Int64(data=number))
        while len(heard) < 2:
            await asyncio.sleep(0)


def test_a_failure_in_another_thread_is_heard_too(context: Context) -> None:
    node = Node("n", context=context, on_error="raise")
    node.declare_parameter("p", 1)
    node.add_post_set_callback(fails)

    async def main() -> None:
        thread = threading.Thread(target=lambda: node.set_parameters({"p": 2}))
        thread.start()
        await node.clock.sleep_for(Duration(seconds=60))

    with pytest.raises(AssertionError, match=BAD):
        run(main)


def test_another_word_than_log_and_raise_is_refused(context: Context) -> None:
    with pytest.raises(ValueError, match="'log' or 'raise', got 'ignore'"):
        Node("n", context=context, on_error="ignore")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="on_error must be"):
        Context(on_error=True)  # type: ignore[arg-type]
