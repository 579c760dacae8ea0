"""numpy's numbers and odd values where programs give them: parameters, periods, depths, durations, messages."""

import array
import warnings

import numpy as np
import rclpy
from geometry_msgs.msg import Point
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float64, Int32, UInt8MultiArray

warnings.simplefilter("ignore")
rclpy.init()
node = rclpy.create_node("numbers")


def tell(name, what):
    try:
        print(name, what())
    except Exception as error:
        print(name, type(error).__name__)


for number, value in enumerate(
    [np.float64(1.5), np.float32(1.5), np.int64(3), np.bool_(True), np.array([1.0]), [1, 2.0], (1, 2), [True, False],
     array.array("d", [1.0]), array.array("q", [1]), b"x", [b"x"], None, {}, "", [], -(2**63), float("nan")]
):
    tell(f"parameter {value!r}", lambda: node.declare_parameter(f"p{number}", value).type_)
node.declare_parameter("doubles", [1.0, 2.0])
tell("doubles", lambda: node.set_parameters([Parameter("doubles", value=[1, 2])])[0].successful)
tell("doubles", lambda: node.get_parameter("doubles").value)
tell("message", lambda: node.get_parameter("doubles").get_parameter_value().double_array_value)
for period in (np.float64(0.5), np.float32(0.5), 1 / 2, 1, 0, -1, "1", None):
    tell(f"timer {period!r}", lambda: node.create_timer(period, print).timer_period_ns)
for depth in (np.int64(5), 5, 0, -1, 5.0, True):
    tell(f"depth {depth!r}", lambda: QoSProfile(depth=depth).depth)
    tell(f"publisher {depth!r}", lambda: node.create_publisher(Int32, "t", depth) and "made")
for seconds in (np.float64(1.25), np.int32(2), 0.1, -1, "", 1e12):  # rclpy multiplies a text, too: by 10**9
    tell(f"duration {seconds!r}", lambda: Duration(seconds=seconds).nanoseconds)
    tell(f"time {seconds!r}", lambda: Time(seconds=seconds).nanoseconds)
publisher = node.create_publisher(Float64, "f", 10)
for data in (np.float32(1.5), np.int64(3), 1, True):
    message = Float64()

    def send():
        message.data = data
        publisher.publish(message)
        return "sent"

    tell(f"message {data!r}", send)
scan = LaserScan(ranges=np.arange(3, dtype=np.float32))
scan.intensities = [1, 2.5]
scan.ranges.append(9.0)
tell("ranges", lambda: scan.ranges)
tell("numpy", lambda: np.array(scan.ranges).dtype)
tell("slice", lambda: scan.ranges[1:] + scan.ranges[:1])
tell("min", lambda: min(scan.ranges) if scan.ranges else None)
tell("bytes", lambda: UInt8MultiArray(data=b"abc").data)
tell("bytes", lambda: UInt8MultiArray(data=np.zeros(2, np.uint8)).data.tobytes())
tell("point", lambda: Point(x=np.float64(1.0), y=float(np.float32(2))))
tell("point", lambda: Point(x=1))
node.destroy_node()
rclpy.shutdown()
