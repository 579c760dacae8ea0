"""LoopRunner: leader, followers, and ends of waits."""

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
from support.node_fixtures import wait_until

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

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.node_fixtures import World


@pytest.fixture
def driver() -> Iterator[LoopRunner]:
    with LoopRunner() as made:
        yield made


@pytest.fixture
def node(driver: LoopRunner) -> Iterator[Node]:
    with Context(transport=MemoryTransport(), args=["test"], loop_runner=driver) as context:
        yield Node("polled", context=context)


def connected(driver: LoopRunner, node: Node) -> tuple[Publisher[String], Subscription[String]]:
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t")
    driver.wait(lambda: publisher.subscription_count and subscription.publisher_count, timeout_s=10)
    return publisher, subscription


def started(function: Callable[[], object]) -> Future[Any]:
    """Call a function in a thread of its own."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function)
    pool.shutdown(wait=False)
    return future


def is_driven(driver: LoopRunner, waiting: int = 1) -> bool:
    return driver.loop.is_running() and len(driver._shared_loop.waits) == waiting


# ------------------------------------------------------------------------------------------------------ who is served


@pytest.mark.every_transport
def test_what_arrives_is_taken_in_while_somebody_waits(world: World, driver: LoopRunner) -> None:
    context = world.context(loop_runner=driver)
    polled, talker = world.node("polled", context=context), world.node("talker", context=context)
    heard: list[tuple[str, int]] = []
    polled.create_subscription(String, "t", lambda message: heard.append((message.data, threading.get_ident())))
    publisher = talker.create_publisher(String, "t")
    assert driver.wait(lambda: publisher.subscription_count, timeout_s=10) == 1
    publisher.publish(String(data="a"))
    assert heard == []
    driver.wait(lambda: heard, timeout_s=10)
    assert heard == [("a", threading.get_ident())]


@pytest.mark.every_transport
def test_contexts_that_are_served_by_one_driver_talk_to_each_other(world: World, driver: LoopRunner) -> None:
    one, other = (world.node(name, context=world.context(loop_runner=driver)) for name in ("one", "other"))
    publisher, subscription = one.create_publisher(String, "t"), other.create_subscription(String, "t")
    driver.wait(lambda: publisher.subscription_count and subscription.publisher_count, timeout_s=10)
    for number in range(5):
        publisher.publish(String(data=str(number)))
        assert driver.wait(subscription.take, timeout_s=10).data == str(number)
    one.context.close()
    publisher = other.create_publisher(String, "t")
    driver.wait(lambda: publisher.subscription_count, timeout_s=10)
    publisher.publish(String(data="left"))
    assert driver.wait(subscription.take, timeout_s=10).data == "left"


@pytest.mark.every_transport
def test_blocking_methods_and_coroutines_run_in_it(world: World, driver: LoopRunner) -> None:
    context = world.context(loop_runner=driver)
    node = world.node("both", context=context)
    node.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    client = node.create_client(AddTwoInts, "add")
    assert client.call_sync(AddTwoInts.Request(a=1, b=2), timeout_s=10).sum == 3
    assert driver.run(client.call(AddTwoInts.Request(a=3, b=4), timeout_s=10)).sum == 7
    with pytest.raises(WaitTimeoutError):
        node.create_subscription(String, "t").receive_sync(timeout_s=0.01)

    async def main() -> int:
        async with node:
            return (await client.call(AddTwoInts.Request(a=5, b=6), timeout_s=10)).sum

    assert driver.run(main()) == 11


def test_timers_and_async_callbacks_go_on_with_each_wait(driver: LoopRunner, node: Node) -> None:
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
    driver.wait(timeout_s=0)
    assert steps[:1] == ["begin"]
    driver.wait(lambda: "end" in steps and steps.count("tick") >= 3, timeout_s=10)
    assert "end" in steps
    assert steps.count("tick") >= 3


def test_a_time_limit_of_0_does_what_there_is_to_do_and_no_more(driver: LoopRunner) -> None:
    steps: list[int] = []

    async def some() -> None:
        for number in range(4):
            await asyncio.sleep(0)
            steps.append(number)

    async def endless() -> None:
        while True:
            await asyncio.sleep(0)
            steps.append(9)

    tasks = [driver.call(lambda: driver.loop.create_task(some()))]
    driver.wait(timeout_s=0)
    assert steps == [0, 1, 2, 3]
    tasks.append(driver.call(lambda: driver.loop.create_task(endless())))
    driver.wait(timeout_s=0)
    assert 3 < len(steps) < 30


# --------------------------------------------------------------------------------------------------- what ends a wait


def test_the_answer_is_that_of_the_condition(driver: LoopRunner) -> None:
    assert driver.wait(lambda: "at once") == "at once"
    assert driver.wait(lambda: 0, timeout_s=0) == 0
    before_s = time.monotonic()
    assert driver.wait(lambda: "", timeout_s=0.02) == ""
    assert time.monotonic() - before_s >= 0.02
    assert driver.wait(timeout_s=0) is None  # type: ignore[func-returns-value]
    with pytest.raises(ZeroDivisionError):
        driver.wait(lambda: 1 / 0)
    answers = iter([0, 0, 1 / 1])
    waiting = started(lambda: driver.wait(lambda: next(answers)))
    while not waiting.done():
        driver.wake()
    assert list(answers) == []


@pytest.mark.parametrize("limit_s", [None, 1e9, float("inf")])
def test_a_wake_up_is_not_left_to_the_periodic_check(
    driver: LoopRunner, monkeypatch: pytest.MonkeyPatch, limit_s: float | None
) -> None:
    monkeypatch.setattr(shared_loop, "MAX_BLOCKING_S", 60.0)  # the check that would find the condition true, too
    done: list[int] = []
    waits = [started(lambda: driver.wait(lambda: done, limit_s)) for _ in range(3)]
    wait_until(lambda: is_driven(driver, 3))
    done.append(1)
    driver.wake()
    assert [one.result(10) for one in waits] == [[1]] * 3


def test_wrong_arguments_are_refused(driver: LoopRunner) -> None:
    with pytest.raises(TypeError, match=r"until must be a function, got 3 without arguments"):
        driver.wait(3)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="timeout_s"):
        driver.wait(timeout_s="1")  # type: ignore[call-overload]
    with pytest.raises(TimeRangeError, match="timeout_s must be 0 or more seconds, got -1"):
        driver.wait(timeout_s=-1)
    with pytest.raises(TypeError, match="loop_runner must be a LoopRunner, got 'x'"):
        Context(transport=MemoryTransport(), loop_runner="x")  # type: ignore[arg-type]
    function: Any = asyncio.sleep
    with pytest.raises(TypeError, match="coroutine must be a coroutine, such as main"):
        driver.run(function)


def test_what_a_condition_takes_is_not_lost_between_threads(driver: LoopRunner, node: Node) -> None:
    publisher, subscription = node.create_publisher(String, "t"), node.create_subscription(String, "t", qos=1000)
    found: list[str] = []

    def take() -> None:
        while (message := driver.wait(subscription.take, timeout_s=10)).data != "end":  # type: ignore[union-attr]
            found.append(message.data)  # type: ignore[union-attr]

    threads = [started(take) for _ in range(3)]
    for number in range(300):
        publisher.publish(String(data=str(number)))
        if number % 7 == 0:
            driver.wait(timeout_s=0)
    for _ in threads:
        publisher.publish(String(data="end"))
    for thread in threads:
        thread.result(20)
    assert sorted(map(int, found)) == list(range(300))


def test_a_wait_inside_the_loop_is_refused(driver: LoopRunner, node: Node) -> None:
    refused: list[str] = []

    def callback(_: String) -> None:
        for use in (lambda: driver.wait(timeout_s=0), lambda: driver.run(asyncio.sleep(0))):
            try:
                use()
            except WouldDeadlockError as error:
                refused.append(str(error))
        assert driver.wait(lambda: True)
        assert driver.call(lambda: "here") == "here"

    node.create_subscription(String, "t", callback)
    node.create_publisher(String, "t").publish(String())
    driver.wait(lambda: refused, timeout_s=10)
    assert len(refused) == 2
    assert "inside the runner's own event loop" in refused[0]


def test_a_callback_that_fails_ends_the_wait_where_that_is_asked_for(driver: LoopRunner) -> None:
    def fail(_: String) -> None:
        raise OSError("mine")

    with Context(transport=MemoryTransport(), args=["test"], loop_runner=driver, on_error="raise") as context:
        node = Node("n", context=context)
        node.create_subscription(String, "t", fail)
        node.create_publisher(String, "t").publish(String())
        with pytest.raises(OSError, match="mine"):
            driver.wait(timeout_s=10)
        assert driver.wait(timeout_s=0) is None  # type: ignore[func-returns-value]


# ------------------------------------------------------------------------------------------------------------ threads


def test_one_drives_the_others_wait_and_one_takes_over(driver: LoopRunner, node: Node) -> None:
    publisher, heard = node.create_publisher(String, "t"), list[str]()
    node.create_subscription(String, "t", lambda message: heard.append(message.data))
    first = started(lambda: driver.wait(lambda: "1" in heard))
    wait_until(lambda: is_driven(driver))
    second = started(lambda: driver.wait(lambda: "2" in heard))
    third = started(lambda: driver.wait(lambda: "3" in heard))
    late = started(lambda: driver.wait(lambda: "never" in heard, timeout_s=0.02))
    assert late.result(10) is False  # by its own limit
    wait_until(lambda: is_driven(driver, 3))
    publisher.publish(String(data="2"))  # of one that waits beside
    assert second.result(10)
    assert is_driven(driver, 2)
    publisher.publish(String(data="1"))  # of the driver: the third goes on
    assert first.result(10)
    wait_until(lambda: is_driven(driver))
    publisher.publish(String(data="3"))
    assert third.result(10)
    assert not driver.loop.is_running()


def test_a_condition_that_fails_concerns_its_own_wait_only(driver: LoopRunner) -> None:
    done: list[int] = []
    looks: list[int] = []

    def fails_later() -> bool:
        looks.append(threading.get_ident())
        if looks[0] != looks[-1]:  # in the thread that drives
            raise OSError("mine")
        return False

    waiting = started(lambda: driver.wait(lambda: done))
    wait_until(lambda: is_driven(driver))
    failing = started(lambda: driver.wait(fails_later))
    while not failing.done():
        driver.wake()
    with pytest.raises(OSError, match="mine"):
        failing.result()
    assert not waiting.done()
    done.append(1)
    driver.wake()
    assert waiting.result(10) == [1]


def test_a_function_is_called_in_the_loop_by_whoever_runs_it(driver: LoopRunner) -> None:
    mark: contextvars.ContextVar[str] = contextvars.ContextVar("mark", default="none")
    mark.set("mine")

    def where() -> tuple[int, bool, str]:
        return threading.get_ident(), asyncio.get_running_loop() is driver.loop, mark.get()

    assert driver.call(where) == (threading.get_ident(), True, "mine")
    stop: list[int] = []
    waiting = started(lambda: driver.wait(lambda: stop) and threading.get_ident())
    wait_until(lambda: is_driven(driver))
    leader, *rest = driver.call(where)
    assert rest == [True, "mine"]
    with pytest.raises(ZeroDivisionError):
        driver.call(lambda: 1 / 0)

    async def rung() -> str:
        bell = driver.loop.create_future()
        driver.loop.call_later(0.001, bell.set_result, "rung")
        return str(await bell)

    assert driver.run(rung()) == "rung"
    stop.append(1)
    driver.wake()
    assert waiting.result(10) == leader != threading.get_ident()
    with pytest.raises(ZeroDivisionError):
        driver.call(lambda: 1 / 0)

    async def fail() -> None:
        await asyncio.sleep(0)
        raise OSError("mine")

    with pytest.raises(OSError, match="mine"):
        driver.run(fail())


def test_a_thread_whose_own_loop_runs_is_served_too(driver: LoopRunner, node: Node) -> None:
    publisher, subscription = connected(driver, node)

    async def main() -> None:
        publisher.publish(String(data="a"))
        assert driver.wait(subscription.take, timeout_s=10).data == "a"
        assert driver.wait(lambda: "", timeout_s=0) == ""
        assert driver.call(asyncio.get_running_loop) is driver.loop
        answers = iter([0, "later"])
        assert driver.wait(lambda: next(answers), timeout_s=10) == "later"
        with pytest.raises(StopIteration):
            driver.wait(lambda: next(answers))
        future = node.create_client(AddTwoInts, "none").send_request(AddTwoInts.Request())
        assert future.cancel()

    asyncio.run(main())
    assert subscription.take() is None


def test_no_other_loop_takes_the_context(driver: LoopRunner, node: Node) -> None:
    publisher, subscription = connected(driver, node)

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
    assert driver.wait(subscription.take, timeout_s=10).data == "a"
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

    return started(send)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.every_transport
@pytest.mark.parametrize("role", ["drives", "waits"])
@pytest.mark.parametrize("interrupts_main_thread", [True, False])
def test_ctrl_c_ends_the_wait_of_the_main_thread_and_others_go_on(
    world: World, driver: LoopRunner, role: str, interrupts_main_thread: bool
) -> None:
    node = world.node("polled", context=world.context(loop_runner=driver))
    publisher, subscription = connected(driver, node)
    waiting = 1
    if role == "waits":
        waiting, beside = 2, started(lambda: driver.wait(subscription.take))
        wait_until(lambda: is_driven(driver))
    sender = send_when(lambda: is_driven(driver, waiting), signal.SIGINT, interrupts_main_thread=interrupts_main_thread)
    began_s = time.monotonic()
    with handler(signal.SIGINT, signal.default_int_handler), pytest.raises(KeyboardInterrupt):
        driver.wait(timeout_s=60)
    assert time.monotonic() - began_s < 30
    sender.result(10)
    if role == "drives":
        assert not driver.loop.is_running()
        beside = started(lambda: driver.wait(subscription.take))
    publisher.publish(String(data="a"))
    assert beside.result(10).data == "a"
    publisher.publish(String(data="b"))
    assert driver.wait(subscription.take, timeout_s=10).data == "b"


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_handler_may_wake(driver: LoopRunner) -> None:
    came: list[int] = []

    def on_signal(number: int, _: object) -> None:
        came.append(number)
        driver.wake()

    sender = send_when(lambda: is_driven(driver), signal.SIGUSR1)
    with handler(signal.SIGUSR1, on_signal):
        assert driver.wait(lambda: came, timeout_s=20) == [signal.SIGUSR1]
    sender.result(10)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_ends_a_wait_in_a_coroutine(driver: LoopRunner) -> None:
    sender = send_when(lambda: is_driven(driver), signal.SIGINT)

    async def main() -> None:
        with pytest.raises(KeyboardInterrupt):
            driver.wait(timeout_s=20)
        assert driver.wait(timeout_s=0) is None  # type: ignore[func-returns-value]

    with handler(signal.SIGINT, lambda *_: signal.default_int_handler(signal.SIGINT, None)):
        asyncio.run(main())
    sender.result(10)
    assert [one.name for one in threading.enumerate() if one.name.startswith("rosidl-py-gen")] == []


def test_an_interrupt_while_the_thread_of_a_wait_begins_ends_it(
    driver: LoopRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        start(thread)
        wait_until(lambda: is_driven(driver))
        raise KeyboardInterrupt  # what a signal handler does before `start` has returned

    async def main() -> None:
        with monkeypatch.context() as patch:
            patch.setattr(threading.Thread, "start", interrupted)
            with pytest.raises(KeyboardInterrupt):
                driver.wait(timeout_s=20)

    asyncio.run(main())
    assert not is_driven(driver)
    assert [one.name for one in threading.enumerate() if one.name.startswith("rosidl-py-gen loop runner")] == []


@pytest.mark.every_transport
def test_what_a_callback_raises_to_end_the_program_comes_out_and_the_rest_is_not_lost(
    world: World, driver: LoopRunner
) -> None:
    node = world.node("polled", context=world.context(loop_runner=driver))
    publisher, subscription = connected(driver, node)
    heard: list[str] = []

    def callback(message: String) -> None:
        heard.append(message.data)
        if message.data == "0":
            raise KeyboardInterrupt

    node.create_subscription(String, "t", callback)
    driver.wait(lambda: publisher.subscription_count == 2, timeout_s=10)
    for number in range(3):
        publisher.publish(String(data=str(number)))
    with pytest.raises(KeyboardInterrupt):
        driver.wait(timeout_s=10)
    publisher.publish(String(data="3"))
    driver.wait(lambda: len(heard) == 4, timeout_s=10)
    assert heard == ["0", "1", "2", "3"]
    taken = [driver.wait(subscription.take, timeout_s=10) for _ in range(4)]
    assert [message.data for message in taken] == heard


# ---------------------------------------------------------------------------------------------------------------- end


def test_closing_ends_all_waits(node: Node, driver: LoopRunner) -> None:
    waits = [started(lambda: driver.wait(lambda: False)) for _ in range(3)]
    wait_until(lambda: is_driven(driver, 3))
    task = driver.call(lambda: driver.loop.create_task(asyncio.Event().wait()))
    node.context.close()
    driver.close()
    driver.close()
    for waiting in waits:
        with pytest.raises(ClosedError, match="this LoopRunner is closed"):
            waiting.result(10)
    assert task.cancelled()
    assert driver.is_closed
    assert driver.loop.is_closed()
    driver.wake()
    assert driver.wait(lambda: "known") == "known"
    for use in (
        lambda: driver.wait(timeout_s=0),
        lambda: driver.call(list),
        lambda: driver.run(asyncio.sleep(0)),
        lambda: Context(transport=MemoryTransport(), args=["test"], loop_runner=driver),
    ):
        with pytest.raises(ClosedError, match="this LoopRunner is closed"):
            use()


def test_closing_inside_the_loop_takes_place_when_it_is_left(driver: LoopRunner) -> None:
    with pytest.raises(ClosedError):
        driver.run(asyncio.sleep(0, driver.call(driver.close)))
    assert driver.loop.is_closed()


def test_a_driver_may_be_closed_before_its_contexts(driver: LoopRunner, node: Node) -> None:
    publisher, subscription = connected(driver, node)

    async def close() -> None:
        driver.close()

    asyncio.run(close())
    publisher.publish(String(data="a"))
    message = subscription.take()
    assert message is not None
    assert message.data == "a"
    with pytest.raises(ClosedError):
        subscription.receive_sync(timeout_s=1)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_child_cannot_use_it(driver: LoopRunner) -> None:
    child = os.fork()
    if child == 0:
        try:
            driver.wait(timeout_s=0)
        except ClosedError as error:
            os._exit(7 if "before the process was forked" in str(error) else 8)
        os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert driver.wait(lambda: "", timeout_s=0) == ""
