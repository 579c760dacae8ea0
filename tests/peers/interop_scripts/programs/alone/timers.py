"""Timers: once, canceled and reset by their own callback, changed, destroyed, and by clocks of all kinds."""

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

rclpy.init()
node = Node("timers")
order = []


class Once:
    def __init__(self, name):
        self.count = 0
        self.timer = node.create_timer(0.02, self.fire)
        self.name = name

    def fire(self):
        self.count += 1
        order.append(self.name)
        self.timer.cancel()


once = Once("once")
steady = node.create_timer(0.02, lambda: order.append("steady"), clock=Clock(clock_type=ClockType.STEADY_TIME))
while order.count("steady") < 3:
    rclpy.spin_once(node, timeout_sec=1)
steady.cancel()
print(once.count, once.timer.is_canceled(), steady.is_canceled())
once.timer.reset()
print(once.timer.is_canceled(), once.timer.is_ready())
while once.count < 2:
    rclpy.spin_once(node, timeout_sec=1)
print(once.count, once.timer.is_canceled())
print(node.destroy_timer(once.timer), node.destroy_timer(once.timer), len(list(node.timers)))
try:
    once.timer.reset()
except Exception as error:
    print(type(error).__name__)
late = node.create_timer(1000.0, lambda: order.append("late"))
print(late.timer_period_ns, 999e9 < late.time_until_next_call() <= 1000e9, late.time_since_last_call() < 1e9)
late.timer_period_ns = 10_000_000
print(late.timer_period_ns)
late.reset()
while "late" not in order:
    rclpy.spin_once(node, timeout_sec=1)
late.cancel()
print(late.time_until_next_call())
asleep = node.create_timer(0.02, lambda: order.append("asleep"), autostart=False)
rclpy.spin_once(node, timeout_sec=0.1)
print("asleep" in order, asleep.is_canceled())
asleep.reset()
while "asleep" not in order:
    rclpy.spin_once(node, timeout_sec=1)
asleep.cancel()
counted = []
zero = node.create_timer(0, lambda: counted.append(len(counted)))
for _ in range(3):
    rclpy.spin_once(node)
print(counted)
node.destroy_timer(zero)


def destroys():
    print("destroyed inside", node.destroy_timer(inside))


inside = node.create_timer(0.01, destroys)
while len(list(node.timers)) > 3:
    rclpy.spin_once(node, timeout_sec=0.1)
print(len(list(node.timers)), [type(t.clock).__name__ for t in node.timers])
node.destroy_node()
rclpy.shutdown()
