"""Damaged bags through ``rosidl-py bag table`` and ``bag sql``: right data or our error, and memory is bounded."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from support.table_values import of_message, rows, same

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.errors import RosidlError

pytestmark = pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")  # what is lost is said in them
Image: Any = get_message("sensor_msgs/msg/Image")
Odometry: Any = get_message("nav_msgs/msg/Odometry")
String: Any = get_message("std_msgs/msg/String")
QUERY = 'select epoch_ns(log_time) as log_time, data from "/s" order by log_time'
RIGHT = [{"log_time": number, "data": f"number {number}"} for number in range(8)]
MB = 1 << 20


def fill(writer: Any) -> None:
    with writer:
        for number in range(8):
            writer.write("/s", String(data=f"number {number}"), number)
            odometry = Odometry()
            odometry.pose.pose.position.x = number / 8
            writer.write("/odom", odometry, number)


def flipped(data: bytes, at: int) -> bytes:
    """With one byte wrong: in all bits, or in one."""
    return data[:at] + bytes([data[at] ^ (0xFF if at % 2 else 1 << at // 2 % 8)]) + data[at + 1 :]


def damaged(data: bytes, count: int) -> list[bytes]:
    """With a wrong byte, and cut, each at so many places."""
    step = len(data) // count
    return [*(flipped(data, at) for at in range(0, len(data), step)), *(data[:at] for at in range(1, len(data), step))]


def messages(path: Path, topic: str) -> list[Any] | None:
    """Those that `messages` gives, with their times; None when it refuses the bag."""
    try:
        with BagReader(path) as bag:
            found = list(bag.messages(topic)) if topic in bag.topics else []
    except RosidlError:
        return None
    return [(one.log_time, of_message(one.message)) for one in found]


class Told:
    """Runs both commands on a bag, and looks at what they say."""

    def __init__(self, run_here: Any, folder: Path) -> None:
        self._run, self._out = run_here, folder / "out"

    def run(self, *arguments: str) -> str | None:
        code, out, err = self._run("bag", *arguments)
        assert code in (0, 1), (code, err)
        if code == 0:
            return str(out)
        last = err.splitlines()[-1]
        assert last.startswith("error: ") and len(last) > 20 and "Traceback" not in err, err
        return None

    def table(self, path: Path) -> dict[str, list[Any]] | None:
        """Rows by topic, with their times; nothing is left in the folder when it ends with an error."""
        shutil.rmtree(self._out, ignore_errors=True)
        out = self.run("table", str(path), "--out", str(self._out), "--json")
        files = [file for file in self._out.rglob("*") if file.is_file()]
        if out is None:
            assert files == []
            return None
        found: dict[str, list[Any]] = {}
        for one in json.loads(out)["files"]:
            table = pq.ParquetFile(one["path"]).read()
            times = table.column("log_time").cast("int64").to_pylist()
            found[one["topic"]] = [*zip(times, rows(table), strict=True)]
            assert one["messages"] == len(times)
        return found

    def sql(self, path: Path) -> list[dict[str, Any]] | None:
        """Rows of the query."""
        out = self.run("sql", QUERY, str(path), "-f", "json")
        return None if out is None else [json.loads(line) for line in out.splitlines()]


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_an_mcap_file_with_a_wrong_byte_or_an_end_anywhere_gives_right_rows_or_an_error(
    run_here: Any, tmp_path: Path, compression: str
) -> None:
    path, told = tmp_path / "a.mcap", Told(run_here, tmp_path)
    fill(BagWriter(path, compression=compression))
    data, answers = path.read_bytes(), set()
    other = data.replace(b"number 3", b"number 4")  # which only a checksum tells
    assert (other != data) == (compression == "")
    for wrong in (*damaged(data, 23), other):
        path.write_bytes(wrong)
        tables, asked = told.table(path), told.sql(path)
        if tables is not None:
            strings = [{"log_time": at, **row} for at, row in tables.get("/s", [])]
            positions = [row["pose"]["pose"]["position"]["x"] for _, row in tables.get("/odom", [])]
            assert strings == RIGHT[: len(strings)] and positions == [one / 8 for one in range(len(positions))]
        if asked is not None:
            assert asked == RIGHT[: len(asked)]
        answers.add((tables is None, asked is None))
    assert {(False, False), (True, True)} <= answers


def test_a_database_with_wrong_bytes_gives_what_messages_gives_or_an_error(run_here: Any, tmp_path: Path) -> None:
    """There are no checksums in it."""
    folder, told = tmp_path / "a", Told(run_here, tmp_path)
    fill(BagWriter(tmp_path / "a.mcap"))
    assert run_here("bag", "convert", str(tmp_path / "a.mcap"), str(folder), "--storage", "sqlite3")[0] == 0
    path = next(folder.glob("*.db3"))
    data, answers = path.read_bytes(), set()
    used = [at for at in range(len(data)) if data[at]]
    used = used[:: len(used) // 29]
    for wrong in (*(flipped(data, at) for at in used), *(data[:at] for at in range(1, len(data), len(data) // 7))):
        path.write_bytes(wrong)
        tables, asked = told.table(path), told.sql(path)
        for topic in ("/s", "/odom") if tables is not None else ():
            assert same([*map(list, tables.get(topic, []))], [*map(list, messages(path, topic) or [])]), topic
        if asked is not None:
            assert [(row["log_time"], {"data": row["data"]}) for row in asked] == (messages(path, "/s") or [])
        answers.add((tables is None, asked is None))
    assert {(False, False), (True, True)} <= answers


def test_a_damaged_dataset_gives_rows_or_an_error(run_here: Any, tmp_path: Path) -> None:
    bag, told = tmp_path / "a.mcap", Told(run_here, tmp_path)
    fill(BagWriter(bag))
    assert run_here("bag", "table", str(bag), "-o", str(tmp_path / "set"), "--topics", "/s")[0] == 0
    file = next((tmp_path / "set").rglob("*.parquet"))
    data, answers = file.read_bytes(), set()
    for wrong in damaged(data, 29):
        file.write_bytes(wrong)
        answers.add(told.sql(tmp_path / "set") is None)
    assert answers == {True, False}


def test_messages_that_cannot_be_decoded_are_left_out_of_both_when_that_is_asked(run_here: Any, tmp_path: Path) -> None:
    path, told = tmp_path / "a.mcap", Told(run_here, tmp_path)
    with BagWriter(path) as writer:
        writer.add_topic("/s", String)
        for number in range(8):
            data = String(data=f"number {number}").encode()
            wrong = {2: data[:-1], 5: data[:4] + struct.pack("<I", 1 << 31) + data[8:]}.get(number, data)
            writer.write("/s", wrong, number)
    assert told.table(path) is None and told.sql(path) is None
    kept = [one for one in RIGHT if one["log_time"] not in (2, 5)]
    out = tmp_path / "kept"
    assert run_here("bag", "table", str(path), "-o", str(out), "--skip-damaged")[1].startswith("6 messages of 1 topics")
    table = pq.read_table(next(out.rglob("*.parquet")), columns=["data"], partitioning=None)
    assert table.column("data").to_pylist() == [one["data"] for one in kept]
    code, said, err = run_here("bag", "sql", 'select data from "/s" order by log_time', str(path), "--skip-damaged")
    assert (code, said.split("\n")[:-1]) == (0, [one["data"] for one in kept]) and "skipped /s" in err


MEASURED = """
import atexit, sys
from pathlib import Path
from rosidl_py_gen import ros_cli
status = Path("/proc/self/status")
atexit.register(lambda: print("VmHWM:", status.read_text().partition("VmHWM:")[2].split()[0], file=sys.stderr))
ros_cli.main(sys.argv[1:])
"""


def measured(*arguments: str) -> tuple[int, int, str]:
    """Exit code, the most memory in bytes, and errors of a command in a process of its own."""
    command = [sys.executable, "-c", MEASURED, "bag", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    told, _, last = ended.stderr.rpartition("VmHWM:")
    return ended.returncode, int(last.split()[0]) * 1024, told


def damages(folder: Path) -> dict[str, Path]:
    """A bag with 24 MB of images, and ways to be wrong; each a file of that size, or a small one."""
    whole, wrong = folder / "whole.mcap", {}
    noise = np.random.default_rng(1).integers(0, 255, MB, np.uint8)
    with BagWriter(whole, compression="") as writer:
        for number in range(24):
            writer.write("/s", String(data=f"number {number}"), number)
            writer.write("/image", Image(data=noise), number)
    data = whole.read_bytes()
    for name, changed in {
        "cut": data[: len(data) * 3 // 4],
        "flipped": flipped(data, len(data) // 2),
    }.items():
        (folder / f"{name}.mcap").write_bytes(changed)
        wrong[name] = folder / f"{name}.mcap"
    wrong["counts"], wrong["bomb"] = folder / "counts.mcap", folder / "bomb.mcap"
    with BagWriter(wrong["counts"]) as writer:
        writer.add_topic("/image", Image)
        for number in range(1000):
            writer.write("/image", Image().encode()[:-4] + b"\xff\xff\xff\x7f", number)
    with BagWriter(wrong["bomb"], compression="zstd") as writer:
        for number in range(60):  # some kB, and a chunk each
            writer.write("/image", Image(data=np.zeros(4 * MB, np.uint8)), number)
            writer.write("/s", String(data="x"), number)
    return wrong


def test_damaged_bags_take_no_more_memory_than_whole_ones(tmp_path: Path) -> None:
    wrong = damages(tmp_path)
    whole = tmp_path / "whole.mcap"
    commands = {
        "table": lambda bag: ("table", bag, "--out", str(tmp_path / "out"), "--include-large", "--overwrite"),
        "sql": lambda bag: ("sql", 'select count(*), max(octet_length(data)) from "/image"', bag),
    }
    for name, command in commands.items():  # a query needs a table first
        code, most, err = measured(*command(str(whole)))
        assert code == 0, err
        for kind, path in wrong.items() if name == "table" else [("bomb", wrong["bomb"])]:
            code, used, err = measured(*command(str(path)))
            assert code == (0 if kind in ("cut", "bomb") else 1) and "Traceback" not in err, (name, kind, code, err)
            assert (code == 1) == any(line.startswith("error: ") for line in err.splitlines()), (name, kind, err)
            assert used < most + 64 * MB, (name, kind, used // MB, most // MB)
