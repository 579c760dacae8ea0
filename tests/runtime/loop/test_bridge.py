"""How data reach the event loop: the loop's own thread waits in DDS, and nothing else suffers from it."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import Int32
from worlds import ROOT

from rosidl_py_gen.runtime.loop.bridge import DirectSelector

if TYPE_CHECKING:
    from worlds import World


def threads() -> list[str]:
    """Names of our threads."""
    return sorted(thread.name for thread in threading.enumerate() if thread.name.startswith("rosidl-py-gen"))


async def test_one_extra_thread_per_context_and_the_first_one_waits_in_the_loop(dds: World) -> None:
    dds.node("a")
    assert threads() == ["rosidl-py-gen helper"]
    assert isinstance(asyncio.get_running_loop()._selector, DirectSelector)  # type: ignore[attr-defined]
    dds.node("b")
    assert threads() == ["rosidl-py-gen helper", "rosidl-py-gen receiver"]
    for context in dds.contexts:
        context.close()
    assert threads() == []
    assert not isinstance(asyncio.get_running_loop()._selector, DirectSelector)  # type: ignore[attr-defined]
    await asyncio.sleep(0.01)


async def test_sockets_threads_timers_and_subprocesses_work_beside_dds(dds: World) -> None:
    dds.node("a")
    server = await asyncio.start_server(echo, "127.0.0.1", 0)
    reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
    for number in range(200):
        line = f"{number}\n".encode()
        writer.write(line)
        assert await asyncio.wait_for(reader.readline(), 2) == line
    writer.close()
    server.close()
    start = time.monotonic()
    assert await asyncio.gather(*(asyncio.to_thread(lambda: 7) for _ in range(20))) == [7] * 20
    await asyncio.sleep(0.05)
    assert 0.05 <= time.monotonic() - start < 1
    process = await asyncio.create_subprocess_exec(sys.executable, "-c", "print(1)", stdout=subprocess.PIPE)
    assert (await asyncio.wait_for(process.communicate(), 10))[0] == b"1\n"


async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Return every line."""
    while line := await reader.readline():
        writer.write(line)
    writer.close()


async def test_a_busy_loop_still_serves_dds_and_an_idle_one_costs_nothing(dds: World) -> None:
    node = dds.node("a")
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
        await asyncio.sleep(0.01)
    busy = False
    await spinning
    assert seen == [0, 1, 2, 3, 4]
    cpu = time.process_time()
    await asyncio.sleep(1)
    assert time.process_time() - cpu < 0.02


async def test_a_readable_socket_that_nobody_reads_does_not_spin_the_helper(dds: World) -> None:
    dds.node("a")
    left, right = socket.socketpair()
    loop = asyncio.get_running_loop()
    reads = 0

    def readable() -> None:
        nonlocal reads
        reads += 1
        loop.remove_reader(left)

    loop.add_reader(left, readable)
    right.send(b"x")
    await asyncio.sleep(0.05)
    cpu = time.process_time()
    await asyncio.sleep(0.3)
    assert reads == 1
    assert time.process_time() - cpu < 0.05
    left.close()
    right.close()


def test_importing_the_package_needs_no_cyclonedds_and_using_dds_without_it_says_what_to_do() -> None:
    program = (
        "import sys; sys.modules['cyclonedds'] = None\n"
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
    assert "rosidl-py-gen[node]" in output and "MemoryTransport works without it" in output
    # The wheels of 11.0.1 on the package index; others, ARM Linux and musl for example, have to build from source.
    assert "CPython 3.10 to 3.13 on Linux (x86-64, glibc), macOS and Windows (x86-64);" in output


@pytest.mark.parametrize("module", ["rosidl_py_gen", "rosidl_py_gen.runtime"])
def test_importing_is_lazy(module: str) -> None:
    program = f"import sys, {module}; print([m for m in sys.modules if m.split('.')[0] in ('cyclonedds', 'lark')])"
    run = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


def test_cyclonedds_itself_still_works_after_we_loaded_a_part_of_it() -> None:
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
