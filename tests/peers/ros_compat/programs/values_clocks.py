"""Clocks, jumps of time, and sleeping."""
# ruff: noqa
# fmt: off

import threading
import rclpy, rclpy.executors
from rclpy.clock import Clock, ClockChange, JumpThreshold, ROSClock, TimeJump
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.time import Time

Clock()
Clock(clock_type=ClockType.ROS_TIME)
type(Clock(clock_type=ClockType.ROS_TIME))
ROSClock()
Clock(clock_type=1)
Clock(ClockType.ROS_TIME)
now = ROSClock().now()
(str(now.clock_type), f"{now.clock_type}", now.clock_type, type(now.clock_type).__name__, isinstance(now.clock_type, int), int(now.clock_type), now.clock_type.name, now.clock_type.value)
(now.clock_type == ClockType.ROS_TIME, ClockType.ROS_TIME == now.clock_type, now.clock_type != ClockType.SYSTEM_TIME, now.clock_type == 1, now.clock_type == "x", {ClockType.ROS_TIME: 5}.get(now.clock_type), {1: 5}.get(now.clock_type))
(str(ROSClock().clock_type), f"{Clock().clock_type}", isinstance(Clock().clock_type, int), str(Time(seconds=1).clock_type), str((now - Duration(seconds=1)).clock_type))
(Time(clock_type=now.clock_type), Time(clock_type=now.clock_type) < now, Clock(clock_type=now.clock_type), type(Clock(clock_type=now.clock_type)), Clock(clock_type=now.clock_type).clock_type)
now.clock_type < 5  # text
now.clock_type + 1  # text
TimeJump(2, Duration())
ROSClock(clock_type=ClockType.ROS_TIME)
JumpThreshold(min_forward=None,min_backward=None,on_clock_change=False)
JumpThreshold(min_forward=Duration(),min_backward=None)
JumpThreshold(min_forward=None,min_backward=Duration(seconds=1))
JumpThreshold()
TimeJump(1,Duration())
TimeJump(ClockChange.ROS_TIME_ACTIVATED,Duration(seconds=1)).delta
list(ClockChange)
Clock().sleep_for(Duration(seconds=0.01))
ROSClock().ros_time_is_active
ROSClock().set_ros_time_override(5)
ROSClock().set_ros_time_override(Time(seconds=1))
Clock().create_jump_callback(JumpThreshold(min_forward=None,min_backward=None))
Clock().create_jump_callback(JumpThreshold(min_forward=None,min_backward=None),pre_callback=5)
Clock().create_jump_callback(JumpThreshold(min_forward=None,min_backward=None),post_callback=5)
c = ROSClock()
seen = []


def bad(*given):
    seen.append("bad")
    raise ValueError("bad")


anything = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1))
forward = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None)
kinds = []
h0 = c.create_jump_callback(anything, post_callback=lambda j: kinds.append((str(j.clock_change), f"{j.clock_change}", j.clock_change, isinstance(j.clock_change, int), int(j.clock_change), j.clock_change == ClockChange.ROS_TIME_ACTIVATED, j.clock_change in (ClockChange.ROS_TIME_ACTIVATED,), j.clock_change == 2, TimeJump(j.clock_change, j.delta).clock_change)))
h1 = c.create_jump_callback(anything, pre_callback=lambda: seen.append("pre"), post_callback=lambda j: seen.append((j.clock_change, j.delta.nanoseconds, type(j).__name__)))
c.now().nanoseconds > 10**18
c._set_ros_time_is_active(True)
c.now()
c.set_ros_time_override(Time(seconds=5, clock_type=ClockType.ROS_TIME))
c.set_ros_time_override(Time(seconds=3, clock_type=ClockType.ROS_TIME))
c.set_ros_time_override(Time(seconds=3))
(list(seen), seen.clear(), c.now())
(kinds, h0.unregister())
h2 = c.create_jump_callback(forward, pre_callback=bad, post_callback=bad)
h3 = c.create_jump_callback(forward, pre_callback=lambda: seen.append("pre3"), post_callback=lambda j: seen.append("post3"))
c.set_ros_time_override(Time(seconds=4, clock_type=ClockType.ROS_TIME))
(list(seen), seen.clear(), c.now())
(h2.unregister(), h2.unregister())
c.set_ros_time_override(Time(seconds=6, clock_type=ClockType.ROS_TIME))
(list(seen), seen.clear(), c.now())
h1.unregister()
with h3 as same:
    seen.append(same is h3)
c.set_ros_time_override(Time(seconds=8, clock_type=ClockType.ROS_TIME))
(list(seen), seen.clear(), c.now())
c._set_ros_time_is_active(False)
Clock().sleep_for(Duration(seconds=0.01))
rclpy.init()  # ours: a context manager, as in Kilted
Clock().sleep_for(Duration(seconds=0.01))
Clock().sleep_until(Time(seconds=1, clock_type=ClockType.ROS_TIME))
Clock().sleep_until(Time(seconds=1))
Clock(clock_type=ClockType.STEADY_TIME).sleep_for(Duration(seconds=0.01))
c.sleep_for(Duration(seconds=0.01))
Clock().sleep_for(Duration(seconds=-1))
c2 = ROSClock()
threading.Timer(1.0, lambda: c2._set_ros_time_is_active(True)).start()
c2.sleep_for(Duration(seconds=100))
threading.Timer(1.0, lambda: c2.set_ros_time_override(Time(seconds=1000, clock_type=ClockType.ROS_TIME))).start()
c2.sleep_for(Duration(seconds=100))
threading.Timer(1.0, rclpy.shutdown).start()
Clock().sleep_for(Duration(seconds=100))
Clock().sleep_for(Duration(seconds=1))


def steps(period_ms, *times_ms):
    """Return the number of calls of a timer at each time, and the time until its next call."""
    context = rclpy.Context()
    context.init()
    node = rclpy.create_node("steps", context=context)
    clock, found, calls = ROSClock(), [], []
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(seconds=1, clock_type=ClockType.ROS_TIME))
    timer = node.create_timer(period_ms / 1000, lambda: calls.append(timer.time_since_last_call()), clock=clock)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    for ms in times_ms:
        clock.set_ros_time_override(Time(nanoseconds=10**9 + ms * 10**6, clock_type=ClockType.ROS_TIME))
        for _ in range(8):
            executor.spin_once(timeout_sec=0)
        found.append((ms, len(calls), timer.time_until_next_call() / 1e6, timer.is_ready()))
        calls.clear()
    executor.shutdown()
    node.destroy_node()
    context.shutdown()
    return found


steps(50, 100, 200, 300, 350, 400, 450, 600, 1000)
steps(50, 49, 50, 51, 99, 100, 149, 151, 199, 201, 350, 499, 500)
steps(20, 20, 60, 61, 80, 1000, 1019, 1020, 1021)
steps(30, 100, 200, 300, 90, 60, 30, 0, 29, 30, 31, 300)
steps(1, 1, 2, 4, 1000)
steps(1000, 2000, 2000, 4000, 3999, 4000, 9000)
