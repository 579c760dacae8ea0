"""Drive all robots of a network by one program: python examples/several_robots.py

Each robot has topics in its namespace, such as /robot1/scan, and frames with this prefix. The program turns each robot
away from obstacles, and the second of a close pair waits. Robots may be started and ended at any time. Start three with
rosidl-py demo --count 3. Messages: rosidl-py-gen --install. Seen:

    found /robot1
    found /robot2
    closest: /robot1 and /robot2, 2.4 m
"""

from itertools import combinations

import numpy as np
from geometry_msgs.msg import Twist, Vector3
from sensor_msgs.msg import LaserScan

from rosidl_py_gen.runtime import SENSOR_DATA, Node, run
from rosidl_py_gen.tf import TransformBuffer

FREE_M, APART_M = 0.8, 1.0


class Robot:
    """Driver of one robot; all drivers share a node."""

    def __init__(self, node: Node, namespace: str) -> None:
        self.namespace = namespace
        self.frame = f"{namespace}/base_link".strip("/")
        self.must_wait = False
        self.commands = node.create_publisher(Twist, f"{namespace}/cmd_vel")
        self.scans = node.create_subscription(LaserScan, f"{namespace}/scan", self.on_scan, SENSOR_DATA)

    def on_scan(self, scan: LaserScan) -> None:
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        is_blocked = np.asarray(scan.ranges)[np.abs(angles) < 0.5].min() < FREE_M
        speed, turn = 0.0 if is_blocked or self.must_wait else 0.3, 1.0 if is_blocked else 0.0
        self.commands.publish(Twist(linear=Vector3(x=speed), angular=Vector3(z=turn)))

    def close(self) -> None:
        self.commands.close()
        self.scans.close()


def find_robots(node: Node) -> set[str]:
    """Return the namespaces with a scan; only publishers count, because the drivers subscribe."""
    scans = [name for name, _ in node.get_topic_names_and_types() if name.endswith("/scan")]
    return {name.removesuffix("/scan") for name in scans if node.count_publishers(name)}


def keep_apart(robots: list[Robot], buffer: TransformBuffer) -> None:
    """Print the closest pair, and make the second robot of each close pair wait."""
    distances = {}
    for one, other in combinations(robots, 2):
        if buffer.can_transform(one.frame, other.frame):  # a new robot has not sent its frames yet
            way = buffer.lookup_transform(one.frame, other.frame).translation
            distances[one, other] = float(np.linalg.norm(way))
    for robot in robots:
        robot.must_wait = any(robot is other and way < APART_M for (_, other), way in distances.items())
    if distances:
        one, other = min(distances, key=distances.__getitem__)
        print(f"closest: {one.namespace} and {other.namespace}, {distances[one, other]:.1f} m", flush=True)


async def main() -> None:
    async with Node("fleet") as node:
        buffer, robots = TransformBuffer(node), dict[str, Robot]()
        while True:
            found = find_robots(node)
            for namespace in sorted(found ^ robots.keys()):
                print("found" if namespace in found else "lost", namespace, flush=True)
                if namespace in found:
                    robots[namespace] = Robot(node, namespace)
                else:
                    robots.pop(namespace).close()
            keep_apart(list(robots.values()), buffer)
            await node.clock.sleep_for(1.0)


run(main)
