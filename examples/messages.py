"""Messages without a node: build, encode, decode, look inside.

Needs message packages: rosidl-py-gen --install, once. Then
python examples/messages.py. Seen: sizes, arrays, JSON, and what errors say about a field and a byte.
"""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from rosidl_py_gen import DecodeError, EncodeError, compile_definition, from_json, to_dict, to_json, type_hash


def square(side_m: float) -> PoseArray:
    """The corners of a square, looking along x."""
    corners = [(0.0, 0.0), (side_m, 0.0), (side_m, side_m), (0.0, side_m)]
    return PoseArray(
        header=Header(frame_id="map"),
        poses=[Pose(position=Point(x=x, y=y), orientation=Quaternion(w=1.0)) for x, y in corners],
    )


def nearest_m(scan: LaserScan) -> float:
    """The shortest valid range of a scan, in metres."""
    valid = scan.ranges[(scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)]
    return float(valid.min())


def main() -> None:
    path = square(2.0)
    data = path.encode()
    print(f"{len(data)} bytes, {PoseArray.decode(data) == path}, {type_hash(path)[:14]}")

    scan = LaserScan(range_min=0.1, range_max=10.0, ranges=np.array([0.05, 3.5, 2.25], np.float32))
    print(nearest_m(LaserScan.decode(scan.encode())), to_dict(scan)["ranges"])
    print(from_json(Point, '{"x": 1.5, "y": "NaN"}'), to_json(Point(x=1.5)))

    try:
        Header(frame_id=b"not text").encode()  # type: ignore[arg-type]
    except EncodeError as error:
        print(error)
    try:
        LaserScan.decode(data[:20])
    except DecodeError as error:
        print(error)

    sample = compile_definition("my_msgs/msg/Sample", "float32[] values  # Readings [V]\nstring<=8 unit V\n")
    print(sample(values=[1.5, 2.5]))


if __name__ == "__main__":
    main()
