"""Commands skip the damaged parts of a recording, report topics and times, and end with exit code 3."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from support.bag_damage import COUNT, String, recording, zeroed_chunk

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from pathlib import Path

    from support.node_fixtures import World

PLACE = "log times from 80 to 119 ns, topics /t0, /t1"
LEFT = COUNT - 40


def test_convert_table_sql_and_reindex_skip_a_damaged_chunk(run_here: Any, tmp_path: Path) -> None:
    path, copy = str(tmp_path / "a.mcap"), str(tmp_path / "copy.mcap")
    zeroed_chunk(tmp_path / "a.mcap", 2)
    code, out, err = run_here("bag", "convert", path, copy, "--json")
    document = json.loads(out)
    assert (code, document["messages"], PLACE in err, err.count("warning")) == (3, LEFT, True, 1)
    (part,) = document["damaged"]
    assert (part["topics"], part["start_ns"], part["end_ns"]) == (["/t0", "/t1"], 80, 119)
    with BagReader(copy) as reader:
        assert sum(1 for _ in reader) == LEFT
    assert run_here("bag", "convert", copy, str(tmp_path / "again.mcap"))[0] == 0

    table = ("bag", "table", path, "--workers", "1", "--out")
    code, _, err = run_here(*table, str(tmp_path / "strict"))
    assert (code, PLACE in err) == (1, True)
    code, out, err = run_here(*table, str(tmp_path / "rows"), "--skip-damaged")
    assert (code, out.startswith(f"{LEFT} messages of 2 topics"), PLACE in err) == (3, True, True)
    query = ("bag", "sql", 'select count(*) as n from "/t0"', path, "--format", "csv")
    assert run_here(*query)[0] == 1
    code, out, err = run_here(*query, "--skip-damaged")
    assert (code, out.splitlines(), PLACE in err) == (3, ["n", str(LEFT // 2)], True)

    code, out, _ = run_here("bag", "reindex", path, "--json")
    assert (code, json.loads(out)["messages"], len(json.loads(out)["damaged"])) == (3, LEFT, 1)
    assert run_here("bag", "convert", path, str(tmp_path / "whole.mcap"))[0] == 0


def test_info_counts_what_is_intact_in_a_file_without_index(run_here: Any, tmp_path: Path) -> None:
    zeroed_chunk(tmp_path / "a.mcap", 2, has_index=False)
    code, out, err = run_here("bag", "info", str(tmp_path / "a.mcap"))
    assert (code, f"Messages:   {LEFT}" in out, "Damaged:    1 parts" in out, PLACE in err) == (0, True, True, True)


def test_info_names_the_storage_of_a_compressed_database(run_here: Any, tmp_path: Path) -> None:
    recording(tmp_path / "a.mcap", 10)
    folder = str(tmp_path / "db")
    assert run_here("bag", "convert", str(tmp_path / "a.mcap"), folder, "--storage", "sqlite3")[0] == 0
    import zstandard

    (file,) = (tmp_path / "db").glob("*.db3")
    packed = file.with_name(file.name + ".zstd")
    packed.write_bytes(zstandard.compress(file.read_bytes()))
    assert json.loads(run_here("bag", "info", str(packed), "--json")[1])["storage"] == "sqlite3"


async def test_play_publishes_what_is_intact(memory: World, tool: Any, tmp_path: Path) -> None:
    zeroed_chunk(tmp_path / "a.mcap", 2)
    node = memory.node("robot", enable_rosout=False, parameter_events=False)
    heard: list[str] = []
    node.create_subscription(String, "t0", lambda message: heard.append(message.data), qos=QoSProfile(depth=1000))
    ended = await tool("bag", "play", str(tmp_path / "a.mcap"))
    assert (ended.code, PLACE in ended.err, len(heard)) == (3, True, LEFT // 2)
