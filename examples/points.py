"""Turn and filter a list of points with numpy: received and sent as arrays, no object per point.

Run it: ``rosidl-py-gen --install`` once, then ``python examples/points.py``. It takes markers on
``points`` and publishes them, turned by 30 degrees and without what is further than 5 m, on ``points_near``.

Seen: nothing here; ``rosidl-py topic echo points_near`` shows the points that are left.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from visualization_msgs.msg import Marker

from rosidl_py_gen import records
from rosidl_py_gen.runtime import Node, run

REACH_M = 5.0
TURN = math.radians(30)


def near(points: NDArray[np.void]) -> NDArray[np.bool_]:
    """Which points are within reach."""
    within: NDArray[np.bool_] = np.hypot(points["x"], points["y"]) <= REACH_M
    return within


def turned(points: NDArray[np.void], angle: float) -> NDArray[np.void]:
    """The points turned about z."""
    result: NDArray[np.void] = points.copy()  # what was received is read-only
    result["x"] = points["x"] * math.cos(angle) - points["y"] * math.sin(angle)
    result["y"] = points["x"] * math.sin(angle) + points["y"] * math.cos(angle)
    return result


async def main() -> None:
    async with Node("points") as node:
        out = node.create_publisher(Marker, "points_near")
        async for marker in node.create_subscription(Marker, "points", arrays=True):
            points = records(marker.points)  # an array already: only type checkers need to be told
            kept = turned(points[near(points)], TURN)
            out.publish(
                Marker(header=marker.header, type=Marker.POINTS, scale=marker.scale, color=marker.color, points=kept)
            )


if __name__ == "__main__":
    run(main)
