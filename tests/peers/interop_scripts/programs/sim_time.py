"""Simulated time: timers, clocks and sleeping follow /clock."""

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter

rclpy.init()
node = Node("simulated")
print(node.get_parameter("use_sim_time").value, node.get_clock().ros_time_is_active, node.get_clock().now().nanoseconds)
ticks = []
timer = node.create_timer(1.0, lambda: ticks.append(node.get_clock().now().nanoseconds / 1e9))
jumps = []
handle = node.get_clock().create_jump_callback(
    rclpy.clock.JumpThreshold(min_forward=Duration(seconds=0.5), min_backward=None, on_clock_change=True),
    post_callback=lambda jump: jumps.append((jump.clock_change.name, jump.delta.nanoseconds / 1e9)),
)
while not node.count_publishers("/clock"):
    rclpy.spin_once(node, timeout_sec=0.05)
print("ready")
while node.get_clock().now().nanoseconds < 15e9:
    rclpy.spin_once(node, timeout_sec=0.1)
for _ in range(5):
    rclpy.spin_once(node, timeout_sec=0.02)
print(ticks[-1], node.get_clock().now(), jumps[-1][0])
print(node.set_parameters([Parameter("use_sim_time", value="text")])[0].successful)
print(node.set_parameters([Parameter("use_sim_time", value=False)])[0].successful)
print(node.get_clock().ros_time_is_active, node.get_clock().now().nanoseconds > 1e18, jumps[-1][0])
node.destroy_node()
rclpy.shutdown()
