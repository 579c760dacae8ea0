"""Futures, tasks, times, durations, guard conditions."""

import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from rclpy.time import Time

rclpy.init()
node = rclpy.create_node("futures")
executor = SingleThreadedExecutor()
executor.add_node(node)
future = Future()
print(future.done(), future.result(), future.cancelled())


async def work(x):
    print("await", await future)
    return x * 2


task = executor.create_task(work, 21)
guard = node.create_guard_condition(lambda: future.set_result("set"))
guard.trigger()
executor.spin_until_future_complete(task, timeout_sec=5)
print(task.done(), task.result(), future.exception())


def fails():
    raise KeyError("failed")


task = executor.create_task(fails)
try:
    executor.spin_until_future_complete(task, timeout_sec=5)
    task.result()
except KeyError as error:
    print("raised", error)
stamp = Time(seconds=5, nanoseconds=3)
print(stamp.to_msg(), stamp + Duration(seconds=1.5), stamp - Time(seconds=1), Duration(seconds=2) > Duration(seconds=1))
print(type(node.get_clock().now().to_msg()).__module__, Duration(nanoseconds=7).to_msg())
for wrong in (lambda: stamp < 3, lambda: Time(seconds=-1), lambda: stamp + stamp):
    try:
        print(wrong())
    except Exception as error:
        print(type(error).__name__)
ticks = []
timer = node.create_timer(0.5, lambda: ticks.append(timer.time_until_next_call() > 0))
while len(ticks) < 3:
    executor.spin_once(timeout_sec=1)
timer.cancel()
print(ticks, timer.is_canceled(), timer.timer_period_ns)
executor.shutdown()
node.destroy_node()
rclpy.shutdown()
