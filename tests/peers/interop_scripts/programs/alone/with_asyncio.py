"""asyncio beside rclpy: spin_once inside a coroutine, asyncio inside callbacks, futures of both."""

import asyncio

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Int32
from std_srvs.srv import Trigger


class Mixed(Node):
    def __init__(self):
        super().__init__("mixed")
        self.seen = []
        self.pub = self.create_publisher(Int32, "n", 10)
        self.create_subscription(Int32, "n", self.on, 10)
        self.create_service(Trigger, "go", self.go)
        self.cli = self.create_client(Trigger, "go")

    def on(self, msg):
        self.seen.append(asyncio.run(self.double(msg.data)) if not running() else msg.data)

    async def double(self, number):
        return await asyncio.to_thread(lambda: 2 * number)

    def go(self, request, response):
        response.success = True
        return response


def running():
    try:
        return asyncio.get_running_loop() is not None
    except RuntimeError:
        return False


async def spinning(node):
    while rclpy.ok():
        rclpy.spin_once(node, timeout_sec=0)
        await asyncio.sleep(0.001)


async def main(node):
    task = asyncio.ensure_future(spinning(node))
    while not node.pub.get_subscription_count() or not node.cli.service_is_ready():
        await asyncio.sleep(0.01)
    node.pub.publish(Int32(data=21))
    while not node.seen:
        await asyncio.sleep(0.01)
    print("inside", node.seen)
    future = node.cli.call_async(Trigger.Request())
    while not future.done():
        await asyncio.sleep(0.001)
    print(future.result().success)
    loop = asyncio.get_running_loop()
    waiting = loop.create_future()
    node.cli.call_async(Trigger.Request()).add_done_callback(
        lambda f: loop.call_soon_threadsafe(waiting.set_result, f.result().success)
    )
    print(await asyncio.wait_for(waiting, 10))
    task.cancel()
    try:
        await task
    except asyncio.CancelledError:
        print("cancelled")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinner = loop.run_in_executor(None, executor.spin)
    future = node.cli.call_async(Trigger.Request())
    while not future.done():
        await asyncio.sleep(0.001)
    print(future.result().success)
    executor.shutdown()
    await spinner


rclpy.init()
node = Mixed()
asyncio.run(main(node))
node.seen.clear()
node.pub.publish(Int32(data=4))
while not node.seen:
    rclpy.spin_once(node, timeout_sec=1)
print("outside", node.seen)


async def sleeps():
    try:
        await asyncio.sleep(0.01)  # refused: asyncio does not run
    except RuntimeError as error:
        return type(error).__name__


executor = SingleThreadedExecutor()
task = executor.create_task(sleeps)
executor.spin_until_future_complete(task, timeout_sec=5)
print(task.result())
node.destroy_node()
rclpy.shutdown()
