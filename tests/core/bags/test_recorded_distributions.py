"""Bags without definitions are read with those of the distribution that recorded them, if the bag states it."""

from __future__ import annotations

import os
import sqlite3
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
import yaml
from core.bags.test_definitions import humble_bag
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.bags.storage.mcap_index import recorded_distro
from rosidl_py_gen.base.distributions import Distribution

RANGE = "sensor_msgs/msg/Range"
HUMBLE: Any = get_message(RANGE, distro="humble")
JAZZY: Any = get_message(RANGE)
SAMPLE = HUMBLE(range=2.5).encode()

pytestmark = pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")


def mcap(path: Path, name: str, samples: list[bytes], distro: str = "", at_end: str = "", index: bool = True) -> Path:
    """A file whose schema is empty, as Humble writes it for types whose definition it does not find."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, use_statistics=index, use_summary_offsets=index)
        writer.start("ros2", "libmcap")
        if distro:
            writer.add_metadata("other", {"ROS_DISTRO": "foxy"})
            writer.add_metadata("rosbag2", {"ROS_DISTRO": distro})
        schema = writer.register_schema(name, "", b"")
        channel = writer.register_channel("/reading", "cdr", schema)
        for number, data in enumerate(samples, 1):
            writer.add_message(channel, number, data, number)
        if at_end:
            text = yaml.safe_dump({"version": 9, "ros_distro": at_end})
            writer.add_metadata("rosbag2", {"serialized_metadata": text})
        writer.finish()
    return path


def test_database_recorded_by_humble_is_read_with_definitions_of_humble(tmp_path: Path) -> None:
    bag = humble_bag(tmp_path / "bag", RANGE, [SAMPLE])
    with BagReader(bag) as reader:
        (item,) = reader
        assert type(item.message) is HUMBLE and item.message.range == 2.5
        assert reader.definition("/reading").origin == "bundled (humble)"
        assert not reader.definition("/reading").is_recorded
    with BagReader(bag / "bag_0.db3") as reader:
        assert [type(item.message) for item in reader] == [HUMBLE]


@pytest.mark.parametrize(("distro", "cls"), [("humble", HUMBLE), ("jazzy", JAZZY), ("lyrical", JAZZY), ("foxy", JAZZY)])
def test_distribution_in_metadata_selects_the_definition(tmp_path: Path, distro: str, cls: Any) -> None:
    bag = humble_bag(tmp_path / "bag", RANGE, [cls(range=2.5).encode()])
    with sqlite3.connect(bag / "bag_0.db3") as base:
        base.execute("update schema set ros_distro = 'kilted'")
    base.close()
    file = bag / "metadata.yaml"
    value = yaml.safe_load(file.read_text())
    value["rosbag2_bagfile_information"]["ros_distro"] = distro
    file.write_text(yaml.safe_dump(value))
    with BagReader(bag) as reader:
        assert [type(item.message) for item in reader] == [cls]


@pytest.mark.parametrize("index", [True, False])
def test_distribution_in_mcap_file_selects_the_definition(tmp_path: Path, index: bool) -> None:
    for at_start, at_end in (("humble", ""), ("", "humble")):
        path = mcap(tmp_path / f"{at_start}-bag.mcap", RANGE, [SAMPLE], at_start, at_end)
        if not index:
            if at_end:
                continue  # a file without an index was not ended
            path.write_bytes(path.read_bytes()[:-60])
        with BagReader(path) as reader:
            assert [type(item.message) for item in reader] == [HUMBLE]
    with BagReader(mcap(tmp_path / "none.mcap", RANGE, [JAZZY().encode()])) as reader:
        assert [type(item.message) for item in reader] == [JAZZY]


def test_recorded_distribution_overrides_environment_and_caller_overrides_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = humble_bag(tmp_path / "bag", RANGE, [SAMPLE])
    monkeypatch.setenv("ROS_DISTRO", "lyrical")
    with BagReader(bag) as reader:
        assert reader.definition("/reading").message_class is HUMBLE
    with BagReader(bag, typestore={RANGE: JAZZY}) as reader:
        assert reader.definition("/reading").message_class is JAZZY
    own = tmp_path / "own" / "sensor_msgs" / "msg"
    own.mkdir(parents=True)
    (own / "Range.msg").write_text("int8 mine\n")
    with BagReader(bag, search_path=tmp_path / "own") as reader:
        assert reader.definition("/reading").origin.endswith(os.path.join("sensor_msgs", "msg", "Range.msg"))
    with Distribution.of_command("jazzy"), BagReader(bag) as reader:
        assert reader.definition("/reading").message_class is JAZZY


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_tasks_in_worker_processes_use_the_distribution_selected_by_the_command(tmp_path: Path, workers: int) -> None:
    """The bag states lyrical, so without the selection the sample of Humble would not fit."""
    tables = pytest.importorskip("rosidl_py_gen.tables")
    bags = [humble_bag(tmp_path / f"bag{number}", RANGE, [SAMPLE]) for number in range(2)]
    for bag in bags:
        with sqlite3.connect(bag / "bag_0.db3") as base:
            base.execute("update schema set ros_distro = 'lyrical'")
        base.close()
    with Distribution.of_command("humble"):
        report = tables.write_datasets(bags, tmp_path / "out", workers=workers)
    assert report.failed == {} and [len(files) for files in report.files.values()] == [1, 1]
    assert not report.skipped_topics


def test_types_missing_from_the_recorded_distribution_are_refused_by_name(tmp_path: Path) -> None:
    name = "nav_msgs/msg/Trajectory"
    bag = humble_bag(tmp_path / "bag", name, [b"\0\1\0\0"])
    with BagReader(bag) as reader, pytest.raises(Exception, match="it is part of lyrical only"):
        reader.definition("/reading")


@given(st.binary(max_size=300), st.integers(0, 400))
def test_damaged_metadata_never_raise_when_the_distribution_is_read(noise: bytes, at: int) -> None:
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start("ros2")
    writer.add_metadata("rosbag2", {"ROS_DISTRO": "humble"})
    writer.add_metadata("rosbag2", {"serialized_metadata": "ros_distro: jazzy"})
    writer.finish()
    data = bytearray(stream.getvalue())
    data[at : at + len(noise)] = noise
    assert isinstance(recorded_distro(BytesIO(bytes(data)), len(data)), str)


@pytest.mark.parametrize("text", ["[" * 5000, "ros_distro: [a]", "- a", "&a [*a, *a]", "ros_distro: 5", ""])
def test_malformed_serialized_metadata_leave_the_default_distribution(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2")
        channel = writer.register_channel("/reading", "cdr", writer.register_schema(RANGE, "", b""))
        writer.add_message(channel, 1, JAZZY().encode(), 1)
        writer.add_metadata("rosbag2", {"serialized_metadata": text})
        writer.finish()
    with BagReader(path) as reader:
        assert reader.definition("/reading").message_class is JAZZY
