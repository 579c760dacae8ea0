"""Executors by hand: time limits, nodes that come and go, tasks, being shut down from callbacks, and as contexts."""

import time

import rclpy
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.node import Node
from rclpy.task import Future

rclpy.init()
node, other = Node("first"), Node("second")
executor = SingleThreadedExecutor()
print(executor.add_node(node), executor.add_node(node), executor.add_node(other), len(executor.get_nodes()))
print(node.executor is executor)
second = MultiThreadedExecutor(num_threads=2)
print(second.add_node(node), node.executor is second, len(executor.get_nodes()), len(second.get_nodes()))
second.remove_node(node)
second.remove_node(node)
print(len(second.get_nodes()), node.executor is second)
print(executor.add_node(node))


def took(what):
    times = []
    for _ in range(4):  # the least of them tells how long it waits, also on a busy machine
        start = time.monotonic()
        what()
        times.append(time.monotonic() - start)
    passed = min(times)
    return "none" if passed < 0.05 else "some" if passed < 1.5 else "long"


never = Future()
for _ in range(5):
    executor.spin_once(timeout_sec=0)
print(took(lambda: executor.spin_once(timeout_sec=0)))
print(took(lambda: executor.spin_until_future_complete(never, timeout_sec=0.2)), never.done())
print(took(lambda: executor.spin_until_future_complete(never, timeout_sec=0)))
done = Future()
done.set_result(1)
print(took(lambda: executor.spin_until_future_complete(done)))
print(took(lambda: rclpy.spin_until_future_complete(other, done, executor)))
try:
    executor.wait_for_ready_callbacks(timeout_sec=0)
except TimeoutException as error:
    print(type(error).__name__)
try:
    executor.wait_for_ready_callbacks(condition=lambda: True)
except ConditionReachedException as error:
    print(type(error).__name__)
task = executor.create_task(lambda a, b=0: a + b, 1, b=2)
print(task.done(), task.result())
executor.spin_until_future_complete(task)
print(task.done(), task.result())
order = []
task.add_done_callback(lambda t: order.append("done"))
print(order)
executor.spin_once(timeout_sec=0.1)
print(order)


async def coroutine():
    order.append("begin")
    await done
    order.append("end")
    return "coroutine"


task = executor.create_task(coroutine)
executor.spin_until_future_complete(task)
print(order, task.result())
timer = node.create_timer(0.01, lambda: order.append("timer") or executor.shutdown())
executor.spin()
print(order[-1], executor.get_nodes())
try:
    executor.wait_for_ready_callbacks(timeout_sec=0)
except ShutdownException as error:
    print(type(error).__name__)
executor.spin()
print(executor.shutdown(), rclpy.get_global_executor() is rclpy.get_global_executor())
timer.cancel()
with SingleThreadedExecutor() as third:
    third.add_node(other)
    future = Future()
    other.create_timer(0.01, lambda: future.done() or future.set_result("timer"))
    third.spin_until_future_complete(future, timeout_sec=10)
    print(future.result())
print(third.get_nodes())
last = Node("last")
last.create_timer(0.01, lambda: rclpy.shutdown())
try:
    rclpy.spin(last)
    print("returned")
except ExternalShutdownException:
    print("ExternalShutdownException")
print(rclpy.ok())
try:
    rclpy.shutdown()
except RuntimeError as error:
    print(type(error).__name__)
