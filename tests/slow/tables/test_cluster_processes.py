"""Datasets written by processes and by Dask, with workers that are killed, and from an S3 that counts requests."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import distributed
import numpy as np
import psutil
import pytest
import s3fs
from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from std_msgs.msg import Int64
from std_msgs.msg import UInt8MultiArray as Array
from support.bag_datasets import bag_of, rows, said
from support.dask_tasks import die, fail, last_a_minute, pid, run_or_die
from werkzeug.serving import make_server

from rosidl_py_gen import ExtraMissingError
from rosidl_py_gen.bags import BagError, BagReader, BagWriter
from rosidl_py_gen.tables import bag_tasks, multi_bag, write_datasets

BAGS = 60
EACH = 20
PARENT = """
import os, time
from rosidl_py_gen.tables.bag_tasks import TaskResult, local_processes

def pid(task):
    return TaskResult(error=str(os.getpid()))

with local_processes(1) as run:
    run(pid, ["a"], lambda task, result: print(result.error, flush=True))
    time.sleep(60)
"""


@pytest.fixture(scope="module")
def two_workers() -> Iterator[Any]:
    """Two workers."""
    options = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=2, **options) as found:
        yield found


def test_killed_workers_neither_lose_nor_duplicate_messages(two_workers: Any, tmp_path: Path) -> None:
    folder, out = tmp_path / "bags", tmp_path / "out"
    folder.mkdir()
    bags = [bag_of(folder / f"{name:03}.mcap", *range(EACH * name, EACH * name + EACH)) for name in range(BAGS)]
    bags[20].write_bytes(b"junk" * 30)
    bags[21].unlink()
    alive = [one.pid for one in two_workers.workers.values()]
    assert len(alive) == 2

    def kill(done: float, count: int) -> None:
        assert count == BAGS - 1
        if done in (10, 35):
            os.kill(alive.pop(), signal.SIGKILL)

    report = write_datasets(bags, out, scheduler=two_workers.scheduler_address, progress=kill)
    assert not alive
    assert sorted(report.failed) == [str(bags[20]), str(bags[21])]
    right = [(f"{name:03}", EACH * name + k) for name in range(BAGS) if name not in (20, 21) for k in range(EACH)]
    assert rows(out) == right
    assert not list(out.rglob("*.partial"))
    bag_of(bags[20], 1), bag_of(bags[21], 2)
    again = write_datasets(bags, out, scheduler=two_workers.scheduler_address)
    assert said(again)[0] == ["020", "021"] and len(again.unchanged) == BAGS - 2 and not again.failed
    assert rows(out) == sorted([*right, ("020", 1), ("021", 2)])


def test_task_that_kills_its_worker_each_time_is_given_up(two_workers: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(two_workers.scheduler, "allowed_failures", 0)

    with bag_tasks.dask_cluster(two_workers.scheduler_address) as run:
        assert "KilledWorker" in results_of(run, die, [5])[5].error
        assert results_of(run, fail, [6])[6].error == "the worker failed: KeyError: 6"


def test_scheduler_that_does_not_respond_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bag_tasks, "CONNECT_TIMEOUT_S", 0.2)
    bag = bag_of(tmp_path / "a.mcap", 1)
    for address in ("tcp://127.0.0.1:1", "nope://127.0.0.1:1", "tls://127.0.0.1:1"):
        with pytest.raises(BagError, match=f"no scheduler of Dask responds at {address}"):
            write_datasets([bag], tmp_path / "out", scheduler=address)


# ------------------------------------------------------------------------------------------- processes of this machine


def results_of(run: Any, function: Any, tasks: list[Any]) -> dict[Any, Any]:
    results: dict[Any, Any] = {}
    run(function, tasks, results.__setitem__)
    return results


def test_local_processes_are_reused_and_open_no_port() -> None:
    with bag_tasks.local_processes(2) as run:
        first, second = results_of(run, pid, ["a", "b", "c", "d"]), results_of(run, pid, ["e"])
    assert sorted(first) == ["a", "b", "c", "d"]
    pids = {int(one.error) for one in first.values()}
    assert len(pids) <= 2 and os.getpid() not in pids and int(second["e"].error) in pids
    assert [one.warnings for one in first.values()] == [()] * 4
    assert not any(map(psutil.pid_exists, pids))


def test_bag_that_ends_its_process_fails_alone_and_the_next_run_writes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bags = [bag_of(tmp_path / f"{name}.mcap", 1) for name in "abc"]
    with monkeypatch.context() as patch:
        patch.setattr(multi_bag, "run_task", run_or_die)
        report = write_datasets(bags, tmp_path / "out", workers=2)
    assert list(report.failed) == [str(bags[1])] and "ended unexpectedly, twice" in report.failed[str(bags[1])]
    assert sorted(report.files) == ["a", "c"] and rows(tmp_path / "out") == [("a", 1), ("c", 1)]
    again = write_datasets(bags, tmp_path / "out", workers=2)
    assert list(again.files) == ["b"] and not again.failed
    assert rows(tmp_path / "out") == [("a", 1), ("b", 1), ("c", 1)]


def test_task_that_raises_in_a_process_fails_alone() -> None:
    with bag_tasks.local_processes(2) as run:
        assert results_of(run, fail, [6])[6].error == "the worker failed: KeyError: 6"


def test_runs_in_threads_report_their_own_bags(tmp_path: Path) -> None:
    bags = [bag_of(tmp_path / f"{name}.mcap", 1) for name in "abcd"]
    with ThreadPoolExecutor(3) as threads:
        reports = list(threads.map(lambda number: write_datasets(bags, tmp_path / f"{number}", workers=2), range(3)))
    for number, report in enumerate(reports):
        assert (sorted(report.files), report.failed) == (list("abcd"), {})
        assert {Path(one.path).relative_to(tmp_path).parts[0] for files in report.files.values() for one in files} == {
            str(number)
        }


def test_daemonic_process_uses_itself_or_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = bag_of(tmp_path / "a.mcap", 1)
    monkeypatch.setattr(multi_bag, "PROCESSES_BYTES", 0)
    monkeypatch.setattr(multi_bag, "RANGE_BYTES", 1)
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)  # type: ignore[attr-defined]
    with pytest.raises(BagError, match="workers=2: this is a daemonic process"):
        write_datasets([bag], tmp_path / "out", workers=2)
    assert list(write_datasets([bag], tmp_path / "out").files) == ["a"]


def interrupt(task: object, result: object) -> None:
    raise KeyboardInterrupt


def test_interrupt_does_not_wait_for_running_tasks() -> None:
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), bag_tasks.local_processes(3) as run:
        run(last_a_minute, ["a", "b", "c"], interrupt)
    assert time.monotonic() - start < 30


def test_a_local_process_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PARENT)
    with subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
    assert psutil.wait_procs([child], 20)[1] == []


def test_script_without_main_guard_runs_once_and_writes_all_bags(tmp_path: Path) -> None:
    bags = [str(bag_of(tmp_path / f"{name}.mcap", 1)) for name in "ab"]
    script = tmp_path / "script.py"
    script.write_text(
        "from rosidl_py_gen.tables import write_datasets\n"
        f"report = write_datasets({bags}, {str(tmp_path / 'out')!r}, workers=2)\n"
        "print(sorted(report.files), report.failed)\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("['a', 'b'] {}\n", "")
    assert rows(tmp_path / "out") == [("a", 1), ("b", 1)]


def test_processes_need_dask(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = bag_of(tmp_path / "a.mcap", 1)
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(ExtraMissingError, match=r"this needs dask, which is not installed: .*\[tables\]"):
        write_datasets([bag], tmp_path / "out", workers=2)
    assert not write_datasets([bag], tmp_path / "out").failed


def test_memory_file_system_of_this_process_is_refused_with_workers_or_scheduler(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "a.mcap", 1)
    for options in ({"workers": 2}, {"scheduler": "tcp://127.0.0.1:1"}):
        with pytest.raises(BagError, match="memory://own exists only in this process"):
            write_datasets([bag], "memory://own", **options)


def test_processes_are_started_only_for_several_large_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Any] = []
    monkeypatch.setattr(multi_bag, "local_processes", started.append)
    size = multi_bag.PROCESSES_BYTES
    multi_bag.select_runner(None, None, [size, size])
    assert started == [min(os.cpu_count() or 1, 2)]
    for workers, sizes in ((None, [100] * 50), (1, [size] * 9), (None, []), (2, []), (None, [size])):
        with multi_bag.select_runner(None, workers, sizes) as run:
            assert run is multi_bag.one_by_one
    assert len(started) == 1


# ------------------------------------------------------------------------------------------------------------------ S3


class Counted:
    """WSGI application that records method, path, range and size of each request."""

    def __init__(self, application: Any) -> None:
        self._application = application
        self.reads: list[tuple[str, str, str, int]] = []

    def __call__(self, environ: dict[str, Any], start_response: Any) -> Any:
        sizes: list[int] = []

        def start(status: str, headers: list[tuple[str, str]], *rest: Any) -> Any:
            sizes.append(next((int(value) for key, value in headers if key.lower() == "content-length"), 0))
            return start_response(status, headers, *rest)

        response = self._application(environ, start)
        key = environ["REQUEST_METHOD"], environ["PATH_INFO"], environ.get("HTTP_RANGE", "")
        self.reads.append((*key, sizes[0] if sizes else 0))
        return response

    def gets(self, suffix: str | tuple[str, ...]) -> list[tuple[str, str, str, int]]:
        return [one for one in self.reads if one[0] == "GET" and one[1].endswith(suffix)]


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Any, Counted]]:
    """Provide the bucket `fleet` on a local S3 server, and the recorded requests."""
    counted = Counted(DomainDispatcherApplication(create_backend_app))
    server = make_server("127.0.0.1", 0, counted, threaded=True)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    url = f"http://127.0.0.1:{server.server_port}"
    for key, value in {
        "AWS_ENDPOINT_URL": url,
        "AWS_ACCESS_KEY_ID": "nobody",
        "AWS_SECRET_ACCESS_KEY": "nothing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
    }.items():
        monkeypatch.setenv(key, value)
    urlopen(Request(f"{url}/moto-api/reset", method="POST")).close()
    s3fs.S3FileSystem.clear_instance_cache()
    try:
        system = s3fs.S3FileSystem()
        system.mkdir("fleet")
        yield system, counted
    finally:
        s3fs.S3FileSystem.clear_instance_cache()
        server.shutdown()
        thread.join()
        server.server_close()


def test_dataset_on_s3_is_written_and_updated_from_bags_on_s3(bucket: Any, tmp_path: Path) -> None:
    system, counted = bucket
    for name, numbers in {"a": (1, 2), "b": (3,)}.items():
        system.put(str(bag_of(tmp_path / f"{name}.mcap", *numbers)), f"fleet/in/{name}.mcap")
    system.pipe("fleet/in/c.mcap", b"junk" * 50)
    report = write_datasets(["s3://fleet/in/*.mcap"], "s3://fleet/out", workers=1)
    assert said(report) == (["a", "b"], [], ["s3://fleet/in/c.mcap"])
    assert rows("s3://fleet/out") == [("a", 1), ("a", 2), ("b", 3)]
    counted.reads.clear()
    assert said(write_datasets(["s3://fleet/in/[ab].mcap"], "s3://fleet/out")) == ([], ["a", "b"], [])
    assert not counted.gets(".mcap")
    assert len(counted.gets(".parquet")) == 2 and all(one[2] for one in counted.gets(".parquet")), "only metadata"
    assert not [one for one in counted.reads if one[0] in ("PUT", "DELETE")]
    system.put(str(bag_of(tmp_path / "b.mcap", 4)), "fleet/in/b.mcap")
    assert said(write_datasets(["s3://fleet/in/[ab].mcap"], "s3://fleet/out")) == (["b"], ["a"], [])
    system.invalidate_cache()
    assert rows("s3://fleet/out") == [("a", 1), ("a", 2), ("b", 4)]


def test_only_the_needed_ranges_of_a_large_s3_file_are_read(bucket: Any, tmp_path: Path) -> None:
    system, counted = bucket
    path = tmp_path / "large.mcap"
    noise = np.random.default_rng(1)
    with BagWriter(path) as writer:
        for number in range(1000):
            writer.write("/n", Int64(data=number), number)
        for number in range(30):
            writer.write("/noise", Array(data=noise.integers(0, 255, 1 << 20, np.uint8)), 2000 + number)
        writer.write("/n", Int64(data=1000), 3000)
    size = path.stat().st_size
    assert size > 30 << 20
    system.put(str(path), "fleet/large.mcap")
    counted.reads.clear()
    report = write_datasets(["s3://fleet/large.mcap"], tmp_path / "out", topics=["/n"], workers=1)
    assert not report.failed and rows(tmp_path / "out") == [("large", number) for number in range(1001)]
    reads = counted.gets("large.mcap")
    assert len(reads) > 2 and all(one[2].startswith("bytes=") for one in reads)
    assert sum(one[3] for one in reads) < size // 4, "chunks without the topic are left out"
    counted.reads.clear()
    with BagReader("s3://fleet/large.mcap") as bag:
        assert bag.table("/n", end_ns=500).num_rows == 500
    reads = counted.gets("large.mcap")
    assert reads and all(one[2].startswith("bytes=") for one in reads) and sum(one[3] for one in reads) < size // 4
    counted.reads.clear()
    with BagReader("s3://fleet/large.mcap") as bag:
        assert sum(1 for _ in bag.messages("/noise")) == 30
    reads = counted.gets("large.mcap")
    assert len(reads) < 60 and max(one[3] for one in reads) < 4 << 20, "of what is needed, little at a time"
    assert sum(one[3] for one in reads) < size * 1.2
