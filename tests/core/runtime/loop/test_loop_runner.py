"""LoopRunner: leader, followers and the end of waits."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import os
import signal
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String
from support.waiting import wait_until

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import (
    Context,
    LoopRunner,
    MemoryTransport,
    Node,
    Publisher,
    Subscription,
    TimeRangeError,
    WaitTimeoutError,
    WouldDeadlockError,
    WrongEventLoopError,
    spin,
)
from rosidl_py_gen.runtime.loop import shared_loop
from rosidl_py_gen.runtime.loop.shared_loop import shared_loop_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.worlds import World

pytestmark = pytest.mark.on_zenoh


@pytest.fixture
def runner() -> Iterator[LoopRunner]:
    with LoopRunner() as made:
        yield made


@pytest.fixture
def node(runner: LoopRunner) -> Iterator[Node]:
    with Context(transport=MemoryTransport(), args=["test"], loop_runner=runner) as context:
        yield Node("polled", context=context)


def connected(runner: LoopRunner, node: Node) -> tuple[Publisher[String], Subscription[String]]:
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    runner.wait(lambda: publisher.subscription_count and subscription.publisher_count, timeout_s=10)
    return publisher, subscription


def run_in_thread(function: Callable[[], object]) -> Future[Any]:
    """Call a function in a new thread."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function)
    pool.shutdown(wait=False)
    return future


def is_waiting(runner: LoopRunner, waiting: int = 1) -> bool:
    return runner.loop.is_running() and len(shared_loop_of(runner).waits) == waiting


# -------------------------------------------------------------------------------------------------- contexts and nodes


@pytest.mark.every_transport
def test_callbacks_run_in_the_thread_that_waits(world: World, runner: LoopRunner) -> None:
    context = world.context(loop_runner=runner)
    polled, talker = world.node("polled", context=context), world.node("talker", context=context)
    received: list[tuple[str, int]] = []
    polled.create_subscription(String, "t", lambda message: received.append((message.data, threading.get_ident())))
    publisher = talker.create_publisher(String, "t")
    assert runner.wait(lambda: publisher.subscription_count, timeout_s=10) == 1
    publisher.publish(String(data="a"))
    assert received == []
    runner.wait(lambda: received, timeout_s=10)
    assert received == [("a", threading.get_ident())]


@pytest.mark.every_transport
def test_contexts_on_one_loop_runner_exchange_messages(world: World, runner: LoopRunner) -> None:
    one, other = (world.node(name, context=world.context(loop_runner=runner)) for name in ("one", "other"))
    publisher, subscription = one.create_publisher(String, "t"), other.create_subscription(String, "t")
    runner.wait(lambda: publisher.subscription_count and subscription.publisher_count, timeout_s=10)
    for number in range(5):
        publisher.publish(String(data=str(number)))
        assert runner.wait(subscription.take, timeout_s=10).data == str(number)
    one.context.close()
    publisher = other.create_publisher(String, "t")
    runner.wait(lambda: publisher.subscription_count, timeout_s=10)
    publisher.publish(String(data="left"))
    assert runner.wait(subscription.take, timeout_s=10).data == "left"


@pytest.mark.every_transport
def test_loop_runner_runs_sync_methods_and_coroutines(world: World, runner: LoopRunner) -> None:
    context = world.context(loop_runner=runner)
    node = world.node("both", context=context)
    node.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    client = node.create_client(AddTwoInts, "add")
    assert client.call_sync(AddTwoInts.Request(a=1, b=2), timeout_s=10).sum == 3
    assert runner.run(client.call(AddTwoInts.Request(a=3, b=4), timeout_s=10)).sum == 7
    with pytest.raises(WaitTimeoutError):
        node.create_subscription(String, "t").receive_sync(timeout_s=0.01)

    async def main() -> int:
        async with node:
            return (await client.call(AddTwoInts.Request(a=5, b=6), timeout_s=10)).sum

    assert runner.run(main()) == 11


def test_timers_and_async_callbacks_progress_during_waits(runner: LoopRunner, node: Node) -> None:
    steps: list[str] = []

    ticked = asyncio.Event()

    async def callback(message: String) -> None:
        steps.append(message.data)
        await asyncio.sleep(0)
        await ticked.wait()
        steps.append("end")

    def tick() -> None:
        steps.append("tick")
        ticked.set()

    node.create_subscription(String, "t", callback)
    node.create_timer(0.002, tick)
    node.create_publisher(String, "t").publish(String(data="begin"))
    runner.wait(timeout_s=0)
    assert steps[:1] == ["begin"]
    runner.wait(lambda: "end" in steps and steps.count("tick") >= 3, timeout_s=10)
    assert "end" in steps
    assert steps.count("tick") >= 3


def test_wait_with_zero_timeout_runs_only_pending_work(runner: LoopRunner) -> None:
    steps: list[int] = []

    async def some() -> None:
        for number in range(4):
            await asyncio.sleep(0)
            steps.append(number)

    async def endless() -> None:
        while True:
            await asyncio.sleep(0)
            steps.append(9)

    tasks = [runner.call(lambda: runner.loop.create_task(some()))]
    runner.wait(timeout_s=0)
    assert steps == [0, 1, 2, 3]
    tasks.append(runner.call(lambda: runner.loop.create_task(endless())))
    runner.wait(timeout_s=0)
    assert 3 < len(steps) < 30


# --------------------------------------------------------------------------------------------------- what ends a wait


def test_wait_returns_the_value_of_its_condition(runner: LoopRunner) -> None:
    assert runner.wait(lambda: "at once") == "at once"
    assert runner.wait(lambda: 0, timeout_s=0) == 0
    before_s = time.monotonic()
    assert runner.wait(lambda: "", timeout_s=0.02) == ""
    assert time.monotonic() - before_s >= 0.02
    assert runner.wait(timeout_s=0) is None  # type: ignore[func-returns-value]
    with pytest.raises(ZeroDivisionError):
        runner.wait(lambda: 1 / 0)
    answers = iter([0, 0, 1 / 1])
    waiting = run_in_thread(lambda: runner.wait(lambda: next(answers)))
    while not waiting.done():
        runner.wake()
    assert list(answers) == []


@pytest.mark.parametrize("limit_s", [None, 1e9, float("inf")])
def test_wake_rechecks_conditions_without_the_periodic_check(
    runner: LoopRunner, monkeypatch: pytest.MonkeyPatch, limit_s: float | None
) -> None:
    monkeypatch.setattr(shared_loop, "MAX_BLOCKING_S", 60.0)  # the check that would find the condition true, too
    done: list[int] = []
    waits = [run_in_thread(lambda: runner.wait(lambda: done, limit_s)) for _ in range(3)]
    wait_until(lambda: is_waiting(runner, 3))
    done.append(1)
    runner.wake()
    assert [one.result(10) for one in waits] == [[1]] * 3


def test_wrong_arguments_are_refused(runner: LoopRunner) -> None:
    with pytest.raises(TypeError, match=r"until must be a function, got 3 without arguments"):
        runner.wait(3)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="timeout_s"):
        runner.wait(timeout_s="1")  # type: ignore[call-overload]
    with pytest.raises(TimeRangeError, match="timeout_s must be 0 or more seconds, got -1"):
        runner.wait(timeout_s=-1)
    with pytest.raises(TypeError, match="loop_runner must be a LoopRunner, got 'x'"):
        Context(transport=MemoryTransport(), loop_runner="x")  # type: ignore[arg-type]
    function: Any = asyncio.sleep
    with pytest.raises(TypeError, match="coroutine must be a coroutine, such as main"):
        runner.run(function)


def test_messages_taken_by_conditions_in_three_threads_are_not_lost(runner: LoopRunner, node: Node) -> None:
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t", qos=1000)
    found: list[str] = []

    def take() -> None:
        while (message := runner.wait(subscription.take, timeout_s=10)).data != "end":  # type: ignore[union-attr]
            found.append(message.data)  # type: ignore[union-attr]

    threads = [run_in_thread(take) for _ in range(3)]
    for number in range(300):
        publisher.publish(String(data=str(number)))
        if number % 7 == 0:
            runner.wait(timeout_s=0)
    for _ in threads:
        publisher.publish(String(data="end"))
    for thread in threads:
        thread.result(20)
    assert sorted(map(int, found)) == list(range(300))


def test_a_wait_inside_the_loop_is_refused(runner: LoopRunner, node: Node) -> None:
    refused: list[str] = []

    def callback(_: String) -> None:
        for use in (lambda: runner.wait(timeout_s=0), lambda: runner.run(asyncio.sleep(0))):
            try:
                use()
            except WouldDeadlockError as error:
                refused.append(str(error))
        assert runner.wait(lambda: True)
        assert runner.call(lambda: "here") == "here"

    node.create_subscription(String, "t", callback)
    node.create_publisher(String, "t").publish(String())
    runner.wait(lambda: refused, timeout_s=10)
    assert len(refused) == 2
    assert "inside the runner's own event loop" in refused[0]


def test_failing_callback_ends_the_wait_with_on_error_raise(runner: LoopRunner) -> None:
    def fail(_: String) -> None:
        raise OSError("mine")

    with Context(transport=MemoryTransport(), args=["test"], loop_runner=runner, on_error="raise") as context:
        node = Node("n", context=context)
        node.create_subscription(String, "t", fail)
        node.create_publisher(String, "t").publish(String())
        with pytest.raises(OSError, match="mine"):
            runner.wait(timeout_s=10)
        assert runner.wait(timeout_s=0) is None  # type: ignore[func-returns-value]


# ------------------------------------------------------------------------------------------------------------ threads


def test_follower_takes_over_the_loop_when_the_leader_finishes(runner: LoopRunner, node: Node) -> None:
    publisher, received = node.create_publisher(String, "t"), list[str]()
    node.create_subscription(String, "t", lambda message: received.append(message.data))
    first = run_in_thread(lambda: runner.wait(lambda: "1" in received))
    wait_until(lambda: is_waiting(runner))
    second = run_in_thread(lambda: runner.wait(lambda: "2" in received))
    third = run_in_thread(lambda: runner.wait(lambda: "3" in received))
    late = run_in_thread(lambda: runner.wait(lambda: "never" in received, timeout_s=0.02))
    assert late.result(10) is False  # by its own timeout
    wait_until(lambda: is_waiting(runner, 3))
    publisher.publish(String(data="2"))  # for a follower
    assert second.result(10)
    assert is_waiting(runner, 2)
    publisher.publish(String(data="1"))  # of the runner: the third thread takes over
    assert first.result(10)
    wait_until(lambda: is_waiting(runner))
    publisher.publish(String(data="3"))
    assert third.result(10)
    assert not runner.loop.is_running()


def test_failing_condition_ends_only_its_own_wait(runner: LoopRunner) -> None:
    done: list[int] = []
    checks: list[int] = []

    def fails_later() -> bool:
        checks.append(threading.get_ident())
        if checks[0] != checks[-1]:  # in the thread of the leader
            raise OSError("mine")
        return False

    waiting = run_in_thread(lambda: runner.wait(lambda: done))
    wait_until(lambda: is_waiting(runner))
    failing = run_in_thread(lambda: runner.wait(fails_later))
    while not failing.done():
        runner.wake()
    with pytest.raises(OSError, match="mine"):
        failing.result()
    assert not waiting.done()
    done.append(1)
    runner.wake()
    assert waiting.result(10) == [1]


def test_call_runs_function_in_the_thread_that_runs_the_loop(runner: LoopRunner) -> None:
    mark: contextvars.ContextVar[str] = contextvars.ContextVar("mark", default="none")
    mark.set("mine")

    def where() -> tuple[int, bool, str]:
        return threading.get_ident(), asyncio.get_running_loop() is runner.loop, mark.get()

    assert runner.call(where) == (threading.get_ident(), True, "mine")
    stop: list[int] = []
    waiting = run_in_thread(lambda: runner.wait(lambda: stop) and threading.get_ident())
    wait_until(lambda: is_waiting(runner))
    leader, *rest = runner.call(where)
    assert rest == [True, "mine"]
    with pytest.raises(ZeroDivisionError):
        runner.call(lambda: 1 / 0)

    async def rung() -> str:
        bell = runner.loop.create_future()
        runner.loop.call_later(0.001, bell.set_result, "rung")
        return str(await bell)

    assert runner.run(rung()) == "rung"
    stop.append(1)
    runner.wake()
    assert waiting.result(10) == leader != threading.get_ident()
    with pytest.raises(ZeroDivisionError):
        runner.call(lambda: 1 / 0)

    async def fail() -> None:
        await asyncio.sleep(0)
        raise OSError("mine")

    with pytest.raises(OSError, match="mine"):
        runner.run(fail())


def test_wait_works_in_a_thread_that_runs_another_asyncio_loop(runner: LoopRunner, node: Node) -> None:
    publisher, subscription = connected(runner, node)

    async def main() -> None:
        publisher.publish(String(data="a"))
        assert runner.wait(subscription.take, timeout_s=10).data == "a"
        assert runner.wait(lambda: "", timeout_s=0) == ""
        assert runner.call(asyncio.get_running_loop) is runner.loop
        answers = iter([0, "later"])
        assert runner.wait(lambda: next(answers), timeout_s=10) == "later"
        with pytest.raises(StopIteration):
            runner.wait(lambda: next(answers))
        future = node.create_client(AddTwoInts, "none").send_request(AddTwoInts.Request())
        assert future.cancel()

    asyncio.run(main())
    assert subscription.take() is None


def test_context_with_loop_runner_refuses_other_event_loops(runner: LoopRunner, node: Node) -> None:
    publisher, subscription = connected(runner, node)

    async def main() -> None:
        publisher.publish(String(data="a"))  # attaches no loop
        with pytest.raises(WrongEventLoopError, match="this context has a LoopRunner"):
            await node.create_subscription(String, "silent").receive()
        with pytest.raises(WrongEventLoopError):
            await node.create_timer(1.0).tick()
        with pytest.raises(WrongEventLoopError, match=r"run\(main\(\)\)"):
            async with node:
                pass

    asyncio.run(main())
    assert runner.wait(subscription.take, timeout_s=10).data == "a"
    with pytest.raises(WrongEventLoopError):
        spin(node)


# ------------------------------------------------------------------------------------------------------------ signals


@contextlib.contextmanager
def handler(number: int, function: Callable[..., Any]) -> Iterator[None]:
    before = signal.signal(number, function)
    try:
        yield
    finally:
        signal.signal(number, before)


def send_when(is_so: Callable[[], object], number: int, *, interrupts_main_thread: bool = True) -> Future[Any]:
    def send() -> None:
        wait_until(is_so)
        interrupted = threading.main_thread() if interrupts_main_thread else threading.current_thread()
        signal.pthread_kill(interrupted.ident or 0, number)

    return run_in_thread(send)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.every_transport
@pytest.mark.parametrize("role", ["drives", "waits"])
@pytest.mark.parametrize("interrupts_main_thread", [True, False])
def test_ctrl_c_ends_the_wait_of_the_main_thread_only(
    world: World, runner: LoopRunner, role: str, interrupts_main_thread: bool
) -> None:
    node = world.node("polled", context=world.context(loop_runner=runner))
    publisher, subscription = connected(runner, node)
    waiting = 1
    if role == "waits":
        waiting, beside = 2, run_in_thread(lambda: runner.wait(subscription.take))
        wait_until(lambda: is_waiting(runner))
    sender = send_when(
        lambda: is_waiting(runner, waiting), signal.SIGINT, interrupts_main_thread=interrupts_main_thread
    )
    began_s = time.monotonic()
    with handler(signal.SIGINT, signal.default_int_handler), pytest.raises(KeyboardInterrupt):
        runner.wait(timeout_s=60)
    assert time.monotonic() - began_s < 30
    sender.result(10)
    if role == "drives":
        assert not runner.loop.is_running()
        beside = run_in_thread(lambda: runner.wait(subscription.take))
    publisher.publish(String(data="a"))
    assert beside.result(10).data == "a"
    publisher.publish(String(data="b"))
    assert runner.wait(subscription.take, timeout_s=10).data == "b"


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_signal_handler_can_wake_a_wait(runner: LoopRunner) -> None:
    received_signals: list[int] = []

    def on_signal(number: int, _: object) -> None:
        received_signals.append(number)
        runner.wake()

    sender = send_when(lambda: is_waiting(runner), signal.SIGUSR1)
    with handler(signal.SIGUSR1, on_signal):
        assert runner.wait(lambda: received_signals, timeout_s=20) == [signal.SIGUSR1]
    sender.result(10)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_ends_a_wait_inside_a_coroutine(runner: LoopRunner) -> None:
    sender = send_when(lambda: is_waiting(runner), signal.SIGINT)

    async def main() -> None:
        with pytest.raises(KeyboardInterrupt):
            runner.wait(timeout_s=20)
        assert runner.wait(timeout_s=0) is None  # type: ignore[func-returns-value]

    with handler(signal.SIGINT, lambda *_: signal.default_int_handler(signal.SIGINT, None)):
        asyncio.run(main())
    sender.result(10)
    assert [one.name for one in threading.enumerate() if one.name.startswith("rosidl-py-gen")] == []


def test_interrupt_during_thread_start_of_a_wait_ends_the_wait(
    runner: LoopRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        start(thread)
        wait_until(lambda: is_waiting(runner))
        raise KeyboardInterrupt  # what a signal handler does before `start` has returned

    async def main() -> None:
        with monkeypatch.context() as patch:
            patch.setattr(threading.Thread, "start", interrupted)
            with pytest.raises(KeyboardInterrupt):
                runner.wait(timeout_s=20)

    asyncio.run(main())
    assert not is_waiting(runner)
    assert [one.name for one in threading.enumerate() if one.name.startswith("rosidl-py-gen loop runner")] == []


@pytest.mark.every_transport
def test_keyboard_interrupt_of_callback_ends_wait_and_no_message_is_lost(world: World, runner: LoopRunner) -> None:
    node = world.node("polled", context=world.context(loop_runner=runner))
    publisher, subscription = connected(runner, node)
    received: list[str] = []

    def callback(message: String) -> None:
        received.append(message.data)
        if message.data == "0":
            raise KeyboardInterrupt

    node.create_subscription(String, "t", callback)
    runner.wait(lambda: publisher.subscription_count == 2, timeout_s=10)
    for number in range(3):
        publisher.publish(String(data=str(number)))
    with pytest.raises(KeyboardInterrupt):
        runner.wait(timeout_s=10)
    publisher.publish(String(data="3"))
    runner.wait(lambda: len(received) == 4, timeout_s=10)
    assert received == ["0", "1", "2", "3"]
    taken = [runner.wait(subscription.take, timeout_s=10) for _ in range(4)]
    assert [message.data for message in taken] == received


# ---------------------------------------------------------------------------------------------------------------- end


def test_closing_loop_runner_ends_all_waits(node: Node, runner: LoopRunner) -> None:
    waits = [run_in_thread(lambda: runner.wait(lambda: False)) for _ in range(3)]
    wait_until(lambda: is_waiting(runner, 3))
    task = runner.call(lambda: runner.loop.create_task(asyncio.Event().wait()))
    node.context.close()
    runner.close()
    runner.close()
    for waiting in waits:
        with pytest.raises(ClosedError, match="this LoopRunner is closed"):
            waiting.result(10)
    assert task.cancelled()
    assert runner.is_closed
    assert runner.loop.is_closed()
    runner.wake()
    assert runner.wait(lambda: "known") == "known"
    for use in (
        lambda: runner.wait(timeout_s=0),
        lambda: runner.call(list),
        lambda: runner.run(asyncio.sleep(0)),
        lambda: Context(transport=MemoryTransport(), args=["test"], loop_runner=runner),
    ):
        with pytest.raises(ClosedError, match="this LoopRunner is closed"):
            use()


def test_loop_runner_closed_inside_its_loop_closes_when_the_loop_exits(runner: LoopRunner) -> None:
    with pytest.raises(ClosedError):
        runner.run(asyncio.sleep(0, runner.call(runner.close)))
    assert runner.loop.is_closed()


def test_loop_runner_can_be_closed_before_its_contexts(runner: LoopRunner, node: Node) -> None:
    publisher, subscription = connected(runner, node)

    async def close() -> None:
        runner.close()

    asyncio.run(close())
    publisher.publish(String(data="a"))
    message = subscription.take()
    assert message is not None
    assert message.data == "a"
    with pytest.raises(ClosedError):
        subscription.receive_sync(timeout_s=1)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_child_cannot_use_the_loop_runner(runner: LoopRunner) -> None:
    child = os.fork()
    if child == 0:
        try:
            runner.wait(timeout_s=0)
        except ClosedError as error:
            os._exit(7 if "before the process was forked" in str(error) else 8)
        os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert runner.wait(lambda: "", timeout_s=0) == ""
