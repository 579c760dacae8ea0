"""Many bags to Parquet by 1, 2, ... processes of Dask: python bench/many_bags.py [--bags 20] [--workers 1 2].

Bags of one robot each, 60 s of Imu, odometry, transforms, joints and scans; three rounds of each number of workers, in
turn, the shortest counts. Starting the processes is told by itself: a scheduler that is there has done it already.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import bags
import numpy as np
from distributed import Client, LocalCluster

from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.tables import write_datasets

SECONDS = 60
TYPES = [name for name in bags.ROBOT_HZ if not name.endswith("PointCloud2")]


def make(path: Path, seed: int) -> int:
    rng = np.random.default_rng(seed)
    messages = {name: bags.sample(name) for name in TYPES}
    due = sorted(
        (int(1e9 * (1 + number / bags.ROBOT_HZ[name])), name)
        for name in TYPES
        for number in range(bags.ROBOT_HZ[name] * SECONDS)
    )
    with BagWriter(path) as writer:
        for log_time, name in due:
            message = messages[name]
            if name.endswith("Imu"):
                message.linear_acceleration.x = float(rng.random())
            if name.endswith("LaserScan"):
                message.ranges = rng.random(720, np.float32)
            writer.write("/" + name.split("/")[2].lower(), message, log_time)
    return len(due)


def once(paths: list[Path], out: Path, workers: int) -> tuple[float, float, float]:
    """Seconds of starting, of doing it, and of CPU that the workers took for that."""
    began = time.monotonic()
    options: dict[str, Any] = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(n_workers=workers, silence_logs=40, **options) as cluster, Client(cluster) as client:
        client.run(__import__, "rosidl_py_gen.tables")
        started, cpu = time.monotonic(), sum(client.run(time.process_time).values())
        report = write_datasets(paths, out, scheduler=cluster.scheduler_address)
        done, cpu = time.monotonic(), sum(client.run(time.process_time).values()) - cpu
    assert not report.failed and len(report.files) == len(paths)
    shutil.rmtree(out)
    return started - began, done - started, cpu


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=int, default=20)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = folder / "000.mcap"
        count = make(first, 0)
        paths = [first, *(folder / f"{number:03}.mcap" for number in range(1, arguments.bags))]
        for path in paths[1:]:
            shutil.copy(first, path)
        size = sum(path.stat().st_size for path in paths)
        print(f"{len(paths)} bags, {count} messages and {size / len(paths) / 1e6:.1f} MB each", flush=True)
        best: dict[int, tuple[float, float, float]] = {}
        for _ in range(3):
            for workers in arguments.workers:
                found = once(paths, folder / "out", workers)
                best[workers] = min(best.get(workers, found), found, key=lambda one: one[1])
        for workers, (start, took, cpu) in best.items():
            factor = best[arguments.workers[0]][1] / took
            print(
                f"{workers} workers: {took:.1f} s, {cpu:.1f} s of CPU, {size / took / 1e6:.0f} MB/s, {factor:.2f}x; "
                f"started in {start:.1f} s; load of the machine {os.getloadavg()[0]:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
