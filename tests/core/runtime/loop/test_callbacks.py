"""Callbacks: each call has its own `contextvars` context; failures are logged once, or raised with `on_error`."""

from __future__ import annotations

import asyncio
import sys
import threading
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import Int32, Int64, String
from std_srvs.srv import SetBool
from support.waiting import until

from rosidl_py_gen.runtime import Context, Duration, LifecycleNode, MemoryTransport, Node, SetResult, State, run, spin
from rosidl_py_gen.runtime.loop.callbacks import UserCallback, start_task

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.worlds import World

CALLER: ContextVar[str] = ContextVar("CALLER", default="unset")
CALLS = 3


class Calls:
    """Callback in three forms; `answer` computes its return value from its arguments."""

    def __init__(self, *, fails: bool = False) -> None:
        self.seen: list[str] = []
        self.fails = fails
        self.answer: Callable[..., Any] = lambda *_: None

    def plain(self, *arguments: object) -> Any:
        self.seen.append(CALLER.get())
        CALLER.set(f"call {len(self.seen)}")
        answer = self.answer(*arguments)
        if self.fails:
            raise ValueError("no")
        return answer

    async def later(self, *arguments: object) -> Any:
        await asyncio.sleep(0)
        before = CALLER.get()
        CALLER.set("changed")
        await asyncio.sleep(0)
        assert CALLER.get() == "changed"
        CALLER.set(before)
        return self.plain(*arguments)

    def coroutine(self, *arguments: object) -> Any:
        return self.later(*arguments)

    async def wait_for_all(self) -> None:
        await until(lambda: len(self.seen) == CALLS)


async def messages(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    bob.create_subscription(Int32, "n", callback)
    publisher = alice.create_publisher(Int32, "n")
    await publisher.wait_for_subscribers(20)
    CALLER.set("the publisher")
    publisher.publish(Int32())
    publisher.publish(Int32())
    await until(lambda: len(calls.seen) == 2)
    publisher.publish(Int32())
    await calls.wait_for_all()


async def requests(alice: Node, bob: Node, calls: Calls, handler: Callable[..., Any]) -> None:
    calls.answer = lambda request: SetBool.Response()
    bob.create_service(SetBool, "s", handler)
    client = alice.create_client(SetBool, "s")
    await client.wait_for_service(20)
    CALLER.set("the client")
    sent = [asyncio.ensure_future(client.call(SetBool.Request())) for _ in range(CALLS)]
    await calls.wait_for_all()
    if not calls.fails:
        await asyncio.gather(*sent)
    for request in sent:
        request.cancel()


async def ticks(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    timer = alice.create_timer(0.01, callback)
    # In the callback, where the variable is set.
    calls.answer = lambda: timer.close() if len(calls.seen) == CALLS else timer.reset()
    await calls.wait_for_all()


async def _goals(alice: Node, bob: Node, execute: Callable[[Any], Any], **options: Any) -> list[Any]:
    bob.create_action_server(Fibonacci, "fib", execute, **options)
    client = alice.create_action_client(Fibonacci, "fib")
    assert await client.wait_for_server(20)
    CALLER.set("the client")
    sent = [client.send_goal(Fibonacci.Goal(), timeout_s=20) for _ in range(CALLS)]
    return await asyncio.gather(*sent, return_exceptions=True)


async def goals(alice: Node, bob: Node, calls: Calls, execute: Callable[..., Any]) -> None:
    calls.answer = lambda goal: Fibonacci.Result()
    await _goals(alice, bob, execute, goal_policy="queue")  # the end of one goal begins the next
    await calls.wait_for_all()


async def goal_requests(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    calls.answer = lambda goal: True
    await _goals(alice, bob, lambda goal: Fibonacci.Result(), goal_callback=callback)
    await calls.wait_for_all()


async def cancel_requests(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    async def execute(goal: Any) -> Any:
        await goal.wait_for_cancel()
        return goal.canceled(Fibonacci.Result())

    calls.answer = lambda goal: True
    for goal in await _goals(alice, bob, execute, cancel_callback=callback):
        await asyncio.gather(goal.cancel(5), return_exceptions=True)
    await calls.wait_for_all()


@dataclass
class Parameters:
    a: int = 0
    b: int = 0
    c: int = 0


async def _sets(alice: Node, bob: Node, calls: Calls) -> None:
    client = alice.create_parameter_client("bob")
    assert await client.wait_for_services(20)
    CALLER.set("the client")
    await client.set({"a": 1, "b": 1, "c": 1}, 20)
    await calls.wait_for_all()


async def validations(alice: Node, bob: Node, calls: Calls, validator: Callable[..., Any]) -> None:
    bob.declare_parameters(Parameters, validator=lambda new: validator(new) if new != Parameters() else None)
    await _sets(alice, bob, calls)


async def pre_sets(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    bob.declare_parameters(Parameters)
    calls.answer = lambda parameters: parameters
    bob.add_pre_set_callback(callback)
    await _sets(alice, bob, calls)


async def on_sets(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    bob.declare_parameters(Parameters)
    calls.answer = lambda parameters: SetResult(True)
    bob.add_on_set_callback(callback)
    await _sets(alice, bob, calls)


async def post_sets(alice: Node, bob: Node, calls: Calls, callback: Callable[..., Any]) -> None:
    bob.declare_parameters(Parameters)
    bob.add_post_set_callback(callback)
    await _sets(alice, bob, calls)


KINDS = [
    *((messages, form) for form in ("plain", "later", "coroutine")),
    *((scenario, form) for scenario in (requests, ticks, goals) for form in ("plain", "later")),
    *((scenario, "plain") for scenario in (goal_requests, validations, pre_sets, on_sets, post_sets)),
    (cancel_requests, "later"),
]
kinds = pytest.mark.parametrize(("scenario", "form"), KINDS, ids=lambda value: getattr(value, "__name__", value))


@kinds
async def test_each_callback_call_has_its_own_contextvars_context(world: World, scenario: Any, form: str) -> None:
    alice, bob = world.pair()
    calls = Calls()
    await scenario(alice, bob, calls, getattr(calls, form))
    assert calls.seen == ["unset"] * CALLS


@kinds
async def test_each_callback_failure_is_logged_once(
    world: World, scenario: Any, form: str, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    calls = Calls(fails=True)

    def failures() -> list[str]:
        return [record.getMessage() for record in caplog.records if record.exc_info]

    await scenario(alice, bob, calls, getattr(calls, form))
    await until(lambda: len(failures()) >= CALLS)
    await asyncio.sleep(0.01)
    assert len(failures()) == CALLS and len(set(failures())) == 1, failures()


async def test_callback_runs_in_contextvars_context_of_its_registration(world: World) -> None:
    alice, bob = world.pair()
    calls = Calls()
    CALLER.set("its maker")
    await messages(alice, bob, calls, calls.plain)
    assert calls.seen == ["its maker"] * CALLS


async def test_async_callback_can_time_out_and_is_cancelled_on_close(world: World) -> None:
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


class Owner:
    def __init__(self) -> None:
        self.closed = False
        self.reports: list[str] = []

    def create_task(self, coroutine: Any) -> asyncio.Task[Any]:
        return start_task(asyncio.get_running_loop(), coroutine)

    def report_failure(self, doing: str) -> None:
        self.reports.append(f"{doing}: {type(sys.exc_info()[1]).__name__}")


def test_failing_on_result_function_is_reported() -> None:
    async def main() -> None:
        owner = Owner()
        assert UserCallback(owner, lambda: "x", "the callback").call(on_result=int) is None
        assert owner.reports == ["the callback: ValueError"]

    asyncio.run(main())


def test_foreign_cancellation_is_reported_and_cancellation_of_own_task_is_not() -> None:
    async def main() -> None:
        owner, foreign = Owner(), asyncio.get_running_loop().create_future()
        user = UserCallback(owner, lambda: asyncio.wait_for(foreign, 20), "the callback")
        task = user.call()
        assert task is not None
        await asyncio.sleep(0)
        foreign.cancel()
        await task
        assert owner.reports == ["the callback: CancelledError"]
        task = UserCallback(owner, lambda: asyncio.Event().wait(), "the callback").call()
        assert task is not None
        task.cancel()  # before it has begun
        with pytest.raises(asyncio.CancelledError):
            await task
        assert len(owner.reports) == 1

    asyncio.run(main())


# ------------------------------------------------------------------------------------------------- on_error="raise"

BAD = "the wheel came off"


@pytest.fixture
def context() -> Iterator[Context]:
    with Context(0, transport=MemoryTransport(), args=["test"]) as made:
        yield made


def fails(*_: object) -> Any:
    raise AssertionError(BAD)


async def publish(node: Node) -> None:
    node.create_subscription(String, "t", fails)
    node.create_publisher(String, "t").publish(String())


def set_parameter(node: Node) -> None:
    node.declare_parameter("p", 1)
    node.add_post_set_callback(fails)
    node.set_parameters({"p": 2})


@kinds
def test_run_raises_the_exception_of_any_user_function(context: Context, scenario: Any, form: str) -> None:
    alice, bob = (Node(name, context=context, on_error="raise") for name in ("alice", "bob"))

    async def main() -> None:
        calls = Calls(fails=True)
        await scenario(alice, bob, calls, getattr(calls, form))
        await asyncio.Event().wait()

    with pytest.raises(ValueError, match="no") as caught:
        run(main)
    assert caught.traceback[-1].name == "plain"


def test_time_jump_callback_failure_is_raised_with_on_error_raise(context: Context) -> None:
    with pytest.raises(AssertionError, match=BAD), Node("n", context=context, on_error="raise") as node:
        node.clock.create_jump_callback(post=fails, on_clock_change=True)
        node.clock.enable_ros_time_override()


@pytest.mark.parametrize("scenario", [messages, requests, goals, post_sets])
async def test_async_with_raises_callback_failure_on_an_asyncio_loop(context: Context, scenario: Any) -> None:
    alice, calls = Node("alice", context=context), Calls(fails=True)
    with pytest.raises(ValueError, match="no"):
        async with Node("bob", context=context, on_error="raise") as bob:
            await scenario(alice, bob, calls, calls.plain)
            await asyncio.Event().wait()
    assert bob.is_closed
    await asyncio.sleep(0)  # the cancellation is over


async def test_context_passes_on_error_to_its_nodes_and_raises_their_failures() -> None:
    with pytest.raises(AssertionError, match=BAD):
        async with Context(0, transport=MemoryTransport(), args=["test"], on_error="raise") as context:
            await publish(Node("n", context=context))
            await asyncio.Event().wait()


def test_lifecycle_callback_failure_is_raised_with_on_error_raise(context: Context) -> None:
    class Part(LifecycleNode):
        def on_configure(self, state: State) -> None:
            fails()

    node = Part("n", context=context, on_error="raise")

    async def main() -> None:
        await node.configure()
        await asyncio.Event().wait()

    with pytest.raises(AssertionError, match=BAD):
        run(main)


def test_spin_raises_callback_failure_and_closes_the_node(context: Context) -> None:
    node = Node("n", context=context, on_error="raise")
    node.create_timer(0.001, fails)
    with pytest.raises(AssertionError, match=BAD):
        spin(node)
    assert node.is_closed


def test_blocking_call_raises_callback_failure(context: Context) -> None:
    with pytest.raises(AssertionError, match=BAD), Node("n", context=context, on_error="raise") as node:
        node.create_service(SetBool, "s", fails)
        node.create_client(SetBool, "s").call_sync(SetBool.Request())


def test_pending_callback_failure_is_raised_at_end_of_with_block(context: Context) -> None:
    with pytest.raises(AssertionError, match=BAD), Node("n", context=context, on_error="raise") as node:
        set_parameter(node)


def test_one_of_two_callback_failures_is_raised(context: Context) -> None:
    def other(_: object) -> None:
        raise ValueError("and so did the door")

    with pytest.raises(ValueError, match="so did the door"), Node("n", context=context, on_error="raise") as node:
        node.declare_parameter("p", 1)
        node.add_post_set_callback(fails)
        node.add_post_set_callback(other)
        node.set_parameters({"p": 2})


async def test_exception_or_cancellation_of_the_block_takes_precedence(context: Context) -> None:
    with pytest.raises(KeyError):
        async with Node("n", context=context, on_error="raise") as node:
            set_parameter(node)
            raise KeyError("mine")

    async def wait() -> None:
        async with Node("m", context=context, on_error="raise"):
            await asyncio.Event().wait()

    task = asyncio.create_task(wait())
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


async def test_callbacks_continue_after_a_failure_by_default(context: Context) -> None:
    received: list[int] = []

    def callback(message: Int64) -> None:
        received.append(message.data)
        if message.data == 1:
            fails()

    async with Node("n", context=context) as node:
        node.create_subscription(Int64, "t", callback)
        publisher = node.create_publisher(Int64, "t")
        for number in (1, 2):
            publisher.publish(Int64(data=number))
        while len(received) < 2:
            await asyncio.sleep(0)


def test_callback_failure_in_another_thread_ends_run(context: Context) -> None:
    node = Node("n", context=context, on_error="raise")
    node.declare_parameter("p", 1)
    node.add_post_set_callback(fails)

    async def main() -> None:
        thread = threading.Thread(target=lambda: node.set_parameters({"p": 2}))
        thread.start()
        await node.clock.sleep_for(Duration(seconds=60))

    with pytest.raises(AssertionError, match=BAD):
        run(main)


def test_unknown_on_error_value_is_refused(context: Context) -> None:
    with pytest.raises(ValueError, match="'log' or 'raise', got 'ignore'"):
        Node("n", context=context, on_error="ignore")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="on_error must be"):
        Context(on_error=True)  # type: ignore[arg-type]
