"""`rclpy.experimental.AsyncNode` of rclpy 10, as programs with asyncio use it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from support.local_network import domain_id
from support.program_processes import output_lines

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [
    pytest.mark.real_time("programs are processes"),
    pytest.mark.skipif(sys.version_info < (3, 11), reason="asyncio.TaskGroup needs Python 3.11"),
]
START = """
import asyncio
import rclpy
from rclpy.experimental import AsyncNode
from rclpy.subscription_content_filter_options import ContentFilterOptions
from std_msgs.msg import Int32
from std_srvs.srv import SetBool

async def until(condition):
    async with asyncio.timeout(20):
        while not condition():
            await asyncio.sleep(0.01)

"""
END = """
with rclpy.init():
    asyncio.run(main())
"""
TOPICS = """
async def main():
    received, filtered, infos, running = [], [], [], []
    async with AsyncNode("listener") as node:
        async def keep(message):
            running.append(len(running))
            await asyncio.sleep(0.01)
            received.append(message.data)

        def add(message, info):
            filtered.append(message.data)
            infos.append(info)

        node.create_subscription(Int32, "numbers", keep, 10)
        options = ContentFilterOptions("data > 2", [])
        node.create_subscription(Int32, "numbers", add, 10, content_filter_options=options)
        publisher = node.create_publisher(Int32, "numbers", 10)
        await until(lambda: publisher.get_subscription_count() == 2)
        for number in range(5):
            publisher.publish(Int32(data=number))
        await until(lambda: len(received) == 5 and len(filtered) == 2)
        print(received, filtered, sorted(infos[0]), len(infos[0]["publisher_gid"]["data"]))
        both = asyncio.Barrier(2)
        together = []

        async def meet(message):
            await both.wait()  # needs both callbacks at once
            together.append(message.data)

        subscription = node.create_subscription(Int32, "pairs", meet, 10, concurrent=True)
        pairs = node.create_publisher(Int32, "pairs", 10)
        await until(lambda: pairs.get_subscription_count() == 1)
        for number in range(2):
            pairs.publish(Int32(data=number))
        await until(lambda: len(together) == 2)
        subscription.destroy()
        await until(lambda: pairs.get_subscription_count() == 0)
        print(sorted(together))
    try:
        node.create_publisher(Int32, "numbers", 10)
    except RuntimeError as error:
        print(error)
    try:
        await node.__aenter__()
    except RuntimeError as error:
        print(error)
"""
SERVICES = """
async def main():
    node = AsyncNode("server")

    async def switch(request, response):
        await asyncio.sleep(0.01)
        response.success, response.message = request.data, node.get_name()
        return response

    node.create_service(SetBool, "switch", switch)  # served once the node is entered
    client = node.create_client(SetBool, "switch")
    async with node, asyncio.timeout(20):
        await client.wait_for_service()
        replies = await asyncio.gather(*(client.call(SetBool.Request(data=value)) for value in (True, False)))
        print([(reply.success, reply.message) for reply in replies])
        await node.wait_for_node("server")
        async with AsyncNode("other") as other:
            parameters = other.create_client(__import__("rcl_interfaces").srv.GetParameters, "server/get_parameters")
            await parameters.wait_for_service()
            values = (await parameters.call(parameters.srv_type.Request(names=["use_sim_time"]))).values
            print(values[0].bool_value)
        lost = asyncio.create_task(node.create_client(SetBool, "nowhere").call(SetBool.Request()))
        await asyncio.sleep(0)
    print(lost.cancelled() or await asyncio.wait([lost]) and lost.cancelled())
    try:
        await client.call(SetBool.Request())
    except RuntimeError as error:
        print(error)
"""
TIMERS = """
import time
from rclpy.clock import ClockType
from rclpy.exceptions import TimeSourceChangedError
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

async def main():
    calls, late = [], []
    async with AsyncNode("timers") as node:
        timer = node.create_timer(0.02, lambda info: calls.append(info.actual_call_time - info.expected_call_time))
        stopped = node.create_timer(0.01, lambda: late.append(None), autostart=False)
        await until(lambda: len(calls) == 3)
        timer.cancel()
        stopped.reset()
        await until(lambda: len(late) == 2)
        print(len(calls), all(delay.nanoseconds >= 0 for delay in calls), timer.is_canceled())
        stopped.destroy()
        start = time.monotonic()
        await node.get_clock().sleep(0.05)
        print(time.monotonic() - start >= 0.05)

        sleep = asyncio.create_task(node.get_clock().sleep(100))
        await asyncio.sleep(0)
        node.set_parameters([Parameter("use_sim_time", value=True)])
        try:
            await sleep
        except TimeSourceChangedError as error:
            print(type(error).__name__)
        publisher = node.create_publisher(Clock, "/clock", 1)
        sleep = asyncio.create_task(node.get_clock().sleep(100))
        seconds = 1
        while not sleep.done():
            message = Clock()
            message.clock.sec = seconds = seconds + 10
            publisher.publish(message)
            await asyncio.sleep(0.01)
        print(node.get_clock().now().nanoseconds >= 100 * 10**9)
        sleep = asyncio.create_task(node.get_clock().sleep(100))
        await asyncio.sleep(0)
    await asyncio.wait([sleep])
    print(sleep.cancelled())
"""
ENDS = """
async def main():
    try:
        async with AsyncNode("failing") as node:
            node.create_timer(0.01, lambda: 1 / 0)
            await asyncio.sleep(20)
    except* ZeroDivisionError as group:
        print(group.exceptions)
    node = AsyncNode("running")
    node.create_timer(0.01, node.destroy_node)
    await node.run()
    print(node.handle.is_valid)
    spun, heard = rclpy.create_node("spun"), []
    spun.create_subscription(Int32, "numbers", lambda message: heard.append(message.data), 10)
    async with AsyncNode("beside") as node:  # an executor in another thread runs the same loop
        spinning = asyncio.create_task(asyncio.to_thread(rclpy.spin, spun))
        publisher = node.create_publisher(Int32, "numbers", 10)
        await until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(Int32(data=1))
        await until(lambda: heard)
        print(heard)
        rclpy.get_global_executor().shutdown()
        rclpy.shutdown()
        await asyncio.wait([spinning])
"""


def run_in_domain(folder: Path, program: str) -> list[str]:
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return output_lines(folder, START + program + END, **settings)


def test_messages_are_received_in_order_filtered_or_concurrently(tmp_path: Path) -> None:
    keys = "publication_sequence_number publisher_gid received_timestamp reception_sequence_number source_timestamp"
    assert run_in_domain(tmp_path, TOPICS) == [
        f"[0, 1, 2, 3, 4] [3, 4] {keys.split()} 16",
        "[0, 1]",
        "Cannot create publisher on a destroyed node",
        "Node has been destroyed and cannot be reentered",
    ]


def test_services_reply_and_calls_end_with_the_node(tmp_path: Path) -> None:
    assert run_in_domain(tmp_path, SERVICES) == [
        "[(True, 'server'), (False, 'server')]",
        "False",
        "True",
        "Calling a destroyed client is forbidden",
    ]


def test_timers_and_sleeps_follow_the_clock_of_the_node(tmp_path: Path) -> None:
    assert run_in_domain(tmp_path, TIMERS) == ["3 True True", "True", "TimeSourceChangedError", "True", "True"]


def test_exceptions_end_async_with_block_and_executors_run_in_parallel(tmp_path: Path) -> None:
    assert run_in_domain(tmp_path, ENDS) == ["(ZeroDivisionError('division by zero'),)", "False", "[1]"]
