"""Guard conditions triggered from threads, several times at once, and destroyed."""

import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor

rclpy.init()
node = rclpy.create_node("guards")
executor = SingleThreadedExecutor()
executor.add_node(node)
calls = []
guard = node.create_guard_condition(lambda: calls.append(threading.current_thread() is threading.main_thread()))
executor.spin_once(timeout_sec=0)
for _ in range(3):
    guard.trigger()
executor.spin_once(timeout_sec=1)
executor.spin_once(timeout_sec=0.05)
print(calls)
thread = threading.Thread(target=guard.trigger)
thread.start()
while len(calls) < 2:
    executor.spin_once(timeout_sec=1)
thread.join()
print(calls, len(list(node.guards)))
print(node.destroy_guard_condition(guard), node.destroy_guard_condition(guard), len(list(node.guards)))
try:
    guard.trigger()
except Exception as error:
    print(type(error).__name__)


async def waits():
    calls.append("begin")
    await future
    calls.append("end")


future = rclpy.task.Future(executor=executor)
again = node.create_guard_condition(waits)
again.trigger()
executor.spin_once(timeout_sec=1)
again.trigger()
executor.spin_once(timeout_sec=0.05)
print(calls[2:])
future.set_result(None)
for _ in range(5):
    executor.spin_once(timeout_sec=0.05)
print(calls[2:])
executor.wake()
executor.shutdown()
node.destroy_node()
rclpy.shutdown()
