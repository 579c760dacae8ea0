"""A topic of 10^6 Imu as a table: to Arrow, and to pandas in a loop over rosbags: python bench/tables.py.

Prints the shortest CPU time of several rounds. The figure is in docs/howto/tables.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter


def row(log_time: int, message: Any) -> dict[str, Any]:
    """A message as people write it for `pandas.DataFrame`."""
    header, turn = message.header, message.orientation
    rates, forces = message.angular_velocity, message.linear_acceleration
    return {
        "log_time": log_time,
        "sec": header.stamp.sec,
        "nanosec": header.stamp.nanosec,
        "frame_id": header.frame_id,
        "orientation.x": turn.x,
        "orientation.y": turn.y,
        "orientation.z": turn.z,
        "orientation.w": turn.w,
        "angular_velocity.x": rates.x,
        "angular_velocity.y": rates.y,
        "angular_velocity.z": rates.z,
        "linear_acceleration.x": forces.x,
        "linear_acceleration.y": forces.y,
        "linear_acceleration.z": forces.z,
        "orientation_covariance": message.orientation_covariance,
        "angular_velocity_covariance": message.angular_velocity_covariance,
        "linear_acceleration_covariance": message.linear_acceleration_covariance,
    }


def to_pandas(rows: Iterable[dict[str, Any]]) -> int:
    """Data frames of 10^5 rows, one at a time: all of them would not fit into memory."""
    import pandas as pd

    count, rows = 0, iter(rows)
    while some := list(islice(rows, 100_000)):
        count += len(pd.DataFrame(some))
    return count


def rosbags_to_pandas(path: Path) -> int:
    from rosbags.highlevel import AnyReader

    with AnyReader([path.parent]) as reader:
        return to_pandas(row(time, reader.deserialize(data, one.msgtype)) for one, time, data in reader.messages())


def to_arrow(path: Path) -> int:
    with BagReader(path) as reader:
        return int(reader.table("/imu").num_rows)


def arrow_to_pandas(path: Path) -> int:
    with BagReader(path) as reader:
        return sum(len(batch.to_pandas()) for batch in reader.batches("/imu"))


def write_imus(bag: Path, count: int) -> Path:
    """Write a bag of Imu with random accelerations; return its file."""
    message: Any = get_message("sensor_msgs/msg/Imu")()
    message.header.frame_id = "laser"
    values = np.random.default_rng(1).random((count, 3))
    with BagWriter(bag, compression="lz4") as writer:
        for number, (x, y, z) in enumerate(values.tolist()):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(number * 5_000_000, 10**9)
            force = message.linear_acceleration
            force.x, force.y, force.z = x, y, z
            writer.write("/imu", message, 1_000_000_000 + number * 5_000_000)
    (path,) = bag.glob("*.mcap")
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    count = parser.parse_args().count
    took: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = write_imus(Path(folder, "imus"), count)
        readers = {"Arrow": to_arrow, "Arrow to pandas": arrow_to_pandas, "rosbags to pandas": rosbags_to_pandas}
        for kind, read in readers.items():
            for _ in range(3 if kind.startswith("Arrow") else 1):
                began = time.process_time()
                assert read(path) == count
                took[kind] = min(took.get(kind, float("inf")), time.process_time() - began)
    shown = (f"{kind} {value:.2f} s ({value / took['Arrow']:.1f}x)" for kind, value in took.items())
    print(f"{count} Imu, s of CPU: {', '.join(shown)}")


if __name__ == "__main__":
    main()
