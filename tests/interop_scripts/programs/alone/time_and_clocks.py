"""Clocks, jumps and sleeping."""

import threading
import time

import rclpy
from rclpy.clock import Clock, ClockType, JumpThreshold, ROSClock
from rclpy.duration import Duration
from rclpy.time import Time


def tell(what):
    try:
        print(what())
    except Exception as error:
        print(type(error).__name__, error if isinstance(error, TypeError) else "")


def let_sleep():
    time.sleep(0.05)  # the thread sleeps by now; if it does not yet, this shows less, and prints the same


rclpy.init()
node = rclpy.create_node("clocks")
clock = node.get_clock()
print(type(clock).__name__, clock, clock.clock_type, clock.ros_time_is_active, clock.now().clock_type.name)
for kind in (ClockType.SYSTEM_TIME, ClockType.STEADY_TIME, ClockType.ROS_TIME):
    made = Clock(clock_type=kind)
    before = made.now()
    slept = made.sleep_for(Duration(seconds=0.02))
    print(type(made).__name__, slept, (made.now() - before).nanoseconds >= 20_000_000, made)
    print(made.sleep_until(before), made.sleep_for(Duration(seconds=-1)))
tell(lambda: clock.sleep_until(Time(seconds=1, clock_type=ClockType.STEADY_TIME)))
tell(lambda: JumpThreshold(min_forward=None, min_backward=None, on_clock_change=False))
tell(lambda: JumpThreshold(min_forward=Duration(seconds=-1), min_backward=None))
ros = ROSClock()
jumps = []
threshold = JumpThreshold(min_forward=Duration(seconds=1), min_backward=Duration(seconds=-1), on_clock_change=True)
handle = ros.create_jump_callback(
    threshold,
    pre_callback=lambda: jumps.append("before"),
    post_callback=lambda jump: jumps.append((jump.clock_change.name, jump.delta.nanoseconds > 0)),
)
ros._set_ros_time_is_active(True)
ros.set_ros_time_override(Time(seconds=10, clock_type=ClockType.ROS_TIME))
ros.set_ros_time_override(Time(seconds=20, clock_type=ClockType.ROS_TIME))
ros.set_ros_time_override(Time(seconds=20, nanoseconds=5, clock_type=ClockType.ROS_TIME))
print(ros.now(), jumps[0], len(jumps) > 2, jumps[-1])
woken = []
thread = threading.Thread(target=lambda: woken.append(ros.sleep_until(Time(seconds=30, clock_type=ClockType.ROS_TIME))))
thread.start()
let_sleep()
print(woken)
ros.set_ros_time_override(Time(seconds=31, clock_type=ClockType.ROS_TIME))
thread.join(10)
print(woken)
handle.unregister()
count = len(jumps)
ros.set_ros_time_override(Time(seconds=1, clock_type=ClockType.ROS_TIME))
print(len(jumps) == count)
thread = threading.Thread(target=lambda: woken.append(clock.sleep_for(Duration(seconds=100))))
thread.start()
let_sleep()
rclpy.shutdown()
thread.join(10)
print(woken)
