"""Filter point clouds with numpy: python examples/cloud_filter.py, or with --demo when there is no lidar.

It takes ``PointCloud2`` messages on ``points``, whatever fields they have, and publishes on ``points_filtered`` what is
nearer than 5 m and above the ground. The points are never copied but for those that stay. Seen, for every cloud:

    1000 points, 412 left
"""

import asyncio
import sys

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from rosidl_py_gen.numpy import array_to_pointcloud, pointcloud_to_array
from rosidl_py_gen.runtime import SENSOR_DATA, Node, run

REACH_M, GROUND_M = 5.0, 0.1


def wanted(points: NDArray[np.void]) -> NDArray[np.bool_]:
    """Which points stay; comparisons with NaN are false."""
    near: NDArray[np.bool_] = np.hypot(points["x"], points["y"]) < REACH_M
    return near & (points["z"] > GROUND_M)


async def demo(node: Node) -> None:
    """Publish clouds of random points, as a lidar that sees nothing sensible."""
    clouds = node.create_publisher(PointCloud2, "points", SENSOR_DATA)
    await clouds.wait_for_subscribers()
    random = np.random.default_rng(1)
    rate = node.create_rate(2)
    while True:
        points = np.zeros(1000, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "u1")])
        for axis, size in (("x", 8), ("y", 8), ("z", 2)):
            points[axis] = random.uniform(-size, size, len(points))
        header = Header(stamp=node.clock.now().to_msg(), frame_id="lidar")
        clouds.publish(array_to_pointcloud(points, header=header, cls=PointCloud2))
        await rate.sleep()


async def filter_clouds(node: Node) -> None:
    filtered = node.create_publisher(PointCloud2, "points_filtered", SENSOR_DATA)
    async for cloud in node.create_subscription(PointCloud2, "points", qos=SENSOR_DATA):
        points = pointcloud_to_array(cloud)
        left = points[wanted(points)]
        filtered.publish(array_to_pointcloud(left, header=cloud.header, cls=PointCloud2))
        print(f"{points.size} points, {left.size} left", flush=True)


async def main() -> None:
    async with Node("cloud_filter") as node:
        await asyncio.gather(filter_clouds(node), *([demo(node)] if "--demo" in sys.argv else []))


if __name__ == "__main__":
    run(main)
