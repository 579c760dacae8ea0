"""The layouts of rosbag2's databases and metadata, Foxy to Kilted."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest
import yaml

from rosidl_py_gen import get_message, type_hash
from rosidl_py_gen.bags import BagReader

String: Any = get_message("std_msgs/msg/String")
QOS = "- history: 1\n  depth: 7\n  reliability: 1\n  durability: 2\n"
MESSAGES = "create table messages(id integer primary key, topic_id integer, timestamp integer, data blob)"
# Columns that each release added to its tables.
TOPICS = {
    "dashing": "",
    "foxy": ", offered_qos_profiles text",
    "humble": ", offered_qos_profiles text",
    "jazzy": ", offered_qos_profiles text, type_description_hash text",
}


def database(path: Path, release: str) -> None:
    base = sqlite3.connect(path)
    base.execute(MESSAGES)
    base.execute(
        f"create table topics(id integer primary key, name text, type text, serialization_format text{TOPICS[release]})"
    )
    row = [1, "/s", "std_msgs/msg/String", "cdr", QOS, type_hash(String)][: 4 + TOPICS[release].count(",")]
    base.execute(f"insert into topics values ({','.join('?' * len(row))})", row)
    if release in ("humble", "jazzy"):
        base.execute("create table schema(schema_version integer primary key, ros_distro text)")
        base.execute("create table metadata(id integer primary key, metadata_version integer, metadata text)")
    if release == "jazzy":
        base.execute(
            "create table message_definitions(id integer primary key, topic_type text, encoding text, "
            "encoded_message_definition text, type_description_hash text)"
        )
        told = (1, "std_msgs/msg/String", "ros2msg", "string data", type_hash(String))
        base.execute("insert into message_definitions values (?, ?, ?, ?, ?)", told)
    for number in range(3):
        base.execute("insert into messages values (?, 1, ?, ?)", (number, number, String(data=str(number)).encode()))
    base.commit()
    base.close()


def metadata(version: int, name: str) -> dict[str, Any]:
    topic: dict[str, Any] = {"name": "/s", "type": "std_msgs/msg/String", "serialization_format": "cdr"}
    told: dict[str, Any] = {
        "version": version,
        "storage_identifier": "sqlite3",
        "relative_file_paths": [f"bag/{name}" if version < 4 else name],
        "duration": {"nanoseconds": 2},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 3,
        "topics_with_message_count": [{"topic_metadata": topic, "message_count": 3}],
    }
    if version >= 2:
        topic["offered_qos_profiles"] = QOS if version < 9 else yaml.safe_load(QOS)
    if version >= 3:
        told |= {"compression_format": "", "compression_mode": ""}
    if version >= 5:
        told["files"] = [{"path": name, "message_count": 3}]
    if version >= 6:
        told["custom_data"] = None
    if version >= 7:
        topic["type_description_hash"] = type_hash(String)
    if version >= 8:
        told["ros_distro"] = "jazzy"
    return {"rosbag2_bagfile_information": told}


@pytest.mark.filterwarnings("ignore:.*contains neither definition nor hash:rosidl_py_gen.bags.BagWarning")
@pytest.mark.parametrize("version", range(1, 10))
@pytest.mark.parametrize("release", TOPICS)
def test_databases_and_metadata_of_all_rosbag2_releases_are_read(tmp_path: Path, release: str, version: int) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    database(folder / "bag_0.db3", release)
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata(version, "bag_0.db3")))
    for path in (folder, folder / "bag_0.db3"):
        with BagReader(path) as reader:
            assert [(item.log_time, item.message.data) for item in reader] == [(0, "0"), (1, "1"), (2, "2")]
            assert reader.topics["/s"].count == 3 and not reader.skipped
            assert bool(reader.topics["/s"].definition) == (release == "jazzy")
