"""Bags as tables: a part of bench/bags.py.

A topic of 10^6 Imu to Arrow, and to pandas in a loop over what mcap-ros2-support and rosbags give; a robot's bag to
Parquet, and what unpacking its chunks takes of that, with and without writing finished tables; and how much memory both
take.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.tables import write_dataset

IMUS = 1_000_000


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


def mcap_ros2_to_pandas(path: Path) -> int:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory as Theirs

    with path.open("rb") as stream:
        found = make_reader(stream, decoder_factories=[Theirs()]).iter_decoded_messages()
        return to_pandas(row(one.message.log_time, one.decoded_message) for one in found)


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


def unpacked(path: Path) -> int:
    """Bytes of all chunks, read, unpacked and their checksums compared, by the libraries themselves."""
    with path.open("rb") as stream:
        return sum(len(unpack(one)) for one in chunks(stream))


def chunks(stream: Any) -> Iterator[Any]:
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    yield from (one for one in StreamReader(stream, emit_chunks=True).records if isinstance(one, Chunk))


def unpack(chunk: Any) -> bytes:
    import lz4.frame
    import zstandard

    if chunk.compression == "zstd":
        data = zstandard.decompress(chunk.data, chunk.uncompressed_size)
    else:
        data = lz4.frame.decompress(chunk.data) if chunk.compression else chunk.data
    assert zlib.crc32(data) == chunk.uncompressed_crc
    return data


def imus(bag: Path, message: Any, script: str) -> None:
    """A topic of 10^6 messages, to Arrow by us and to pandas by the others; and how much memory it takes."""
    values = np.random.default_rng(1).random((IMUS, 3))
    with BagWriter(bag, compression="lz4") as writer:
        for number, (x, y, z) in enumerate(values.tolist()):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(number * 5_000_000, 10**9)
            force = message.linear_acceleration
            force.x, force.y, force.z = x, y, z
            writer.write("/imu", message, 1_000_000_000 + number * 5_000_000)
    (path,) = bag.glob("*.mcap")
    took: dict[str, float] = {}
    for kind, read in {
        "Arrow": to_arrow,
        "Arrow to pandas": arrow_to_pandas,
        "mcap-ros2-support to pandas": mcap_ros2_to_pandas,
        "rosbags to pandas": rosbags_to_pandas,
    }.items():
        for _ in range(3 if kind.startswith("Arrow") else 1):
            began = time.process_time()
            assert read(path) == IMUS
            took[kind] = min(took.get(kind, float("inf")), time.process_time() - began)
    shown = (f"{kind} {value:.2f} s ({value / took['Arrow']:.1f}x)" for kind, value in took.items())
    print(f"{IMUS} Imu, s of CPU: {', '.join(shown)}", flush=True)
    for what in ("batches", "parquet"):
        command = (sys.executable, script, "--memory", what, str(path))
        print(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.strip(), flush=True)


def mixed(bag: Path, messages: dict[str, Any], often: dict[str, int], seconds: int) -> None:
    """A robot's bag with noise for values, as Parquet; and what unpacking its chunks takes of that."""
    rng = np.random.default_rng(1)
    due = sorted((int(1e9 * (1 + number / hz)), name) for name, hz in often.items() for number in range(hz * seconds))
    with BagWriter(bag, compression="zstd") as writer:
        for log_time, name in due:
            message = messages[name]
            if name.endswith("Imu"):
                message.linear_acceleration.x = float(rng.random())
            if name.endswith("LaserScan"):
                message.ranges = rng.random(720, np.float32)
            if name.endswith("PointCloud2"):
                message.data = rng.random(30_000, np.float32).view(np.uint8)
            writer.write("/" + name.split("/")[2].lower(), message, log_time)
    (path,) = bag.glob("*.mcap")
    took: dict[str, float] = {}
    for number in range(3):
        kinds: dict[str, Callable[[], Any]] = {
            "unpacking": lambda: unpacked(path),
            "all topics to batches": lambda: every_batch(path),
        }
        for is_large in (False, True):
            for compression in ("zstd", "lz4"):
                what = f"{compression}{', with clouds' * is_large}"
                kinds[f"Parquet, {what}"] = partial(parquet, path, bag.parent / f"out{number}", is_large, compression)
                tables = every_table(path, is_large)
                kinds[f"unpacking and bare pyarrow.parquet of finished tables, {what}"] = partial(
                    bare_parquet, path, tables, bag.parent / f"bare{number}", compression
                )
        for kind, call in kinds.items():
            began = time.process_time()
            call()
            took[kind] = min(took.get(kind, float("inf")), time.process_time() - began)
    shown = (f"{kind} {value:.2f} s" for kind, value in took.items())
    print(f"a robot's bag, {len(due)} messages, {unpacked(path) / 1e6:.0f} MB, zstd: {', '.join(shown)}", flush=True)


def every_batch(path: Path) -> None:
    with BagReader(path) as reader:
        for topic in reader.topics:
            for _ in reader.batches(topic):
                pass


def parquet(path: Path, out: Path, is_large: bool, compression: str) -> None:
    with BagReader(path) as reader:
        write_dataset(reader, out / f"{is_large}{compression}", include_large=is_large, compression=compression)


def every_table(path: Path, is_large: bool) -> list[Any]:
    with BagReader(path) as reader:
        return [reader.table(topic) for topic in reader.topics if is_large or "cloud" not in topic]


def bare_parquet(path: Path, tables: list[Any], out: Path, compression: str) -> None:
    """Measure the minimum: decompress the chunks, and write existing tables by pyarrow."""
    import pyarrow.parquet

    unpacked(path)
    out.mkdir(exist_ok=True)
    for number, table in enumerate(tables):
        pyarrow.parquet.write_table(table, out / f"{number}.parquet", compression=compression)


def kilobytes(name: str) -> int:
    """Return a memory value of this process by its name in /proc/self/status, in kB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))


def memory(what: str, path: Path) -> None:
    """Report the growth of the peak memory of this process; Linux only."""
    with BagReader(path) as reader:
        for _ in reader.batches("/imu", end_ns=reader.start_ns + 1):  # everything is loaded
            pass
        Path("/proc/self/clear_refs").write_text("5")  # what was most so far is now's; getrusage has that of the parent
        before = kilobytes("VmRSS")
        if what == "parquet":
            with tempfile.TemporaryDirectory(dir=path.parent) as out:
                write_dataset(reader, out)
        else:
            for _ in reader.batches("/imu"):
                pass
    more = (kilobytes("VmHWM") - before) / 1024
    print(f"memory, {what} of {IMUS} Imu: {more:.0f} MB more; a row group has 16 MB")
