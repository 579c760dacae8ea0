"""``rosidl-py bag migrate``, its files of rules, and files of ``--qos-profile-overrides-path``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.changed_definitions import changed_worlds
from support.example_counts import examples
from support.inner_state import type_fields
from support.interface_packages import write

from rosidl_py_gen import compile_definition, get_message, to_dict, type_hash
from rosidl_py_gen.bags import BagReader, BagTopic, BagWriter, RawMessage
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.errors import DefinitionError, EncodeError
from rosidl_py_gen.ros_cli.bag.migration import MigrationError, MigrationRules, fields_of, message_converter, plan
from rosidl_py_gen.ros_cli.bag.player_recorder import parse_qos_overrides, read_qos_overrides
from rosidl_py_gen.ros_cli.bag.yaml_files import parse_rules
from rosidl_py_gen.runtime import Durability, History, Liveliness, QoSProfile, Reliability
from rosidl_py_gen.runtime.qos import INFINITE_NS

if TYPE_CHECKING:
    from collections.abc import Callable

    Run = Callable[..., tuple[int, str, str]]


NAME = "robot_msgs/msg/Wheel"
OLD_TEXT = (
    "float64 speed\nstring name\nint32 turns\nint8[] debug\nPoint[] track\n"
    + "=" * 80
    + "\nMSG: robot_msgs/Point\nint16 x\nint16 y\n"
)
NEW_FILES = {
    "robot_msgs/msg/Wheel.msg": "# A wheel.\nuint8 MAX=3\nstring label\nfloat32 speed\nint64 turns\n"
    "float32 slip 0.5\nPoint[] track\n",
    "robot_msgs/msg/Point.msg": "int32 x\nint8 z 7\n",
}
RULES = "fields:\n  robot_msgs/Wheel: {name: label, debug: null}\n"
String: Any = get_message("std_msgs/msg/String")


@pytest.fixture
def bag(tmp_path: Path) -> str:
    """Three messages of a wheel, and one of a type that does not change."""
    cls = compile_definition(NAME, OLD_TEXT)
    point = type_fields(cls)[-1].cls
    with BagWriter(tmp_path / "drive") as writer:
        writer.add_topic("/wheel", cls, qos=[QoSProfile().transient_local()])
        for number in range(3):
            track = [point(x=number, y=5)] * number
            wheel = cls(speed=number / 4, name=f"w{number}", turns=number, debug=[1], track=track)
            writer.write("/wheel", wheel, log_time_ns=number, publish_time_ns=10 + number)
        writer.write("/words", String(data="a"), log_time_ns=9)
    return str(tmp_path / "drive")


@pytest.fixture
def now(tmp_path: Path) -> str:
    return str(write(tmp_path / "now", NEW_FILES))


def rules(tmp_path: Path, text: str = RULES) -> str:
    (tmp_path / "rules.yaml").write_text(text)
    return str(tmp_path / "rules.yaml")


@pytest.fixture
def migrate(run_here: Run, tmp_path: Path) -> Run:
    """Migrate a bag into ``out.mcap``; definitions are texts, which are written to a folder, or a folder."""

    def run(bag: object, definitions: str | dict[str, str], *options: str) -> tuple[int, str, str]:
        folder = definitions if isinstance(definitions, str) else str(write(tmp_path / "now", definitions))
        return run_here("bag", "migrate", str(bag), "--path", folder, "-o", str(tmp_path / "out.mcap"), *options)

    return run


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out.mcap"


def test_migrate_copies_fields_by_name_and_rule(migrate: Run, bag: str, now: str, out: Path, tmp_path: Path) -> None:
    code, printed, err = migrate(bag, now, "--rules", rules(tmp_path))
    assert (code, err) == (0, "")
    assert printed.splitlines() == [
        "robot_msgs/msg/Wheel, in /wheel",
        "    speed: float64 -> float32",
        "    name -> label",
        "    turns: int32 -> int64",
        "    - debug: dropped by a rule",
        "    + slip: its default, 0.5",
        "robot_msgs/msg/Point, in /wheel",
        "    x: int16 -> int32",
        "    - y: dropped",
        "    + z: its default, 7",
        "/words [std_msgs/msg/String] is copied: not defined in --path",
        f"4 messages of 2 topics in {out}, 3 converted",
    ]
    with BagReader(out) as reader, BagReader(bag) as old:
        topic = reader.topics["/wheel"]
        assert topic.definition.startswith("# A wheel.\nuint8 MAX=3\n")  # as it is in the file
        assert topic.type_hash == type_hash(get_message(NAME, path=now))
        assert topic.offered_qos == old.topics["/wheel"].offered_qos
        items = [*reader.messages("/wheel")]
        assert [(one.log_time, one.publish_time) for one in items] == [(0, 10), (1, 11), (2, 12)]
        last = items[-1].message
        assert (last.speed, last.label, last.turns, last.slip) == (0.5, "w2", 2, 0.5)
        assert [(one.x, one.z) for one in last.track] == [(2, 7), (2, 7)]
        (same,) = reader.raw_messages("/words")
        (before,) = old.raw_messages("/words")
        assert same.data == before.data and same.channel.definition == before.channel.definition


def test_dry_run_writes_no_files_and_json_lists_changes(run_here: Run, bag: str, now: str, tmp_path: Path) -> None:
    arguments = ("bag", "migrate", bag, "--path", now, "--rules", rules(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    code, printed, _ = run_here(*arguments, "--dry-run", "--json")
    assert code == 0 and sorted(tmp_path.rglob("*")) == before
    document = json.loads(printed)
    wheel, words = document["topics"]
    assert (document["messages"], wheel["count"], words["note"]) == (None, 3, "not defined in --path")
    assert wheel["carried_over"] and not words["carried_over"]
    assert wheel["changes"][0] == {
        "old_type": NAME,
        "type": NAME,
        "renamed": {"name": "label"},
        "converted": {"speed": ["float64", "float32"], "turns": ["int32", "int64"]},
        "dropped": ["debug"],
        "defaulted": ["slip"],
    }
    code, _, err = run_here(*arguments)
    assert code == 2 and "--output or --dry-run" in err


def test_renamed_type_is_migrated_with_rule_and_copied_without(
    migrate: Run, bag: str, out: Path, tmp_path: Path
) -> None:
    text = "types:\n  robot_msgs/Wheel: new_msgs/WheelState\n  robot_msgs/Point: new_msgs/Spot\n"
    files = {"new_msgs/msg/WheelState.msg": "string name\nSpot[] track\n", "new_msgs/msg/Spot.msg": "int8 x\n"}
    code, printed, err = migrate(bag, files, "--rules", rules(tmp_path, text))
    assert code == 0 and "robot_msgs/msg/Wheel -> new_msgs/msg/WheelState, in /wheel" in printed, err
    with BagReader(out) as reader:
        assert reader.topics["/wheel"].type_name == "new_msgs/msg/WheelState"
        assert [one.message.name for one in reader.messages("/wheel")] == ["w0", "w1", "w2"]
    out.unlink()
    code, printed, _ = migrate(bag, str(tmp_path / "now"))
    assert code == 0 and f"/wheel [{NAME}] is copied: not among the new definitions" in printed
    text = text.replace("WheelState", "Whel")
    code, _, err = migrate(bag, str(tmp_path / "now"), "--rules", rules(tmp_path, text))
    assert code == 1 and "rules.yaml:2:21: new_msgs/msg/Whel is not among the new definitions" in err


def test_migrate_reports_all_incompatible_fields_before_writing(migrate: Run, bag: str, out: Path) -> None:
    code, _, err = migrate(bag, {"robot_msgs/msg/Wheel.msg": "int32 speed\nint8 name\nint8[] track\n"})
    assert code == 1 and not out.exists()
    for reason in ("speed: float64 cannot become int32", "name: string cannot", "track: robot_msgs/msg/Point[] cannot"):
        assert reason in err


VALUES = [
    ("int64 a", "int8 a", {"a": 200}, "a"),
    ("int64 a", "float64 a", {"a": 2**53 + 1}, "a: 9007199254740993 cannot be represented exactly as float64"),
    ("int32 a", "float32 a", {"a": 2**24 + 1}, "a: 16777217 cannot be represented exactly as float32"),
    ("float64 a", "float32 a", {"a": 1e300}, "a"),
    ("string a", "string<=2 a", {"a": "abc"}, "a"),
    ("int8[] a", "int8[2] a", {"a": [1]}, "a"),
    ("int8[] a", "int8[<=2] a", {"a": [1, 2, 3]}, "a"),
    ("int64[] a", "uint8[] a", {"a": [1, -1]}, "a: expected 0 to 255, found -1 to 1"),
    ("int64[] a", "float32[] a", {"a": [2**62 + 1]}, "a: has values that float32 cannot represent"),
    ("uint64[] a", "float64[] a", {"a": [2**64 - 1]}, "a: has values that float64 cannot represent"),
    ("float64[] a", "float32[] a", {"a": [1e300]}, "a: has values that float32 cannot represent"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "value", "reason"), VALUES)
def test_unrepresentable_value_is_reported_with_message_and_leaves_no_output(
    migrate: Run, out: Path, tmp_path: Path, old: str, new: str, value: dict[str, Any], reason: str
) -> None:
    path = tmp_path / "old.mcap"
    with BagWriter(path) as writer:
        writer.write("/a", compile_definition("val_msgs/msg/A", old)(), log_time_ns=1)
        writer.write("/a", compile_definition("val_msgs/msg/A", old)(**value), log_time_ns=2)
    code, _, err = migrate(path, {"val_msgs/msg/A.msg": new})
    fixed = "[2]" in new  # the empty sequence of the first message does not fit either
    assert code == 1 and f"error: {path}: /a at {1 if fixed else 2} ns: val_msgs/msg/A.{reason}" in err, err
    assert not out.exists()


CARRIED = [
    ("int8[] a", "int64[] a", [1, -2], [1, -2]),
    ("bool[] a", "float32[] a", [True, False], [1.0, 0.0]),
    ("bool a", "uint8 a", True, 1),
    ("int64[] a", "float64[] a", [2**53, -5], [2.0**53, -5.0]),
    ("float64[] a", "float32[] a", [0.1, float("inf"), float("nan")], [np.float32(0.1), np.inf, np.nan]),
    ("int8[3] a", "int16[] a", [1, 2, 3], [1, 2, 3]),
    ("int8[] a", "int8[<=3] a", [1, 2, 3], [1, 2, 3]),
    ("string[] a", "wstring[] a", ["é", ""], ["é", ""]),
    ("float32 a", "float64 a", 0.5, 0.5),
    ("byte[] a", "int8[] a", [5], [5]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "value", "expected"), CARRIED)
def test_representable_values_survive_type_change(
    migrate: Run, out: Path, tmp_path: Path, old: str, new: str, value: Any, expected: Any
) -> None:
    path = tmp_path / "old.mcap"
    with BagWriter(path) as writer:
        writer.write("/a", compile_definition("val_msgs/msg/A", old)(a=value), log_time_ns=1)
    code, _, err = migrate(path, {"val_msgs/msg/A.msg": new})
    assert code == 0, err
    with BagReader(out) as reader:
        (found,) = reader.messages("/a")
    np.testing.assert_array_equal(found.message.a, expected)


def test_messages_of_unchanged_type_are_copied_byte_for_byte(migrate: Run, bag: str, out: Path) -> None:
    code, printed, err = migrate(bag, {"std_msgs/msg/String.msg": "# Ours.\nstring data\n"}, "--topics", "/words")
    assert code == 0 and printed == f"1 message of 1 topic in {out}, 0 converted\n", err
    with BagReader(out) as reader, BagReader(bag) as old:
        assert reader.topics["/words"].definition == "# Ours.\nstring data\n"
        assert [one.data for one in reader.raw_messages()] == [one.data for one in old.raw_messages("/words")]


def test_topic_with_two_definitions_is_migrated_to_one_channel(migrate: Run, out: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    with BagWriter(path) as writer:
        for number, text in enumerate(("int8 a", "int16 a\nint8 b")):
            cls = compile_definition("two_msgs/msg/A", text)
            known = BagTopic("/a", "two_msgs/msg/A", text, type_hash=type_hash(cls))
            writer.write_raw(RawMessage(known, cls(a=number).encode(), number, number))
    code, printed, err = migrate(path, {"two_msgs/msg/A.msg": "int64 a"})
    assert code == 0 and printed.count("two_msgs/msg/A, in /a") == 2, err
    with BagReader(out) as reader:
        assert len(reader.channels) == 1
        assert [one.message.a for one in reader] == [0, 1]


def test_bag_without_definitions_requires_old_path_option(migrate: Run, out: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    cls = compile_definition("bare_msgs/msg/A", "int8 a")
    with BagWriter(path) as writer:
        writer.add_topic("/a", BagTopic("/a", "bare_msgs/msg/A"))
        writer.write("/a", cls(a=5).encode(), log_time_ns=1)
    code, _, err = migrate(path, {"bare_msgs/msg/A.msg": "int64 a"})
    assert code == 1 and "pass the old definitions with --old-path" in err and not out.exists()
    then = str(write(tmp_path / "then", {"bare_msgs/msg/A.msg": "int8 a"}))
    code, _, err = migrate(path, str(tmp_path / "now"), "--old-path", then)
    assert code == 0, err
    with BagReader(out) as reader:
        assert [one.message.a for one in reader] == [5]


def test_decode_error_names_bag_topic_and_message(migrate: Run, now: str, out: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/wheel", compile_definition(NAME, OLD_TEXT))
        writer.write("/wheel", b"\0\1\0\0\0", log_time_ns=7)
    code, _, err = migrate(path, now, "--rules", rules(tmp_path))
    assert code == 1 and f"{path}: /wheel at 7 ns: {NAME}.speed: at byte" in err and not out.exists()


def test_unused_rules_are_reported(migrate: Run, bag: str, now: str, tmp_path: Path) -> None:
    text = RULES + "types: {robot_msgs/Whel: robot_msgs/Wheel}\n"
    code, _, err = migrate(bag, now, "--dry-run", "--rules", rules(tmp_path, text))
    assert code == 0 and "rule for robot_msgs/msg/Whel is unused" in err


@settings(max_examples=examples(200))
@given(changed_worlds())
def test_random_values_of_random_definitions_are_migrated(case: tuple[Any, Any, Any, dict[str, Any]]) -> None:
    old_world, new_world, reference, value = case
    old = old_world.compile()
    try:
        new = new_world.compile()
    except DefinitionError:  # two fields of one name
        assume(False)
    try:
        plans = plan(fields_of(old), fields_of(new), old_world.top, MigrationRules())
    except MigrationError as error:
        assert "cannot become" in str(error)
        return
    message = reference.build(old, value)
    try:
        carried = to_dict(new.decode(message_converter(plans, old, new)(message).encode()))
    except EncodeError as error:  # a bound or a range is narrower
        assert error.path.startswith(("p", "q"))
        return
    before, otherwise, top = to_dict(message), to_dict(new()), plans[old_world.top, old_world.top]
    for step in top.steps:
        if step.old_type == step.new_type and not step.old_type.is_message:
            assert repr(carried[step.new]) == repr(before[step.old])
    for name in top.defaulted:
        assert repr(carried[name]) == repr(otherwise[name])
    assert {*top.dropped} == {*before} - {*carried}


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("type: {}", 'r:1:1: expected types or fields, found "type"; did you mean "types"?'),
        ("types: [a]", "r:1:8: types: expected the old name: the new name"),
        ("types:\n  Wheel: a/B", 'r:2:3: "Wheel" is not an interface name'),
        ("fields:\n  a/B: x", "r:2:8: a/B: expected the old field: the new field, or null"),
        ("fields:\n  a/B: {x: [y]}", "r:2:12: expected a name"),
        ("fields:\n  a/B: {x: y, x: z}", 'r:2:15: "x" is defined twice'),
        ("- a", "r:1:1: expected types: and fields:"),
        ("types: &a {}\nfields: *a", "r:1:8: anchors and aliases are not supported"),
        ("types: {", "r:2:1: "),
        ("a: \x01", "r: "),
        ("[" * 5000, "r:1:1001: exceeded maximum nesting depth"),
        ("types: !!python/object/apply:os.system [ls]", "r:1:8: types: expected"),
    ],
)
def test_invalid_rules_are_reported_with_line_and_column(text: str, error: str) -> None:
    with pytest.raises(CommandError) as caught:
        parse_rules(text, "r")
    assert str(caught.value).startswith(error), str(caught.value)


def test_yaml_keywords_in_rules_are_read_as_names() -> None:
    found = parse_rules("fields:\n  a/B: {y: no, on: 'null', off: ~, 1: x}\n")
    expected = {"y": "no", "on": "null", "off": "", "1": "x"}
    assert {old: rule.target for old, rule in found.fields["a/msg/B"].items()} == expected
    assert parse_rules("") == parse_rules("types:\nfields: {}\n")


def test_unreadable_rules_file_is_an_error(migrate: Run, bag: str, now: str, tmp_path: Path) -> None:
    file = tmp_path / "rules.yaml"
    for data, error in ((b"\xff", "expected UTF-8, found the byte 0xff"), (b" " * (1 << 21), "expected at most")):
        file.write_bytes(data)
        code, _, err = migrate(bag, now, "--dry-run", "--rules", str(file))
        assert code == 1 and error in err
    code, _, err = migrate(bag, now, "--dry-run", "--rules", str(tmp_path / "none"))
    assert code == 1 and "No such file" in err


@settings(max_examples=examples(300))
@given(st.text(st.sampled_from("typesfield:{}[]-&*!~'\"\n ab/B,#|>%@\t"), max_size=60))
def test_arbitrary_text_is_parsed_as_rules_or_raises_command_error(text: str) -> None:
    try:
        parse_rules(text)
    except CommandError as error:
        assert str(error).startswith("<rules>")


ALL = """\
/scan:
  history: keep_last
  depth: 5
  reliability: best_effort
  durability: TRANSIENT_LOCAL
  deadline: {sec: 1, nsec: 500000000}
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: manual_by_topic
  liveliness_lease_duration:
  avoid_ros_namespace_conventions: false
/a/map: {history: keep_all}
"""


def test_qos_overrides_are_read_in_format_of_rosbag2(tmp_path: Path) -> None:
    path = tmp_path / "qos.yaml"
    path.write_text(ALL)
    assert read_qos_overrides(str(path)) == {
        "/scan": QoSProfile(
            *(History.KEEP_LAST, 5, Reliability.BEST_EFFORT, Durability.TRANSIENT_LOCAL, 1_500_000_000, INFINITE_NS),
            Liveliness.MANUAL_BY_TOPIC,
        ),
        "/a/map": QoSProfile(History.KEEP_ALL),
    }
    assert read_qos_overrides(None) == parse_qos_overrides("") == parse_qos_overrides("# nothing\n") == {}


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("scan: {depth: 1}", "<profiles>:1:1: expected the full name of a topic"),
        ("- /scan", "<profiles>:1:1: expected topics"),
        ("/scan: 5", "<profiles>:1:8: expected policies, of reliability"),
        (
            "/scan:\n  depht: 5",
            "<profiles>:2:3: expected policies, of reliability, history, depth, durability, lifespan, d",
        ),
        ("/scan:\n  depth: -1", '<profiles>:2:10: depth: expected a whole number, 0 or more; found "-1"'),
        ("/scan:\n  depth: 3000000000", "<profiles>:2:3: /scan: depth must be an int from 0"),
        ("/scan:\n  depth: [1]", "<profiles>:2:10: depth: expected a whole number, 0 or more"),
        ("/scan:\n  reliability: best", "<profiles>:2:16: reliability: expected one of system_default, reliable"),
        ("/scan:\n  durability: unknown", "<profiles>:2:15: durability: expected one of"),
        ("/scan:\n  deadline: {sec: 1}", "<profiles>:2:13: deadline: expected sec: and nsec:, found only sec:"),
        ("/scan:\n  deadline: {s: 1}", '<profiles>:2:14: deadline: expected sec: and nsec:, found "s"'),
        ("/scan:\n  deadline: 1", "<profiles>:2:13: deadline: expected sec: and nsec:"),
        ("/scan:\n  avoid_ros_namespace_conventions: 2", "<profiles>:2:36: avoid_ros_namespace_conventions: expected"),
    ],
)
def test_invalid_qos_overrides_are_reported_with_line_and_column(text: str, error: str) -> None:
    with pytest.raises(CommandError) as caught:
        parse_qos_overrides(text)
    assert str(caught.value).startswith(error)


@given(
    st.text()
    | st.recursive(
        st.none() | st.integers() | st.text(),
        lambda one: st.dictionaries(st.sampled_from(["/a", "depth", "history", "deadline", "sec", "nsec"]), one),
    ).map(yaml.safe_dump)
)
def test_arbitrary_text_is_parsed_as_qos_overrides_or_raises_command_error(text: str) -> None:
    try:
        found = parse_qos_overrides(text)
    except CommandError:
        return
    assert all(isinstance(one, QoSProfile) for one in found.values())
