"""Reliable delivery without loss to a subscriber in another process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Int32
from support.processes import python_process

from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from support.worlds import World

    from rosidl_py_gen.runtime import Publisher

COUNT = 5000
THREADS = 5
COUNTER = """
import asyncio, json, sys
from rosidl_py_gen.runtime import Node, QoSProfile, WaitTimeoutError

async def main(count, pause_s):
    async with Node("counter") as node:
        subscription = node.create_subscription("std_msgs/msg/Int32", "numbers", qos=QoSProfile().keep_all())
        seen = []
        while len(seen) < count:
            seen.append((await subscription.receive(timeout_s=20))["data"])
            if pause_s and len(seen) % 500 == 0:
                await asyncio.sleep(pause_s)  # what comes meanwhile has to wait somewhere
        try:
            seen.append((await subscription.receive(timeout_s=0.2))["data"])
        except WaitTimeoutError:
            pass
        print(json.dumps({"seen": seen, "dropped": subscription.dropped}), flush=True)
        sys.stdin.readline()

asyncio.run(main(int(sys.argv[1]), float(sys.argv[2])))
"""


def counter(pause_s: float) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    """Process that subscribes, and prints what it received after `COUNT` messages."""
    return python_process(COUNTER, str(COUNT), str(pause_s))


async def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None and process.stderr is not None
    line = await asyncio.to_thread(process.stdout.readline)
    assert line, process.stderr.read()
    report: dict[str, Any] = json.loads(line)
    return report


async def test_keep_all_delivers_every_message_between_two_processes(network: World) -> None:
    publisher = network.node("talker").create_publisher(Int32, "numbers", QoSProfile().keep_all())
    with counter(0.05) as process:
        assert await publisher.wait_for_subscribers(timeout_s=10)
        for number in range(COUNT):
            publisher.publish(Int32(data=number))
        assert await publisher.wait_for_acknowledged(timeout_s=10)
        assert await result(process) == {"seen": list(range(COUNT)), "dropped": 0}
    assert publisher.dropped == 0


async def test_messages_of_several_threads_arrive_completely_and_in_order_in_another_process(network: World) -> None:
    publisher: Publisher[Int32] = network.node("talker").create_publisher(Int32, "numbers", QoSProfile().keep_all())
    each = COUNT // THREADS
    begin = threading.Barrier(THREADS)

    def publish(first: int) -> None:
        begin.wait(20)
        for number in range(first, first + each):
            publisher.publish(Int32(data=number))

    with counter(0.0) as process:
        assert await publisher.wait_for_subscribers(timeout_s=10)
        with ThreadPoolExecutor(THREADS) as pool:
            publishing = pool.map(publish, range(0, COUNT, each))
            report = await result(process)
            list(publishing)
    assert report["dropped"] == 0
    assert sorted(report["seen"]) == list(range(COUNT))
    for number in range(THREADS):  # messages of one thread stay in order
        own = range(number * each, (number + 1) * each)
        assert [value for value in report["seen"] if value in own] == list(own)
