"""Start and end of programs: Ctrl-C once and twice, SIGTERM, running loops, nodes without loop."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import signal
import socket
import subprocess
import threading
import time
import warnings
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int32
from support.processes import python_process
from support.waiting import until

from rosidl_py_gen.base import interrupts
from rosidl_py_gen.base.interrupts import CommandInterrupts
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime import Context, MemoryTransport, Node, run, runner, spin
from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support.worlds import World

IMPORTS = """
import asyncio, select, signal, sys, threading, time
from rosidl_py_gen.runtime import Context, MemoryTransport, Node, run, spin
"""


def program(text: str) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    return python_process(IMPORTS + text)


def lines_until(process: subprocess.Popen[str], word: str) -> None:
    """Read the program's output up to a line."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.strip() == word:
            return
    assert process.stderr is not None
    raise AssertionError(f"it ended without {word!r}: {process.stderr.read()}")


def wait_for_thread_warning(process: subprocess.Popen[str]) -> None:
    """Read the log up to the warning about a thread."""
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        if "waiting for a function started by asyncio.to_thread" in line:
            break
        lines.append(line)
    else:
        raise AssertionError("the program ended without a warning about its thread")
    assert lines == []


STUCK = """
class Stuck(Node):
    def __init__(self):
        super().__init__("stuck")
        self.create_timer(0.01, self.tick)

    def tick(self):
        print("stuck", flush=True)
        signals = signal.getsignal(signal.SIGINT).__self__
        while not signals.is_stopped:
            time.sleep(0.05)
        print("asked", flush=True)  # a signal that comes earlier could be taken for the same one
        while True:
            time.sleep(0.05)

spin(Stuck())
"""


@pytest.mark.parametrize(
    ("first", "second"),
    [(signal.SIGINT, signal.SIGINT), (signal.SIGINT, signal.SIGTERM), (signal.SIGTERM, signal.SIGTERM)],
)
def test_a_second_signal_ends_a_callback_that_never_returns(first: signal.Signals, second: signal.Signals) -> None:
    with program(STUCK) as process:
        lines_until(process, "stuck")
        process.send_signal(first)
        lines_until(process, "asked")
        with pytest.raises(subprocess.TimeoutExpired):  # the first signal only requests the end
            process.wait(0.5)
        process.send_signal(second)
        output, errors = process.communicate(timeout=60)
        assert (process.returncode, output) == (-second, "")  # the callback is not called again
        if second is signal.SIGTERM:
            assert errors == ""
        else:  # the traceback shows the blocked callback
            assert "KeyboardInterrupt" in errors and "in tick" in errors
            assert "never" not in errors and "destroyed" not in errors


@pytest.mark.parametrize(("number", "uses_dds"), [(signal.SIGINT, True), (signal.SIGTERM, False)])
def test_one_signal_ends_a_waiting_program_with_cleanup(number: signal.Signals, uses_dds: bool) -> None:
    text = f"""
from rosidl_py_gen.runtime.loop import loop_binding, shared_loop
from rosidl_py_gen.runtime.transport.cyclone import domain
shared_loop._CLOSE_TIMEOUT_S = loop_binding._DRAIN_TIMEOUT_S = domain._PATIENCE_S = 60  # with calls that do not end
async def main():
    context = {"Context()" if uses_dds else "Context(transport=MemoryTransport())"}
    async with context, Node("n", context=context):
        print("up", flush=True)
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)
            print("cleaned up", flush=True)
print(run(main))
"""
    with program(text) as process:
        lines_until(process, "up")
        process.send_signal(number)
        start = time.monotonic()
        assert process.communicate(timeout=60) == ("cleaned up\nNone\n", "")
        assert process.returncode == 0
        assert time.monotonic() - start < 40


def test_ctrl_c_ends_asyncio_run_while_the_loop_waits_in_dds() -> None:
    text = """
async def main():
    async with Node("n"):
        print("up", flush=True)
        await asyncio.Event().wait()
try:
    asyncio.run(main())
except KeyboardInterrupt:
    print("interrupted")
"""
    with program(text) as process:
        lines_until(process, "up")
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == ("interrupted\n", "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_before_the_first_step_ends_run_without_running_main(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    set_event_loop = asyncio.set_event_loop
    steps: list[int] = []

    def signalled(loop: asyncio.AbstractEventLoop | None) -> None:
        set_event_loop(loop)
        if loop is not None:
            signal.raise_signal(number)  # the handlers are in place, the task is not

    async def main() -> str:
        steps.append(1)
        return "ran"

    monkeypatch.setattr(asyncio, "set_event_loop", signalled)
    assert run(main) is None
    assert steps == []


GIVEN_TO_THE_THREAD = "signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})"  # it has begun, with its own mask


@pytest.mark.parametrize("first", ["pass", GIVEN_TO_THE_THREAD], ids=["as the kernel likes", "another thread gets it"])
def test_ctrl_c_waits_for_running_thread_with_a_warning(first: str) -> None:
    text = f"""
begin = threading.Event()
def work():
    begin.wait()
    time.sleep(0.2)  # until the loop waits
    print("working", flush=True)
    select.select([sys.stdin], [], [], 30)
    print("worked", flush=True)
async def main():
    async with Node("n"):
        task = asyncio.create_task(asyncio.to_thread(work))
        await asyncio.sleep(0)
        {first}
        begin.set()
        await task
run(main)
print(signal.set_wakeup_fd(-1))
"""
    with program(text) as process:
        lines_until(process, "working")
        process.send_signal(signal.SIGINT)
        wait_for_thread_warning(process)
        assert process.communicate("\n", timeout=60) == ("worked\n-1\n", "")
        assert process.returncode == 0


def test_second_ctrl_c_during_thread_work_ends_without_traceback() -> None:
    text = """
def work():
    print("working", flush=True)
    threading.Event().wait()
async def main():
    async with Node("n"):
        await asyncio.to_thread(work)
run(main)
"""
    with program(text) as process:
        lines_until(process, "working")
        process.send_signal(signal.SIGINT)
        wait_for_thread_warning(process)  # the first signal has been handled
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
        assert (process.returncode, errors) == (-signal.SIGINT, "")


async def interrupted_twice() -> None:
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)
    await asyncio.Event().wait()


def test_immediate_second_ctrl_c_counts_as_one_request() -> None:
    assert run(interrupted_twice) is None


def test_second_ctrl_c_is_ignored_if_a_command_ignores_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    handler = CommandInterrupts()
    handler.ignores_first = True
    monkeypatch.setattr(runner, "command_interrupts", handler)
    monkeypatch.setattr(interrupts, "REPEAT_S", -1.0)
    before = signal.signal(signal.SIGINT, handler)
    try:
        assert run(interrupted_twice) is None
    finally:
        signal.signal(signal.SIGINT, before)


def test_draining_an_empty_signal_socket_does_not_fail() -> None:
    reading, writing = socket.socketpair()
    with reading, writing:
        reading.setblocking(False)
        writing.send(b"2")
        runner.drain(reading)
        runner.drain(reading)


def test_run_restores_signal_handlers() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    seen = []

    async def main() -> None:
        seen.append((signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)))

    run(main)
    assert seen and seen[0] != before
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_task_failure_while_run_ends_is_logged_and_result_is_returned(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def fails() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            raise ValueError("while ending")

    async def main() -> int:
        task = asyncio.create_task(fails())
        await asyncio.sleep(0)
        return 1 if not task.done() else 0

    assert run(main) == 1
    assert "a task failed while the program ended" in caplog.text and "while ending" in caplog.text


def test_callback_tasks_started_while_run_waits_for_threads_are_cancelled(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    began = threading.Event()
    ends = []

    async def tick() -> None:
        began.set()
        try:
            await asyncio.Event().wait()
        finally:
            ends.append(threading.current_thread())

    async def main() -> None:
        asyncio.get_running_loop().run_in_executor(None, began.wait, 30)
        node.create_timer(0.02, tick)

    node = memory.node("n")
    run(main)
    assert began.is_set() and set(ends) == {threading.current_thread()}
    gc.collect()
    assert not caplog.records


async def test_run_and_spin_in_a_running_loop_raise_and_close_no_node(memory: World) -> None:
    with Node("shared") as shared:
        node = memory.node("n")

        async def main() -> None:
            raise AssertionError("not to be run")

        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for what in (main, main()):
                with pytest.raises(WrongEventLoopError, match=r"`await main\(\)`"):
                    run(what)
            with pytest.raises(WrongEventLoopError, match=r"`async with node: await asyncio\.Event\(\)\.wait\(\)`"):
                spin(node)
        assert not node.is_closed and not shared.is_closed and not shared.context.is_closed
    assert issubclass(WrongEventLoopError, RosidlError)


@pytest.mark.parametrize("bad", [5, None, "main", lambda: 5])
def test_run_refuses_values_that_are_not_async_functions_or_coroutines(bad: Any) -> None:
    with pytest.raises(TypeError, match="run takes an async function without arguments, or a coroutine, got"):
        run(bad)


@pytest.mark.parametrize("bad", [5, None, "n", Node])
def test_spin_refuses_values_that_are_not_nodes(bad: Any) -> None:
    with pytest.raises(TypeError, match="spin takes nodes, got"):
        spin(bad)
    with pytest.raises(TypeError, match="at least one node"):
        spin()


@pytest.mark.every_transport
def test_run_and_spin_serve_nodes_created_before_the_loop(world: World) -> None:
    alice, bob = world.pair()
    seen: list[int] = []
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        publisher.publish(Int32(data=ticks))

    bob.create_subscription(Int32, "n", lambda message: seen.append(message.data))
    publisher = alice.create_publisher(Int32, "n")
    alice.create_timer(0.02, tick)

    async def main() -> None:
        while len(seen) < 3:
            await asyncio.sleep(0.01)

    run(lambda: asyncio.wait_for(main(), 20))
    assert ticks >= 3
    assert not alice.is_closed and not bob.is_closed
    seen.clear()

    def enough() -> None:
        if len(seen) >= 3:
            alice.close()
            bob.close()

    bob.create_timer(0.02, enough)
    spin(alice, bob)
    assert len(seen) >= 3


@pytest.mark.parametrize(
    "use",
    [
        lambda node: node.create_publisher(Int32, "other"),
        lambda node: node.get_node_names(),
        lambda node: node.count_publishers("t"),
    ],
    ids=["create", "graph", "count"],
)
def test_using_a_node_inside_a_running_loop_attaches_the_loop(memory: World, use: Callable[[Node], object]) -> None:
    node = memory.node("n")
    ticked = []
    node.create_timer(0.01, lambda: ticked.append(1))

    async def main() -> None:
        use(node)
        await until(lambda: ticked)

    asyncio.run(main())


def test_node_whose_callbacks_never_ran_is_warned_about_once(memory: World, caplog: pytest.LogCaptureFixture) -> None:
    node, quiet = memory.node("n"), memory.node("quiet")
    node.create_subscription(Int32, "t", print)
    node.create_timer(0.01, print)
    quiet.create_publisher(Int32, "t")

    async def main() -> None:
        await asyncio.sleep(0.05)  # the timer is due within this time

    with caplog.at_level(logging.WARNING):
        asyncio.run(main())
        for _ in range(2):
            node.close()
            quiet.close()
    (line,) = (record.getMessage() for record in caplog.records)
    assert line.startswith("the callbacks of /n never ran: no event loop has served the node")
    assert "spin(node)" in line and "run(main)" in line and "async with" in line


def test_callbacks_that_never_ran_are_warned_about_at_process_exit() -> None:
    with program('node = Node("n")\nnode.create_timer(0.1, print)\nasyncio.run(asyncio.sleep(0))\n') as process:
        output, errors = process.communicate(timeout=60)
        assert (output, process.returncode) == ("", 0)
        assert errors.count("the callbacks of /n never ran") == 1


def test_using_one_fixture_node_serves_all_nodes_of_the_fixture(ros_node: Callable[..., Node]) -> None:
    silent, awaited = ros_node("silent"), ros_node("awaited")
    ticked = []
    silent.create_timer(0.01, lambda: ticked.append(1))

    async def main() -> None:
        assert await awaited.wait_for_node("silent", timeout_s=10)
        await until(lambda: ticked)
        ros_node("later").create_timer(0.01, lambda: ticked.append(2))
        await until(lambda: 2 in ticked)

    asyncio.run(main())


def test_invalid_ros_arguments_end_run_with_a_one_line_error(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("/**: {ros__parameters: {a: [1, }")
    for arguments, reason in [
        (["--params-file", str(file)], f"error: ROS argument --params-file '{file}': {file}:1:32: "),
        (["-p", "a"], "error: ROS argument -p 'a': there is no ':='"),
        (["-p", "a:=text"], "error: parameter 'a' is of type STRING, expected INTEGER; the value is from -p a:=text"),
    ]:

        async def main(arguments: list[str] = ["--ros-args", *arguments]) -> None:  # noqa: B006
            with Context(args=arguments, transport=MemoryTransport()) as context:
                async with Node("n", context=context) as node:
                    node.declare_parameter("a", 1)

        with pytest.raises(SystemExit) as end:
            run(main)
        assert str(end.value.code).startswith(reason)
        assert "\n" not in str(end.value.code)
        assert end.value.__suppress_context__
