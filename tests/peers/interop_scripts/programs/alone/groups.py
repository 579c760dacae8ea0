"""Callback groups: which callbacks run at once, across await too, and a group of one's own."""

import threading

import rclpy
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node


class Counting(CallbackGroup):
    def __init__(self):
        super().__init__()
        self.calls = []

    def can_execute(self, entity):
        return True

    def beginning_execution(self, entity):
        self.calls.append("begin")
        return True

    def ending_execution(self, entity):
        self.calls.append("end")


rclpy.init()
node = Node("groups")
executor = MultiThreadedExecutor(num_threads=4)
executor.add_node(node)


def most_at_once(group_of, patience_s):
    lock, now, most, calls = threading.Lock(), [], [], []
    both = threading.Barrier(2)

    def busy():
        with lock:
            now.append(1)
            most.append(len(now))
            calls.append(1)
        try:
            both.wait(patience_s)
        except threading.BrokenBarrierError:
            pass
        with lock:
            now.pop()

    timers = [node.create_timer(0.001, busy, callback_group=group_of()) for _ in range(2)]
    while len(calls) < 4:
        executor.spin_once(timeout_sec=1)
    for timer in timers:
        node.destroy_timer(timer)
    both.abort()  # one that came fifth would wait alone
    while now:
        executor.spin_once(timeout_sec=0.01)
    return max(most)


exclusive, reentrant = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
print(most_at_once(lambda: exclusive, 0.1))
print(most_at_once(lambda: reentrant, 20) >= 2)
print(most_at_once(lambda: None, 0.1))
print(most_at_once(MutuallyExclusiveCallbackGroup, 20) >= 2)
counting = Counting()
guard = node.create_guard_condition(lambda: counting.calls.append("call"), callback_group=counting)
guard.trigger()
while len(counting.calls) < 3:
    executor.spin_once(timeout_sec=1)
print(counting.calls, counting.has_entity(guard), node.default_callback_group.has_entity(guard))
future = rclpy.task.Future(executor=executor)
order = []


async def holds():
    order.append("holds")
    await future
    order.append("let go")


held = MutuallyExclusiveCallbackGroup()
first = node.create_guard_condition(holds, callback_group=held)
second = node.create_guard_condition(lambda: order.append("second"), callback_group=held)
first.trigger()
while not order:
    executor.spin_once(timeout_sec=1)
second.trigger()
for _ in range(3):
    executor.spin_once(timeout_sec=0.02)
print(order)
future.set_result(1)
while len(order) < 3:
    executor.spin_once(timeout_sec=0.1)
print(order)
executor.shutdown()
rclpy.shutdown()
