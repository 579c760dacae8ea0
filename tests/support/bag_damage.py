"""Damage recordings, and check that readers return the intact messages or raise one of our errors.

The tests run a few hundred cases; all of them, with figures: ``python tests/support/bag_damage.py blocks`` and
``python tests/support/bag_damage.py kills --count 100``. Random damage: `tests/slow/bags/test_damage_machine.py`.
"""

from __future__ import annotations

import argparse
import json
import random
import struct
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.bags.rewriting import reindex
from rosidl_py_gen.errors import RosidlError

String: Any = get_message("std_msgs/msg/String")
BLOCK = 4096
COUNT = 200
"""Messages of a file with a damaged chunk, in five chunks."""
MODES: dict[str, dict[str, Any]] = {
    "none": {"compression": ""},
    "zstd": {"compression": "zstd"},
    "lz4": {"compression": "lz4"},
    "file": {"compression": "", "compression_mode": "file"},
    "message": {"compression": "", "compression_mode": "message"},
}


def text(number: int) -> str:
    """Return the text of a message, from which damage is recognized."""
    return random.Random(number).randbytes(40).hex() + str(number)


def recording(path: Path, count: int, compression: str = "zstd", chunk: int = 40) -> bytes:
    """Write a file of chunks with `count` messages of two topics."""
    with BagWriter(path, compression=compression) as writer:
        for number in range(count):
            writer.write(f"/t{number % 2}", String(data=text(number)), number)
            if number % chunk == chunk - 1:
                writer.flush()
    return path.read_bytes()


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Return begin and end of each chunk record."""
    at, places = 8, []
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 6:
            places.append((at, at + 9 + length))
        at += 9 + length
    return places


def zeroed_chunk(path: Path, number: int, *, has_index: bool = True, compression: str = "zstd") -> tuple[int, int]:
    """Write a file with a chunk whose content is zeros; return begin and end of the chunk."""
    data = bytearray(recording(path, COUNT, compression))
    begin, end = chunks(bytes(data))[number]
    data[begin + 100 : end] = bytes(end - begin - 100)
    path.write_bytes(data if has_index else data[:-60])
    return begin, end


def found(path: Path, count: int, *, skip_damaged: bool) -> tuple[int, int] | None:
    """Return the numbers of messages, which are checked, and of parts reported as lost; None if the file is refused."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with BagReader(path, skip_damaged=skip_damaged) as reader:
                messages = list(reader)
                damaged = len(reader.damaged) + (reader.unread_bytes > 0)
        except RosidlError as error:
            assert str(error)
            return None
    times = [one.log_time for one in messages]
    assert times == sorted(set(times)), "out of order, or twice"
    for one in messages:
        assert (one.topic, one.message.data) == (f"/t{one.log_time % 2}", text(one.log_time)), one.log_time
    assert len(times) <= count
    return len(times), damaged


def blocks(folder: Path, compression: str, count: int, step: int = BLOCK) -> dict[str, int]:
    """Cut a file, cut it and append zeros, and zero a block, at every block; with its index and without."""
    whole = recording(folder / f"{compression or 'none'}.mcap", count, compression)
    figures, path = Counter[str](), folder / "damaged.mcap"
    places = chunks(whole)
    for kind, data in (("closed", whole), ("killed", whole[: -len(whole) // 50])):
        path.write_bytes(data)
        before = found(path, count, skip_damaged=False)
        assert before is not None
        at_end, known_parts = count - before[0], before[1]  # of the chunk that was not finished
        for at in range(0, len(data), step):
            rest = len(data) - at
            for name, made in (
                ("cut", data[:at]),
                ("zeros to the end", data[:at] + bytes(rest)),
                ("a block of zeros", data[:at] + bytes(min(BLOCK, rest)) + data[at + BLOCK :]),
            ):
                path.write_bytes(made)
                strict, skipping = found(path, count, skip_damaged=False), found(path, count, skip_damaged=True)
                figures[f"{kind}, {name}: cases"] += 1
                figures[f"{kind}, {name}: read strictly"] += strict is not None
                figures[f"{kind}, {name}: read with skip_damaged"] += skipping is not None
                lost = count - skipping[0] if skipping else 0
                if name != "a block of zeros" and at >= 8:  # every chunk that is whole is read
                    whole_chunks = sum(end <= at for _, end in places)
                    assert strict and skipping and min(strict[0], skipping[0]) >= 40 * whole_chunks, (kind, name, at)
                figures[f"{kind}, {name}: messages lost, at most"] = max(
                    lost, figures[f"{kind}, {name}: messages lost, at most"]
                )
                known = known_parts if name == "a block of zeros" else 0
                is_silent = bool(skipping and lost > at_end and skipping[1] <= known)
                figures[f"{kind}, {name}: lost without a report"] += is_silent and name != "cut"
    return dict(figures)


def write_until_killed(folder: str, mode: str) -> None:
    """Record in this process, and print which messages are in files that were flushed."""
    with BagWriter(folder, split_bytes=300_000, **MODES[mode]) as writer:
        for number in range(100_000):
            writer.write(f"/t{number % 2}", String(data=text(number)), number)
            if number % 100 == 99:
                writer.flush()
                print(number + 1, flush=True)


def kills(folder: Path, mode: str, count: int, seed: int = 1) -> dict[str, int]:
    """Kill recorders; every message that was flushed has to be read, once, also after `reindex`."""
    dice, figures = random.Random(seed), Counter[str]()
    for number in range(count):
        path = folder / f"{mode}{number}"
        command = [sys.executable, __file__, "write", str(path), "--mode", mode]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            flushed = int(process.stdout.readline())
            time.sleep(dice.random() * 0.6)
            process.kill()
            flushed = int(([str(flushed), *process.stdout.read().split("\n")[:-1]])[-1])
        answer = found(path, 100_000, skip_damaged=False)
        assert answer is not None and answer[0] >= flushed, (path, answer, flushed)
        names = sorted(one.name for one in path.iterdir())
        figures["killed while compressing"] += any(one.startswith(".") and one.endswith(".zstd") for one in names)
        figures["plain file and its compressed form"] += any(f"{one}.zstd" in names for one in names)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            done = reindex(path)
        again = found(path, 100_000, skip_damaged=False)
        assert again is not None and again[0] == answer[0] == done.messages, (path, again, answer, done)
        figures["killed"] += 1
        figures["messages flushed"] += flushed
        figures["messages read"] += answer[0]
    return dict(figures)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["blocks", "kills", "write"])
    parser.add_argument("path", nargs="?")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--mode", default="none")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.what == "write":
        write_until_killed(given.path, given.mode)
        return
    with TemporaryDirectory(prefix="damage-") as folder:
        for name, figures in _cases(given, Path(folder)):
            print(name, json.dumps(figures, indent=1), flush=True)


def _cases(given: argparse.Namespace, folder: Path) -> Iterator[tuple[str, dict[str, int]]]:
    if given.what == "blocks":
        for compression in ("", "zstd", "lz4"):
            yield compression or "none", blocks(folder, compression, 8000)
    else:
        for mode in MODES:
            yield mode, kills(folder, mode, given.count, given.seed)


if __name__ == "__main__":
    main()
