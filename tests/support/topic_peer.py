"""Node whose topics many tests inspect: ``python topic_peer.py`` prints ``ready`` and ends with its standard input."""

from __future__ import annotations

import asyncio
import sys
import time

import numpy as np
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Imu, LaserScan
from std_msgs.msg import Bool, String

from rosidl_py_gen.runtime import Node, QoSProfile

LATCHED = QoSProfile().transient_local()


async def main() -> None:
    """Latched topics under /demo, which `topic list` shows, and hidden ones that go on."""
    async with Node("talker", "/demo", enable_rosout=False, parameter_events=False) as node:
        scan = LaserScan(ranges=np.arange(200, dtype="f4"), range_max=float("nan"))
        scan.header.frame_id = "laser"
        node.create_publisher(LaserScan, "scan", LATCHED).publish(scan)
        pose = PoseStamped()
        pose.pose.position.x = 1.5
        node.create_publisher(PoseStamped, "pose", LATCHED).publish(pose)
        node.create_publisher(Imu, "_imu", LATCHED).publish(Imu())
        scans = node.create_publisher(LaserScan, "_scans", LATCHED)
        for ranges in ([], [], [4.0]):
            scans.publish(LaserScan(ranges=np.array(ranges, "f4")))
        node.create_publisher(String, "words", 7)
        node.create_subscription(String, "words", lambda message: None)
        node.create_subscription(Bool, "switch", lambda message: None)
        poses, words = node.create_publisher(PoseStamped, "_poses"), node.create_publisher(String, "_words")
        print("ready", flush=True)
        ended = asyncio.ensure_future(asyncio.to_thread(sys.stdin.read))
        while not ended.done():
            stamp = pose.header.stamp
            stamp.sec, stamp.nanosec = divmod(time.time_ns() - 2 * 10**9, 10**9)
            poses.publish(pose)
            words.publish(String(data="x" * 100))
            await asyncio.sleep(0.02)


asyncio.run(main())
