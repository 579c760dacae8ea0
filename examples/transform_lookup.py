"""Where is what the lidar sees? python examples/transform_lookup.py

A robot drives in a circle and tells where it is, ten times a second; its lidar is fixed on it. The other half of the
program turns a point that the lidar sees into the map, at the time it was seen. Seen:

    (1.0, 0.0, 0.0) of lidar is (4.20, 0.00, 0.50) in map

For the transforms of another robot, name the frames: python examples/transform_lookup.py odom base_link
"""

import asyncio
import sys

import numpy as np

from rosidl_py_gen.numpy import euler_to_quaternion
from rosidl_py_gen.runtime import Node, run
from rosidl_py_gen.tf import (
    StaticTransformBroadcaster,
    Transform,
    TransformBroadcaster,
    TransformBuffer,
    TransformTimeoutError,
)

POINT = (1.0, 0.0, 0.0)


async def drive(node: Node) -> None:
    """Tell where the robot and its lidar are."""
    ahead = Transform("base_link", "lidar", 0, np.array([0.2, 0.0, 0.5]), np.array([0.0, 0.0, 0.0, 1.0]))
    StaticTransformBroadcaster(node).send(ahead)
    moving = TransformBroadcaster(node)
    rate = node.create_rate(10)
    angle = 0.0
    while True:
        place = 3 * np.array([np.cos(angle), np.sin(angle), 0.0])
        heading = euler_to_quaternion(0.0, 0.0, angle)
        moving.send(Transform("map", "base_link", node.clock.now().nanoseconds, place, heading))
        angle += 0.05
        await rate.sleep()


async def look(node: Node, target: str, source: str) -> None:
    """Say twice a second where the point is."""
    buffer = TransformBuffer(node)
    while True:
        seen_at = node.clock.now() if buffer.can_transform(target, source) else None  # None: the first that is told
        try:  # the robot tells a moment later where it was then
            transform = await buffer.wait_for_transform(target, source, seen_at, timeout_s=2)
        except TransformTimeoutError as error:
            print(error, flush=True)
            continue
        x, y, z = transform.apply(POINT)
        print(f"{POINT} of {source} is ({x:.2f}, {y:.2f}, {z:.2f}) in {target}", flush=True)
        await node.clock.sleep_for(0.5)


async def main() -> None:
    async with Node("transform_lookup") as node:
        if len(sys.argv) == 3:
            await look(node, *sys.argv[1:])
        else:
            await asyncio.gather(drive(node), look(node, "map", "lidar"))


if __name__ == "__main__":
    run(main)
