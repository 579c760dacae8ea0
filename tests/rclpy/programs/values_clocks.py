"""Clocks, jumps of time, and sleeping."""
# ruff: noqa
# fmt: off

import threading
import rclpy
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
h1 = c.create_jump_callback(anything, pre_callback=lambda: seen.append("pre"), post_callback=lambda j: seen.append((j.clock_change, j.delta.nanoseconds, type(j).__name__)))
c.now().nanoseconds > 10**18
c._set_ros_time_is_active(True)
c.now()
c.set_ros_time_override(Time(seconds=5, clock_type=ClockType.ROS_TIME))
c.set_ros_time_override(Time(seconds=3, clock_type=ClockType.ROS_TIME))
c.set_ros_time_override(Time(seconds=3))
(list(seen), seen.clear(), c.now())
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
rclpy.init()
Clock().sleep_for(Duration(seconds=0.01))
Clock().sleep_until(Time(seconds=1, clock_type=ClockType.ROS_TIME))
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
