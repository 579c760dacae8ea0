"""Times, durations and kinds of clocks."""
# ruff: noqa
# fmt: off

from rclpy.clock_type import ClockType
from rclpy.duration import Duration, Infinite
from rclpy.time import Time

Time(nanoseconds=5).clock_type
repr(Time(clock_type=ClockType.ROS_TIME))
Time(clock_type=1)
Time(seconds="a")
Time(nanoseconds=1.5)
Time(nanoseconds=1.5).nanoseconds
Time()-5
Time()+Time()
Time()-Duration(seconds=1)
Time(nanoseconds=2**63-1)+Duration(nanoseconds=1)
Time(clock_type=ClockType.ROS_TIME)==Time()
Time()==3
Time()<3
hash(Time())
hash(Duration())
Duration()<3
Duration(seconds=float("inf"))
Duration(seconds=float("nan"))
Time(seconds=1)-Time(seconds=2)
Duration(seconds=1)+Time()
Duration()+Duration()  # ours: as in Lyrical
Duration(seconds=-1)
Duration(seconds=1,nanoseconds=-1)
Duration(nanoseconds=-2**63-1)
Duration(seconds=None)
-Duration(seconds=1)
Duration(seconds=-1).to_msg()
Duration(nanoseconds=2**62).to_msg()
Time(nanoseconds=2**62).to_msg()
Time(clock_type=ClockType.UNINITIALIZED)
Duration(5)
Duration(seconds=True)
bool(Duration())
list(ClockType)
ClockType(4)
ClockType.ROS_TIME.value
type(ClockType.ROS_TIME.value)
Time().__slots__
Time(clock_type=ClockType.STEADY_TIME)-Duration()
str(Infinite)
Infinite
Duration.from_msg(Duration(seconds=1.5).to_msg())
Duration.from_msg(5)
Time.from_msg(Time(seconds=1.5).to_msg())
Time.from_msg(Time().to_msg(), ClockType.STEADY_TIME)
Time.from_msg(Duration().to_msg())
Time(seconds=-1)
Time(nanoseconds=-1)
Time(seconds=2**63)
Time(seconds=1.0000000019).nanoseconds
Time(seconds=1, nanoseconds=5).seconds_nanoseconds()
Time(seconds=1) != Time(seconds=2)
Time(seconds=1) > Time(seconds=2)
Duration(seconds=1) >= Duration(seconds=2)
