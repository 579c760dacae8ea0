"""A bag that rules write and rules damage, against a model of what readers may and must return.

- Readers, `bag info`, `bag reindex` and `bag convert` raise our errors only, in bounded time and memory.
- A message is returned as it was written, or not at all. Exempt is what has no checksum: SQLite files, and a chunk of
  a killed recorder, or one that seems to be unfinished because bytes before its end were deleted.
- With `skip_damaged`, all messages of the chunks before the first change of a file are returned.
- Without damage, all messages are returned in order. If the recorder was killed, all that were flushed.
"""

from __future__ import annotations

import contextlib
import io
import random
import shutil
import sqlite3
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

from hypothesis import event, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from mcap.records import Chunk
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk
from support.bag_damage import chunks
from support.bag_samples import STORAGES, STRING, String, memory_limit
from support.example_counts import examples

from rosidl_py_gen import ros_cli
from rosidl_py_gen.bags import BagReader, BagTopic, BagWarning
from rosidl_py_gen.bags.rewriting import reindex
from rosidl_py_gen.errors import RosidlError

MAX_BYTES = 100 << 20
MAX_CPU_S = 5.0
"""Limits for reading or copying a bag of at most 40 kB."""
PLACES = st.floats(0, 1, exclude_max=True)
MESSAGES = st.lists(st.tuples(st.sampled_from(["/a", "/b"]), st.sampled_from([8, 40, 900])), min_size=1, max_size=6)
FORMS = [
    {"storage": "mcap", "compression": ""},
    {"storage": "mcap", "compression": "zstd"},
    {"storage": "mcap", "compression": "lz4"},
    {"storage": "mcap", "compression": "", "compression_mode": "message"},
    {"storage": "mcap", "compression": "", "compression_mode": "file"},
    {"storage": "sqlite3"},
    {"storage": "sqlite3", "compression_mode": "message"},
    {"storage": "sqlite3", "compression_mode": "file"},
]

Place = tuple[int, int]
"""The byte at which the chunk of a message ends, and the log time of the message."""


def places_in_mcap(data: bytes) -> list[Place]:
    """Return the messages in the complete chunks of a file."""
    places = []
    for begin, end in chunks(data):
        if end <= len(data):
            chunk = next(StreamReader(io.BytesIO(data[begin:end]), skip_magic=True, emit_chunks=True).records)
            assert isinstance(chunk, Chunk)
            places += [(end, one.log_time) for one in breakup_chunk(chunk) if isinstance(one, McapMessage)]
    return places


def places_in_database(path: Path) -> list[Place]:
    """Return the messages of a database, which all end with the file."""
    with tempfile.TemporaryDirectory() as folder:
        for file in path.parent.glob(f"{path.name}*"):  # with its journal
            shutil.copy(file, folder)
        with contextlib.closing(sqlite3.connect(Path(folder, path.name))) as base:
            return [(path.stat().st_size, at) for (at,) in base.execute("select timestamp from messages")]


def first_difference(one: bytes, other: bytes) -> int | None:
    """Return the position of the first byte that differs; None if all are equal."""
    if one == other:
        return None
    return next(
        (at for at, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1]), min(len(one), len(other))
    )


class DamagedBag(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.home = Path(tempfile.mkdtemp(prefix="damaged-"))
        self.written: dict[int, tuple[str, bytes]] = {}
        self.flushed: set[int] = set()
        self.whole: dict[str, bytes] = {}
        """Contents of each file before any damage, by its present name."""
        self.places: dict[str, list[Place]] = {}

    def teardown(self) -> None:
        shutil.rmtree(self.home)

    # --- writing ------------------------------------------------------------------------------------------------------

    @initialize(
        form=st.sampled_from(FORMS),
        split_bytes=st.sampled_from([None, 1000]),
        is_file=st.booleans(),
        steps=st.lists(st.tuples(MESSAGES, st.sampled_from(["", "flush", "split"])), min_size=1, max_size=5),
        is_killed=st.booleans(),
    )
    def write(
        self,
        form: dict[str, Any],
        split_bytes: int | None,
        is_file: bool,
        steps: list[tuple[list[tuple[str, int]], str]],
        is_killed: bool,
    ) -> None:
        self.form = form
        self.is_folder = not is_file or form["storage"] != "mcap" or "compression_mode" in form
        self.path = self.home / ("bag" if self.is_folder else "bag.mcap")
        options = {name: value for name, value in form.items() if name != "storage"}
        if self.is_folder:
            options["split_bytes"] = split_bytes
        with STORAGES[form["storage"]](self.path, **options) as writer:
            for topic in ("/a", "/b"):
                writer.add_topic(topic, BagTopic(topic, *STRING))
            for messages, end in steps:
                for topic, size in messages:
                    number = len(self.written)
                    text = random.Random(number).randbytes(size).hex()
                    self.written[number] = topic, String(data=text).encode()
                    writer.write(topic, self.written[number][1], number)
                if end == "flush":
                    writer.flush()
                elif end == "split" and self.is_folder:
                    writer.split()
                if end == "flush" or (end == "split" and self.is_folder):
                    self.flushed = {*self.written}
            if is_killed:
                aside = self.home / "killed"
                (shutil.copytree if self.is_folder else shutil.copy)(self.path, aside)
        if is_killed:
            if self.is_folder:
                shutil.rmtree(self.path)
            shutil.move(aside, self.path)
        else:
            self.flushed = {*self.written}
        for file in self.files:
            self.whole[file.name] = file.read_bytes()
            if file.name.endswith(".mcap"):
                self.places[file.name] = places_in_mcap(self.whole[file.name])
            else:
                self.places[file.name] = places_in_database(file) if file.name.endswith(".db3") else []
        event(f"{form['storage']} {'killed' if is_killed else 'closed'}")
        for skip_damaged in (False, True):
            times = self.read(self.path, skip_damaged=skip_damaged)
            assert times is not None and self.flushed <= {*times}

    @property
    def files(self) -> list[Path]:
        if not self.is_folder:
            return [self.path]
        return sorted(one for one in self.path.iterdir() if one.suffix in (".mcap", ".db3", ".zstd"))

    # --- damage -------------------------------------------------------------------------------------------------------

    @rule(number=st.integers(0, 99), start=PLACES, change=st.sampled_from(["cut", "bit", "byte", "number"]), by=PLACES)
    def change_bytes(self, number: int, start: float, change: str, by: float) -> None:
        data, file = self.bytes_of(number)
        at = int(start * len(data))
        value = int(by * 256)
        if change == "cut":
            del data[at:]
        elif at < len(data):
            if change == "bit":
                data[at] ^= 1 << value % 8
            elif change == "byte":
                data[at] = value
            else:
                numbers = [0, 1, 2**31, 2**63, 2**64 - 1, len(data)]
                data[at : at + 8] = numbers[value % len(numbers)].to_bytes(8, "little")
        file.write_bytes(data)

    @rule(
        number=st.integers(0, 99),
        start=PLACES,
        size=st.sampled_from([2, 8, 60, 1000, 4096]),
        change=st.sampled_from(["zeros", "random", "delete", "repeat", "insert", "copy", "zeros to the end"]),
        by=PLACES,
    )
    def change_range(self, number: int, start: float, size: int, change: str, by: float) -> None:
        data, file = self.bytes_of(number)
        at, other = int(start * len(data)), int(by * len(data))
        end = len(data) if change == "zeros to the end" else min(at + size, len(data))
        noise = random.Random(int(by * 1000)).randbytes(end - at)
        match change:
            case "zeros" | "zeros to the end":
                data[at:end] = bytes(end - at)
            case "random":
                data[at:end] = noise
            case "delete":
                del data[at:end]
            case "repeat":
                data[at:at] = data[at:end]
            case "insert":
                data[at:at] = noise
            case _:
                data[at:end] = data[other : other + size]
        file.write_bytes(data)

    @precondition(lambda self: self.is_folder and len(self.files) > 1)
    @rule(number=st.integers(0, 99))
    def remove_file(self, number: int) -> None:
        file = self.files[number % len(self.files)]
        file.unlink()
        for rows in (self.whole, self.places):
            del rows[file.name]

    @precondition(lambda self: self.is_folder and len(self.files) > 1)
    @rule(number=st.integers(0, 99))
    def swap_files(self, number: int) -> None:
        files = self.files
        one, other = files[number % len(files)], files[(number + 1) % len(files)]
        has_journal = any("-" in file.name for file in self.path.iterdir())  # of a killed recorder
        if one.suffix == other.suffix and not has_journal:  # the last one may not be compressed
            data, others = one.read_bytes(), other.read_bytes()
            one.write_bytes(others)
            other.write_bytes(data)
            for rows in (self.whole, self.places):
                rows[one.name], rows[other.name] = rows[other.name], rows[one.name]  # type: ignore[attr-defined]

    @precondition(lambda self: (self.path / "metadata.yaml").exists())
    @rule()
    def remove_metadata(self) -> None:
        (self.path / "metadata.yaml").unlink()

    def bytes_of(self, number: int) -> tuple[bytearray, Path]:
        file = self.files[number % len(self.files)]
        return bytearray(file.read_bytes()), file

    # --- reading ------------------------------------------------------------------------------------------------------

    @rule(skip_damaged=st.booleans())
    def read_bag(self, skip_damaged: bool) -> None:
        times = self.read(self.path, skip_damaged=skip_damaged)
        required, may_fail = self.required(self.path)
        if times is None:
            assert may_fail or not skip_damaged
        elif skip_damaged:
            assert may_fail or required <= {*times}, (required - {*times}, times)

    @precondition(lambda self: self.is_folder)
    @rule()
    def read_each_file(self) -> None:
        for file in self.files:
            times = self.read(file, skip_damaged=True)
            required, may_fail = self.required(file)
            assert may_fail or (times is not None and required <= {*times}), (file, required, times)

    @rule()
    def print_info(self) -> None:
        code = self.command("info", str(self.path))
        assert code in (0, 1)

    @precondition(lambda self: self.is_folder)
    @rule()
    def reindex(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, "bag")
            shutil.copytree(self.path, copy)
            required, may_fail = self.required(None)
            try:
                with self.limits():
                    done = reindex(copy)
            except RosidlError:
                assert may_fail
                return
            times = self.read(copy, skip_damaged=False)
            assert times is not None and len(times) == done.messages
            assert may_fail or required <= {*times}

    @rule(storage=st.sampled_from([*STORAGES]))
    def convert(self, storage: str) -> None:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, "copy")
            code = self.command("convert", str(self.path), str(copy), "--storage", storage)
            assert code in (0, 1, ros_cli.DAMAGED)
            assert copy.exists() == (code != 1)
            if code != 1:
                assert self.read(copy, skip_damaged=False) == self.read(self.path, skip_damaged=True)

    # --- the model ----------------------------------------------------------------------------------------------------

    def required(self, path: Path | None) -> tuple[set[int], bool]:
        """Return the messages that are returned with `skip_damaged`, and True if the file or bag may be refused.

        None stands for all files of the folder, whether or not metadata lists them.
        """
        files = self.files if path in (None, self.path) else [path]
        required, may_fail = set[int](), False
        metadata = self.path / "metadata.yaml"
        if path == self.path and metadata.exists():
            may_fail = any(not (self.path / name).exists() for name in self.listed(metadata))
        for file in files:
            assert file is not None
            at = first_difference(self.whole[file.name], file.read_bytes())
            required |= {one for end, one in self.places[file.name] if at is None or end <= at}
            may_fail |= at is not None and (at < 8 or file.suffix != ".mcap")
        return required, may_fail

    @staticmethod
    def listed(metadata: Path) -> list[str]:
        words = metadata.read_text().split()
        return [word for word in words if word.startswith("bag_")]

    def read(self, path: Path, *, skip_damaged: bool) -> list[int] | None:
        """Return the log times of the messages of a bag, which are checked; None if it is refused."""
        try:
            with self.limits(), BagReader(path, skip_damaged=skip_damaged) as reader:
                found = [(one.log_time, one.topic, one.message) for one in reader.messages(raw=True)]
        except RosidlError as error:
            assert str(error)
            return None
        times = [at for at, _, _ in found]
        assert times == sorted(times)
        if not any(self.is_unchecked(file) for file in self.files):
            assert len({*times}) == len(times), "a message was returned twice"
            for at, topic, data in found:
                assert self.written[at] == (topic, bytes(data)), at
        return times

    def is_unchecked(self, file: Path) -> bool:
        """Return True for a changed file of SQLite, and for one with a chunk that ends behind the file."""
        data = file.read_bytes()
        if self.whole.get(file.name) == data:
            return False
        return self.form["storage"] == "sqlite3" or any(end > len(data) for _, end in chunks(data))

    def command(self, *words: str) -> int:
        """Run a command of ``rosidl-py bag`` and return its exit code."""
        out, errors = io.StringIO(), io.StringIO()
        with self.limits(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            try:
                ros_cli.main(["bag", *words])
                code = 0
            except SystemExit as end:
                code = int(end.code or 0)
        assert "Traceback" not in errors.getvalue()
        assert (code == 1) == errors.getvalue().startswith("error: "), errors.getvalue()
        return code

    @contextlib.contextmanager
    def limits(self) -> Any:
        """Limit time and memory, and fail for every warning that is not a `BagWarning`."""
        began = time.process_time()
        with warnings.catch_warnings(), memory_limit(MAX_BYTES):
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", BagWarning)
            yield
        assert time.process_time() - began < MAX_CPU_S


TestDamagedBag = DamagedBag.TestCase
TestDamagedBag.settings = settings(max_examples=examples(60), stateful_step_count=10, deadline=None)
