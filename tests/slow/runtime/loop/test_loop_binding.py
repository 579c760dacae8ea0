"""Binding of a context to an event loop, and delivery of samples through the transport's wakeup pipe."""

from __future__ import annotations

import asyncio
import ctypes as ct
import importlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int32
from std_srvs.srv import SetBool
from support.folders import ROOT
from support.inner_state import participant_of, reader_of
from support.waiting import rests, until

from rosidl_py_gen.runtime import CallTimeoutError
from rosidl_py_gen.runtime.loop.event_loop import EventLoop, end_tasks
from rosidl_py_gen.runtime.node.context import attach_all, core_of
from rosidl_py_gen.runtime.transport.cyclone import endpoints
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from support.worlds import World

    from rosidl_py_gen.runtime import Node


class LoopWithoutReaders(asyncio.SelectorEventLoop):
    def add_reader(self, *_: Any) -> None:  # type: ignore[override]
        raise NotImplementedError


def run_on(kind: str, main: Coroutine[Any, Any, None]) -> None:
    async def attach_and_run() -> None:
        attach_all()
        await main

    makers: dict[str, Callable[[], asyncio.AbstractEventLoop]] = {
        "ours": EventLoop,
        "asyncio": asyncio.SelectorEventLoop,
        "uvloop": lambda: importlib.import_module("uvloop").new_event_loop(),
        "no readers": LoopWithoutReaders,
    }
    loop = makers[kind]()
    try:
        loop.run_until_complete(asyncio.wait_for(attach_and_run(), 20))
    finally:
        end_tasks(loop)  # Ctrl-C leaves them
        loop.close()


UVLOOP = pytest.param("uvloop", marks=pytest.mark.needs("uvloop"))
loops = pytest.mark.parametrize("kind", ["ours", "asyncio", UVLOOP, "no readers"])


def threads() -> list[str]:
    return sorted(thread.name for thread in threading.enumerate() if thread.name.startswith("rosidl-py-gen"))


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def numbers(node: Node, topic: str = "n", **options: Any) -> list[int]:
    received: list[int] = []
    node.create_subscription(Int32, topic, lambda message: received.append(message.data), **options)
    return received


# --------------------------------------------------------------------------------------------------------- every loop


@loops
def test_three_contexts_on_one_loop_receive_all_messages(dds: World, kind: str) -> None:
    nodes = [dds.node(f"n{number}") for number in range(3)]
    received = [numbers(node) for node in nodes]
    publisher = nodes[0].create_publisher(Int32, "n")

    async def main() -> None:
        await publisher.wait_for_subscribers(timeout_s=20, count=3)
        for number in range(5):
            publisher.publish(Int32(data=number))
            await asyncio.to_thread(publisher.publish, Int32(data=number + 10))
        await until(lambda: all(len(one) == 10 for one in received))
        assert threads() == (["rosidl-py-gen receiver"] * 3 if kind == "no readers" else [])

    run_on(kind, main())


@loops
def test_services_and_discovery_work_on_consecutive_event_loops_of_one_process(dds: World, kind: str) -> None:
    server, caller = dds.pair()
    client = caller.create_client(SetBool, "set")

    async def main() -> None:
        service = server.create_service(SetBool, "set", lambda request: SetBool.Response(success=request.data))
        assert await client.wait_for_service(timeout_s=20)
        assert (await client.call(SetBool.Request(data=True), timeout_s=20)).success
        service.close()
        await until(lambda: not client.service_is_available())

    with pytest.raises(CallTimeoutError):
        client.call_sync(SetBool.Request(), timeout_s=0.05)
    for each in (kind, "asyncio", kind):
        run_on(each, main())


@loops
def test_samples_received_without_running_loop_are_delivered_by_next_loop(dds: World, kind: str) -> None:
    alice, bob = dds.pair()
    publisher, received = alice.create_publisher(Int32, "n"), numbers(bob)

    async def main(number: int) -> None:
        await publisher.wait_for_subscribers(timeout_s=20)
        await until(lambda: number == 0 or received)

    run_on("asyncio", main(0))
    publisher.publish(Int32(data=1))
    run_on(kind, main(1))
    assert received == [1]


@loops
def test_another_thread_can_close_a_context_of_a_running_loop(dds: World, kind: str) -> None:
    before = descriptors()

    async def main() -> None:
        for _ in range(3):
            left, right = dds.context(), dds.context()
            received = numbers(dds.node("right", context=right))
            publisher = dds.node("left", context=left).create_publisher(Int32, "n")
            await publisher.wait_for_subscribers(timeout_s=20)
            publisher.publish(Int32(data=1))
            while not received:
                await asyncio.sleep(0.01)
            await asyncio.to_thread(right.close)
            await asyncio.to_thread(left.close)
            await asyncio.sleep(0)

    run_on(kind, main())
    assert threads() == []
    assert descriptors() <= before + 1


def test_receiver_thread_is_used_if_loops_cannot_watch_pipes(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoints, "LOOPS_CAN_WATCH", False)  # as on Windows
    alice, bob = dds.pair()
    assert threads() == ["rosidl-py-gen receiver"] * 2
    received = numbers(bob, qos=1)
    publisher = alice.create_publisher(Int32, "n")
    for number in range(20_000):  # more than the pipe holds, before there is a loop
        publisher.publish(Int32(data=number))

    async def main() -> None:
        await until(lambda: received)

    run_on("asyncio", main())
    assert received == [19_999]


@pytest.mark.needs("uvloop")
def test_call_sync_works_on_uvloop(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    import uvloop

    monkeypatch.setattr(asyncio, "new_event_loop", uvloop.new_event_loop)
    node = dds.node("n")
    node.create_service(SetBool, "set", lambda request: SetBool.Response(success=request.data))
    assert node.create_client(SetBool, "set").call_sync(SetBool.Request(data=True), timeout_s=20).success
    assert threads() == []


# ---------------------------------------------------------------------------------------------------------- the pipe


async def test_wakeup_of_reader_without_samples_calls_no_callback(dds: World) -> None:
    alice, bob = dds.pair()
    publisher, received = alice.create_publisher(Int32, "n"), numbers(bob)
    await publisher.wait_for_subscribers(timeout_s=20)
    publisher.publish(Int32(data=1))
    await until(lambda: received)
    participant: Any = participant_of(bob)
    for entity in (*participant.readers, 12345):
        participant.pipe.notify(entity)
    publisher.publish(Int32(data=2))  # arrives through the pipe after these handles
    await until(lambda: received[-1] == 2)
    assert received == [1, 2]


def test_samples_are_delivered_although_the_wakeup_pipe_overflowed(dds: World) -> None:
    context = dds.context()
    node = dds.node("n", context=context)
    participant: Any = core_of(context).participant
    crowd, single = numbers(node, "crowd", qos=1), numbers(node, "single")
    to_crowd, to_single = node.create_publisher(Int32, "crowd"), node.create_publisher(Int32, "single")

    async def main() -> None:
        await until(lambda: crowd and single)

    for _ in range(2):  # the second time the stream had its error
        for number in range(17_000):  # 16384 handles fill 64 KiB
            to_crowd.publish(Int32(data=number))
        assert endpoints.ferror(participant.pipe.stream)
        to_single.publish(Int32(data=1))
        run_on("asyncio", main())
        assert (crowd, single) == ([16_999], [1])
        assert not endpoints.ferror(participant.pipe.stream)
        crowd.clear()
        single.clear()


def test_deleting_a_reader_waits_for_its_listener(dds: World) -> None:
    node = dds.node("n")
    subscription, publisher = node.create_subscription(Int32, "n"), node.create_publisher(Int32, "n")
    entered, left = threading.Event(), threading.Event()

    def slow(_reader: int, _argument: int | None) -> None:
        entered.set()
        time.sleep(0.3)  # a close that does not wait returns earlier
        left.set()

    api = cyclone.API
    function = ct.CFUNCTYPE(None, ct.c_int32, ct.c_void_p)(slow)
    listener = api.create_listener(None)
    api.lset_data_available_arg(listener, function, None, True)
    reader: Any = reader_of(subscription)
    library: Any = cyclone.API.library
    assert library.dds_set_listener(reader.entity, ct.c_void_p(listener)) == 0
    thread = threading.Thread(target=lambda: publisher.publish(Int32(data=1)))
    thread.start()
    assert entered.wait(20)
    subscription.close()
    assert left.is_set()
    thread.join()
    api.delete_listener(listener)


@pytest.mark.slow
def test_contexts_can_be_created_and_closed_during_a_flood() -> None:
    program = """
import asyncio, faulthandler, os, sys, threading
faulthandler.enable()
from rosidl_py_gen.msgs.rcl_interfaces.msg import IntegerRange as Message
from rosidl_py_gen.runtime import Context, Node

async def main():
    stop, received = threading.Event(), []
    async with Node("talker") as talker:
        publisher = talker.create_publisher(Message, "flood")
        def flood():
            while not stop.is_set():
                publisher.publish(Message())
        thread = threading.Thread(target=flood)
        thread.start()
        for number in range(40):
            async with Context() as context, Node(f"n{number}", context=context) as node:
                for _ in range(5):
                    node.create_subscription(Message, "flood", received.append)
                await asyncio.sleep(0.01)
            received.clear()
        stop.set()
        await asyncio.to_thread(thread.join)

asyncio.run(main())
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=60)
    others = [line for line in run.stderr.splitlines() if "messages on /flood are dropped" not in line]
    assert (run.returncode, others) == (0, [])


# ------------------------------------------------------------------------------------------------ ordinary callbacks


@pytest.mark.every_transport
@loops
def test_internal_receive_failure_is_logged_and_other_subscriptions_receive(
    world: World, kind: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    broken, received = bob.create_subscription(Int32, "broken"), numbers(bob)
    to_broken, publisher = alice.create_publisher(Int32, "broken"), alice.create_publisher(Int32, "n")

    def wake() -> None:
        raise RuntimeError("no")

    monkeypatch.setattr(broken, "_waiters", SimpleNamespace(wake=wake))

    async def main() -> None:
        for each in (to_broken, publisher):
            await each.wait_for_subscribers(timeout_s=20)
        to_broken.publish(Int32())
        publisher.publish(Int32(data=1))
        await until(lambda: received == [1])
        await until(lambda: "an internal receive function failed" in caplog.text)

    run_on(kind, main())
    monkeypatch.undo()


@loops
@pytest.mark.parametrize("error", [ValueError, asyncio.CancelledError])
def test_callback_error_is_logged_and_next_message_is_delivered(
    world: World, kind: str, error: type[BaseException], caplog: pytest.LogCaptureFixture
) -> None:
    alice, bob = world.pair()
    received: list[int] = []

    def callback(message: Int32) -> None:
        if message.data == 0:
            raise error("no")
        received.append(message.data)

    bob.create_subscription(Int32, "n", callback)
    publisher = alice.create_publisher(Int32, "n")

    async def main() -> None:
        await publisher.wait_for_subscribers(timeout_s=20)
        for number in range(2):
            publisher.publish(Int32(data=number))
        await until(lambda: received == [1])

    run_on(kind, main())
    assert "the callback of /n failed" in caplog.text


@pytest.mark.slow
@pytest.mark.every_transport
@pytest.mark.parametrize("kind", ["ours", "asyncio"])
def test_ctrl_c_in_a_callback_stops_the_loop(world: World, kind: str) -> None:
    alice, bob = world.pair()

    def callback(_: Int32) -> None:
        raise KeyboardInterrupt

    bob.create_subscription(Int32, "n", callback)
    publisher = alice.create_publisher(Int32, "n")

    async def main() -> None:
        await publisher.wait_for_subscribers(timeout_s=20)
        publisher.publish(Int32(data=1))
        await asyncio.Event().wait()

    with pytest.raises(KeyboardInterrupt):
        run_on(kind, main())


# ---------------------------------------------------------------------------------------- with other uses of asyncio


@pytest.mark.parametrize("kind", ["ours", "asyncio", UVLOOP])
def test_asyncio_sockets_threads_timers_signals_and_subprocesses_work_with_dds(dds: World, kind: str) -> None:
    dds.node("a")

    async def main() -> None:
        server = await asyncio.start_server(echo, "127.0.0.1", 0)
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        for number in range(200):
            line = f"{number}\n".encode()
            writer.write(line)
            assert await asyncio.wait_for(reader.readline(), 10) == line
        writer.close()
        server.close()
        start = time.monotonic()
        assert await asyncio.gather(*(asyncio.to_thread(lambda: 7) for _ in range(20))) == [7] * 20
        await asyncio.sleep(0.05)  # a timer, which this is about
        assert time.monotonic() - start >= 0.05
        process = await asyncio.create_subprocess_exec(sys.executable, "-c", "print(1)", stdout=subprocess.PIPE)
        assert (await asyncio.wait_for(process.communicate(), 10))[0] == b"1\n"
        signalled = asyncio.Event()
        asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, signalled.set)
        os.kill(os.getpid(), signal.SIGUSR1)
        await asyncio.wait_for(signalled.wait(), 10)

    run_on(kind, main())


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while line := await reader.readline():
        writer.write(line)
    writer.close()


@loops
def test_permanently_ready_descriptor_does_not_delay_dds(dds: World, kind: str) -> None:
    alice, bob = dds.pair()
    received, publisher = numbers(bob), alice.create_publisher(Int32, "n")
    read_end, write_end = os.pipe()
    os.write(write_end, b"x")  # never read
    polled = 0

    def poll() -> None:
        nonlocal polled
        polled += 1

    async def main() -> None:
        await publisher.wait_for_subscribers(timeout_s=20)
        loop = asyncio.get_running_loop()
        if kind != "no readers":
            loop.add_reader(read_end, poll)
        for number in range(20):
            await asyncio.to_thread(publisher.publish, Int32(data=number))
            await until(lambda number=number: received[-1:] == [number])  # type: ignore[misc]
        if kind != "no readers":
            assert polled >= 20
            loop.remove_reader(read_end)

    run_on(kind, main())
    os.close(read_end)
    os.close(write_end)


@loops
@pytest.mark.parametrize("style", ["callback", "receive"])
def test_flood_of_samples_does_not_starve_timers_and_sockets(dds: World, kind: str, style: str) -> None:
    alice, bob = dds.pair()
    count, stop = 0, threading.Event()

    def note(_: Int32) -> None:
        nonlocal count
        count += 1

    subscription = bob.create_subscription(Int32, "n", note if style == "callback" else None, qos=1000)
    publisher = alice.create_publisher(Int32, "n", 1000)

    def flood() -> None:
        while not stop.is_set():
            publisher.publish(Int32())

    async def receive() -> None:
        async for message in subscription:
            note(message)

    async def main() -> None:
        await publisher.wait_for_subscribers(timeout_s=20)
        receiving = asyncio.create_task(receive()) if style == "receive" else None
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            flooding = asyncio.create_task(asyncio.to_thread(flood))
            await until(lambda: count > 100)
            latest_s = 0.0
            for _ in range(20):
                start = time.monotonic()
                await asyncio.sleep(0.01)  # a timer, which this is about
                if kind != "no readers":
                    theirs.send(b"x")
                    assert await asyncio.get_running_loop().sock_recv(ours, 1) == b"x"
                latest_s = max(latest_s, time.monotonic() - start)
            stop.set()
            await flooding
        if receiving is not None:
            receiving.cancel()
        assert latest_s < 5

    run_on(kind, main())


@pytest.mark.slow
async def test_busy_loop_receives_messages_and_idle_loop_uses_no_cpu(network: World) -> None:
    node = network.node("a")
    seen: list[int] = []
    node.create_subscription(Int32, "n", lambda message: seen.append(message.data))
    publisher = node.create_publisher(Int32, "n")
    busy = True

    async def spin() -> None:
        while busy:
            await asyncio.sleep(0)

    spinning = asyncio.create_task(spin())
    for number in range(5):
        publisher.publish(Int32(data=number))
        await until(lambda number=number: len(seen) > number)  # type: ignore[misc]
    assert seen == [0, 1, 2, 3, 4]
    busy = False
    await spinning
    assert await rests(1, cpu_s=0.02)


@pytest.mark.slow
def test_importing_needs_no_cyclonedds_and_missing_library_is_explained() -> None:
    program = (
        "import os, sys; sys.modules['zenoh'] = None; os.environ['ROSIDL_LIBDDSC'] = 'libnowhere.so'\n"
        "import rosidl_py_gen, rosidl_py_gen.runtime\n"
        "from rosidl_py_gen.runtime import Context, MemoryTransport, Node\n"
        "with Context(transport=MemoryTransport()) as c, Node('n', context=c): pass\n"
        "try: Node('n')\n"
        "except ImportError as err: print(type(err).__name__, err)\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert output.startswith("BackendMissingError")
    assert output.endswith("Correct ROSIDL_LIBDDSC, or unset it\n")
    assert "MemoryTransport works without it" in output
    assert "ROSIDL_LIBDDSC is set, so nothing else was tried" in output and "libnowhere.so: not found" in output


@pytest.mark.slow
def test_importing_runtime_loads_neither_cyclonedds_nor_lark() -> None:
    program = (
        "import sys, rosidl_py_gen.runtime\n"
        "print([name for name in sys.modules if name.split('.')[0] in ('cyclonedds', 'lark')])"
    )
    run = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


@pytest.mark.slow
def test_cyclonedds_itself_works_in_the_same_process_as_a_node() -> None:
    program = (
        "from rosidl_py_gen.runtime import Node\n"
        "with Node('n') as node:\n"
        "    import cyclonedds, cyclonedds.core\n"
        "    from cyclonedds.domain import DomainParticipant\n"
        "    participant = DomainParticipant(node.context.domain_id)\n"
        "    print(cyclonedds.internal.DDS is cyclonedds.core.DDS, participant.guid is not None)\n"
        "    del participant\n"
    )
    run = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout == "True True\n"
