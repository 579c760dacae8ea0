"""Command ``bag info``: prints the contents of a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import options, verb

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
    from rosidl_py_gen.ros_cli.bag.reading import opened_bag

    with opened_bag(path, search_path=paths) as reader:
        document = _document(reader, is_verbose)
        if as_json:
            terminal_output.document(document)
        else:
            _show(document, is_verbose)
            _show_double(reader)


def _with_counts(reader: BagReader) -> list[BagTopic]:
    from collections import Counter

    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar

    if all(one.count is not None for one in reader.channels):
        return reader.channels
    counts: Counter[tuple[str, ...]] = Counter()
    with ProgressBar("messages") as show:
        for message in show.each(reader.raw_messages()):
            counts[message.channel.key] += 1
    return [replace(one, count=counts[one.key]) for one in reader.channels]


def _document(reader: BagReader, is_verbose: bool) -> dict[str, Any]:
    from rosidl_py_gen.bags import OfferedQoS
    from rosidl_py_gen.ros_cli.bag.reading import damaged_rows

    channels = _with_counts(reader)
    names = [file.name for file in reader.files]
    return {
        "path": str(reader.path),
        "files": names,
        "size": sum(file.stat().st_size for file in reader.files),
        "storage": "sqlite3" if names and names[0].removesuffix(".zstd").endswith(".db3") else "mcap",
        "has_index": reader.has_index,
        "unread_bytes": reader.unread_bytes,
        "damaged": damaged_rows(reader.damaged),
        "start_ns": reader.start_ns,
        "end_ns": reader.end_ns,
        "duration_ns": reader.end_ns - reader.start_ns,
        "messages": sum(one.count or 0 for one in channels),
        "topics": [
            {
                "name": topic.name,
                "type": topic.type_name,
                "count": topic.count,
                "serialization_format": topic.message_encoding,
                "type_hash": topic.type_hash,
                "has_definition": bool(topic.definition),
                "offered_qos": [_qos(profile) for profile in OfferedQoS.parse(topic.offered_qos)],
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


def _qos(profile: QoSProfile) -> dict[str, Any]:
    policies = (profile.history, profile.reliability, profile.durability, profile.liveliness)
    names = ("history", "reliability", "durability", "liveliness")
    return {name: policy.name.lower() for name, policy in zip(names, policies, strict=True)} | {"depth": profile.depth}


def _show(document: dict[str, Any], is_verbose: bool) -> None:
    from rosidl_py_gen.ros_cli.bag.reading import duration_text, size_text, time_text

    rows = [
        ("Files", ", ".join(document["files"])),
        ("Bag size", size_text(document["size"])),
        ("Storage id", document["storage"]),
        ("Duration", duration_text(document["duration_ns"])),
        ("Start", time_text(document["start_ns"])),
        ("End", time_text(document["end_ns"])),
        ("Messages", str(document["messages"])),
    ]
    if not document["has_index"]:
        advice = "`rosidl-py bag convert` creates a complete bag" if document["messages"] else "it contains no message"
        rows.append(("Index", f"missing: the recorder was killed, or a file was cut off; {advice}"))
    if document["unread_bytes"]:
        rows.append(("Lost", f"{size_text(document['unread_bytes'])} of an unfinished record at the end"))
    if document["damaged"]:
        rows.append(
            ("Damaged", f"{pluralize(len(document['damaged']), 'part')}; `rosidl-py bag convert` copies the others")
        )
    missing = sum(not topic["has_definition"] for topic in document["topics"])
    if missing and not is_verbose:
        rows.append(("Types", f"{missing} have no definition in the bag; --verbose prints the local ones"))
    for name, text in rows:
        terminal_output.line(f"{name + ':':<12}{text}")
    terminal_output.line()
    columns = ["topic", "type", "count", "QoS", *["definition"] * is_verbose]
    terminal_output.table([_topic_row(topic, is_verbose) for topic in document["topics"]], *columns)


def _topic_row(topic: dict[str, Any], is_verbose: bool) -> list[str]:
    profiles = {f"{one['reliability']}, {one['durability']}".replace("_", " ") for one in topic["offered_qos"]}
    row = [topic["name"], topic["type"], str(topic["count"]), " / ".join(sorted(profiles))]
    if is_verbose and topic["definition"] is None:
        row.append(topic["problem"])
    elif is_verbose:
        row.append(topic["definition"] + ("" if topic["is_recorded"] else " (guessed by name)"))
    return row


def _show_double(reader: BagReader) -> None:
    for name, known in reader.topics.items():
        definitions = [one for one in reader.channels if one.name == name]
        if len(definitions) > 1:
            types = ", ".join(sorted({f"{one.type_name} {one.type_hash}".strip() for one in definitions}))
            terminal_output.line(f"{known.name}: recorded with {len(definitions)} definitions: {types}")
