"""``bag info``: contents of a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.runtime import QoSProfile


@click.command("info")
@options.bag_path
@click.option("-v", "--verbose", "is_verbose", is_flag=True, help="Also print the origin of each topic's definition.")
@options.paths
@options.as_json
@verb
def info(path: str, is_verbose: bool, paths: Sequence[str], as_json: bool) -> None:
    """Print the contents of a bag. A bag whose recorder was killed is read completely.

    \b
    rosidl-py bag info my_bag
    rosidl-py bag info my_bag --json | jq '.topics[].name'
    rosidl-py bag info humble_bag --verbose --path ~/ws/src
    """
    from rosidl_py_gen.ros_cli.bag.display import opened_bag

    with opened_bag(path, search_path=paths) as reader:
        channels = _with_counts(reader)
        if as_json:
            terminal_output.document(_document(reader, channels, is_verbose))
        else:
            _show(reader, channels, is_verbose)


def _with_counts(reader: BagReader) -> list[BagTopic]:
    from collections import Counter

    from rosidl_py_gen.ros_cli.bag.display import ProgressBar

    if all(one.count is not None for one in reader.channels):
        return reader.channels
    counts: Counter[tuple[str, ...]] = Counter()
    with ProgressBar("messages") as show:
        for message in show.each(reader.raw_messages()):
            counts[message.channel.key] += 1
    return [replace(one, count=counts[one.key]) for one in reader.channels]


def _messages(channels: Sequence[BagTopic]) -> int:
    return sum(one.count or 0 for one in channels)


def _size(reader: BagReader) -> int:
    return sum(file.stat().st_size for file in reader.files)


def _document(reader: BagReader, channels: Sequence[BagTopic], is_verbose: bool) -> dict[str, Any]:
    from rosidl_py_gen.bags.metadata import qos_profiles
    from rosidl_py_gen.ros_cli.bag.display import damaged_rows

    return {
        "path": str(reader.path),
        "files": [file.name for file in reader.files],
        "size": _size(reader),
        "storage": _storage(reader),
        "has_index": reader.has_index,
        "unread_bytes": reader.unread_bytes,
        "damaged": damaged_rows(reader.damaged),
        "start_ns": reader.start_ns,
        "end_ns": reader.end_ns,
        "duration_ns": reader.end_ns - reader.start_ns,
        "messages": _messages(channels),
        "topics": [
            {
                "name": topic.name,
                "type": topic.type_name,
                "count": topic.count,
                "serialization_format": topic.message_encoding,
                "type_hash": topic.type_hash,
                "has_definition": bool(topic.definition),
                "offered_qos": [_qos(profile) for profile in qos_profiles(topic.offered_qos)],
                **(_definition(reader, topic) if is_verbose else {}),
            }
            for topic in channels
        ],
    }


def _definition(reader: BagReader, topic: BagTopic) -> dict[str, Any]:
    try:
        definition = reader.definition(topic)
    except RosidlError as error:
        return {"definition": None, "problem": str(error)}
    return {
        "definition": definition.origin,
        "is_recorded": definition.is_recorded,
        "definition_hash": definition.type_hash,
    }


def _definition_text(reader: BagReader, topic: BagTopic) -> str:
    row = _definition(reader, topic)
    if row["definition"] is None:
        return str(row["problem"])
    return str(row["definition"]) + ("" if row["is_recorded"] else " (guessed by name)")


def _storage(reader: BagReader) -> str:
    names = (file.name.removesuffix(".zstd") for file in reader.files)
    return "sqlite3" if next(names, "").endswith(".db3") else "mcap"


def _qos(profile: QoSProfile) -> dict[str, Any]:
    policies = (profile.history, profile.reliability, profile.durability, profile.liveliness)
    names = ("history", "reliability", "durability", "liveliness")
    return {name: policy.name.lower() for name, policy in zip(names, policies, strict=True)} | {"depth": profile.depth}


def _show(reader: BagReader, channels: Sequence[BagTopic], is_verbose: bool) -> None:
    from rosidl_py_gen.ros_cli.bag.display import duration_text, size_text, time_text

    rows = [
        ("Files", ", ".join(file.name for file in reader.files)),
        ("Bag size", size_text(_size(reader))),
        ("Storage id", _storage(reader)),
        ("Duration", duration_text(reader.end_ns - reader.start_ns)),
        ("Start", time_text(reader.start_ns)),
        ("End", time_text(reader.end_ns)),
        ("Messages", str(_messages(channels))),
    ]
    if not reader.has_index:
        advice = "`rosidl-py bag convert` creates a complete bag" if _messages(channels) else "it contains no message"
        rows.append(("Index", f"missing: the recorder was killed; {advice}"))
    if reader.unread_bytes:
        rows.append(("Lost", f"{size_text(reader.unread_bytes)} of an unfinished record at the end"))
    if reader.damaged:
        rows.append(("Damaged", f"{len(reader.damaged)} parts; `rosidl-py bag convert` copies the others"))
    missing = sum(not topic.definition for topic in reader.channels)
    if missing and not is_verbose:
        rows.append(("Types", f"{missing} have no definition in the bag; --verbose prints the local ones"))
    for name, text in rows:
        terminal_output.line(f"{name + ':':<12}{text}")
    terminal_output.line()
    table_rows = [[one.name, one.type_name, str(one.count), _qos_text(one)] for one in channels]
    columns = ["topic", "type", "count", "QoS"]
    if is_verbose:
        table_rows = [[*row, _definition_text(reader, one)] for row, one in zip(table_rows, channels, strict=True)]
        columns.append("definition")
    terminal_output.table(table_rows, *columns)
    _show_double(reader)


def _show_double(reader: BagReader) -> None:
    for name, known in reader.topics.items():
        definitions = [one for one in reader.channels if one.name == name]
        if len(definitions) > 1:
            types = ", ".join(sorted({f"{one.type_name} {one.type_hash}".strip() for one in definitions}))
            terminal_output.line(f"{known.name}: recorded with {len(definitions)} definitions: {types}")


def _qos_text(topic: BagTopic) -> str:
    from rosidl_py_gen.bags.metadata import qos_profiles

    table_rows = {
        f"{profile.reliability.name}, {profile.durability.name}".lower().replace("_", " ")
        for profile in qos_profiles(topic.offered_qos)
    }
    return " / ".join(sorted(table_rows))
