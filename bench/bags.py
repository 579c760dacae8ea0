"""Reading and recording of bags: python bench/bags.py [--only decode|tables|write|record].

Decoding: the same files read by us, mcap-ros2-support, mcap-ros2-support-fast and rosbags, in turn; the shortest CPU
time of several rounds each. Tables: see bag_tables.py. Writing: 6 MB images through `BagWriter`.
Recording: a process that publishes such images 33 times a second, 205 MB/s, and `rosidl-py bag record` beside it; lost
ones are counted.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import bag_tables
import numpy as np
from mcap.decoder import DecoderFactory as McapDecoderFactory

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter, DecoderFactory

DOMAIN, HZ, SECONDS = "218", 33, 10
IMAGE_BYTES = 6_220_800
COUNTS = {
    "std_msgs/msg/String": 20_000,
    "sensor_msgs/msg/Imu": 20_000,
    "sensor_msgs/msg/LaserScan": 5_000,
    "tf2_msgs/msg/TFMessage": 5_000,
    "sensor_msgs/msg/PointCloud2": 500,
}
ROBOT_HZ = {
    "sensor_msgs/msg/Imu": 200,
    "tf2_msgs/msg/TFMessage": 50,
    "nav_msgs/msg/Odometry": 50,
    "sensor_msgs/msg/JointState": 50,
    "std_msgs/msg/String": 10,
    "sensor_msgs/msg/LaserScan": 10,
    "sensor_msgs/msg/PointCloud2": 10,
}
ROBOT_SECONDS = 20
"""A robot that moves about: how often each of its topics says something, and for how long."""
ROUNDS = 5


def sample(name: str) -> Any:
    cls: Any = get_message(name)
    if name.endswith("String"):
        return cls(data="hello world")
    if name.endswith("TFMessage"):
        transform: Any = get_message("geometry_msgs/msg/TransformStamped")
        return cls(transforms=[transform(child_frame_id=f"link_{number}") for number in range(10)])
    message = cls()
    message.header.frame_id = "laser"
    if name.endswith("JointState"):
        message.name = [f"joint_{number}" for number in range(12)]
        message.position = message.velocity = message.effort = np.linspace(0, 1, 12)
    if name.endswith("LaserScan"):
        message.ranges = np.linspace(0, 10, 720, dtype="f4")
        message.intensities = np.zeros(720, "f4")
    if name.endswith("PointCloud2"):
        field: Any = get_message("sensor_msgs/msg/PointField")
        message.fields = [field(name=axis, offset=4 * at, datatype=7, count=1) for at, axis in enumerate("xyz")]
        message.point_step, message.width, message.data = 12, 10_000, np.zeros(120_000, np.uint8)
    return message


# ------------------------------------------------------------------------------------------------------------ decoding


def ours(path: Path) -> int:
    with BagReader(path) as reader:
        return sum(1 for _ in reader)


def ours_unchecked(path: Path) -> int:
    with BagReader(path, validate_crcs=False) as reader:
        return sum(1 for _ in reader)


class Nothing(McapDecoderFactory):
    """Decodes nothing: what mcap's reader costs by itself."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any]:
        return bytes


def with_reader_of_mcap(factory: Callable[[], Any]) -> Callable[[Path], int]:
    def read(path: Path) -> int:
        from mcap.reader import make_reader

        with path.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[factory()])
            return sum(1 for _ in reader.iter_decoded_messages())

    return read


def rosbags(path: Path) -> int:
    from rosbags.highlevel import AnyReader

    with AnyReader([path.parent]) as reader:
        return sum(reader.deserialize(data, one.msgtype) is not None for one, _, data in reader.messages())


def readers() -> dict[str, Callable[[Path], int]]:
    found: dict[str, Callable[[Path], int]] = {
        "BagReader": ours,
        "unchecked": ours_unchecked,
        "mcap's reader alone": with_reader_of_mcap(Nothing),
        "our DecoderFactory": with_reader_of_mcap(DecoderFactory),
    }
    for name in ("mcap_ros2", "mcap_ros2_support_fast"):
        try:
            found[name] = with_reader_of_mcap(import_module(f"{name}.decoder").DecoderFactory)
        except ImportError:
            print(f"{name} is not installed")
    return {**found, "rosbags": rosbags}


def decode(folder: Path) -> None:
    them = readers()
    print("us of CPU a message, and how many times that of BagReader")
    for name, count in COUNTS.items():
        bag = folder / name.replace("/", "_")
        with BagWriter(bag, compression="lz4") as writer:
            message = sample(name)
            for number in range(count):
                writer.write("/topic", message, 1_000_000_000 + number)
        take_turns(them, name, bag, count)
    bag = folder / "robot"
    due = sorted(
        (int(1e9 * (1 + number / hz)), name) for name, hz in ROBOT_HZ.items() for number in range(hz * ROBOT_SECONDS)
    )
    messages = {name: sample(name) for name in ROBOT_HZ}
    with BagWriter(bag, compression="lz4") as writer:
        for log_time, name in due:
            writer.write("/" + name.split("/")[2].lower(), messages[name], log_time)
    take_turns(them, "a robot's bag", bag, len(due))


def take_turns(them: dict[str, Callable[[Path], int]], name: str, bag: Path, count: int) -> None:
    """Read one bag with each, and print what a message took."""
    (path,) = bag.glob("*.mcap")
    best = dict.fromkeys(them, float("inf"))
    for _ in range(ROUNDS):
        for kind, read in them.items():
            began = time.process_time()
            assert read(path) == count
            best[kind] = min(best[kind], (time.process_time() - began) / count * 1e6)
    shown = (f"{kind} {value:.1f} ({value / best['BagReader']:.1f}x)" for kind, value in best.items())
    print(f"{name}: {', '.join(shown)}", flush=True)


def tables(folder: Path) -> None:
    bag_tables.imus(folder / "imus", sample("sensor_msgs/msg/Imu"), __file__)
    bag_tables.mixed(folder / "mixed", {name: sample(name) for name in ROBOT_HZ}, ROBOT_HZ, 5 * ROBOT_SECONDS)


# ----------------------------------------------------------------------------------------------- writing and recording


def write(folder: Path) -> None:
    image: Any = get_message("sensor_msgs/msg/Image")
    data = image(data=np.random.default_rng(1).integers(0, 255, IMAGE_BYTES, np.uint8)).encode()
    for compression in ("", "lz4", "zstd"):
        path = folder / f"images_{compression}.mcap"
        began, cpu = time.monotonic(), time.process_time()
        with BagWriter(path, compression=compression) as writer:
            writer.add_topic("/image", image)
            for number in range(100):
                writer.write("/image", data, number)
        seconds, cpu = time.monotonic() - began, time.process_time() - cpu
        size = 100 * len(data) / 1e6
        print(
            f"write, {compression or 'none'}: {size / seconds:.0f} MB/s, {size / cpu:.0f} MB per s of CPU", flush=True
        )
        path.unlink()


def record(folder: Path) -> None:
    os.environ.update(ROS_DOMAIN_ID=DOMAIN, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    for compression in ("none", "zstd", "lz4"):
        bag = folder / f"recorded_{compression}"
        command = (*(sys.executable, "-m", "rosidl_py_gen.ros_cli", "bag", "record", "/image"), "-o", str(bag))
        recorder = subprocess.Popen([*command, "--compression", compression], stderr=subprocess.PIPE, text=True)
        sent = int(subprocess.run([sys.executable, __file__, "--peer"], check=True, stdout=subprocess.PIPE).stdout)
        time.sleep(1)
        recorder.send_signal(signal.SIGINT)
        _, said = recorder.communicate(timeout=60)
        with BagReader(bag) as reader:
            count = reader.topics["/image"].count
        print(f"record, {compression}: {count} of {sent} images at {HZ} Hz; {said.splitlines()[-1]}", flush=True)


async def publish() -> None:
    from rosidl_py_gen.runtime import Node, QoSProfile

    image: Any = get_message("sensor_msgs/msg/Image")
    message = image(data=np.random.default_rng(1).integers(0, 255, IMAGE_BYTES, np.uint8))
    async with Node("camera") as node:
        publisher = node.create_publisher(image, "image", QoSProfile(depth=10))
        assert await publisher.wait_for_subscribers(20)
        rate = node.create_rate(HZ)
        for _ in range(HZ * SECONDS):
            publisher.publish(message)
            await rate.sleep()
        await publisher.wait_for_acknowledged(5)
    print(HZ * SECONDS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=["decode", "tables", "write", "record"])
    parser.add_argument("--memory", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--folder", help="where to write; it has to have 2 GB", default=None)
    parser.add_argument("--peer", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.peer:
        asyncio.run(publish())
        return
    if arguments.memory:
        bag_tables.memory(arguments.memory[0], Path(arguments.memory[1]))
        return
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        for part in (decode, tables, write, record):
            if arguments.only in (None, part.__name__):
                part(Path(folder))


if __name__ == "__main__":
    main()
