"""``bag migrate``: a recording carried over to changed definitions.

Decides which topics are carried over: those whose type, or one that it contains, is defined in the folders of --path;
others stay as they were recorded. Messages of a type whose hash did not change keep their bytes. Nothing is left of a
bag that could not be carried over whole.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import DecodeError, EncodeError, InvalidNameError, RosidlError, TypeNotFoundError
from rosidl_py_gen.ros_cli import DAMAGED, ToolError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagReader, BagTopic, BagWriter, RawMessage
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.compiler.compatibility.migration import MessagePlan, MigrationRules


_PROGRESS_S = 0.25


@dataclass(slots=True)
class _Topic:
    """A channel and what becomes of it; `carry` is None where its bytes stay."""

    old: BagTopic
    new: BagTopic
    plans: list[MessagePlan] = field(default_factory=list)
    defaults: dict[str, dict[str, str]] = field(default_factory=dict)
    decode: Callable[[bytes], Any] | None = None
    carry: Callable[[Any], Any] | None = None
    note: str = ""
    count: int = 0


@click.command("migrate", cls=options.MultiValueCommand)
@options.bag_path
@click.option(
    "--path",
    "paths",
    multiple=True,
    required=True,
    metavar="DIR",
    help="A folder with the new definitions; may be given several times.",
)
@click.option("-o", "--output", type=click.Path(), help="A folder, or a file that ends with .mcap.")
@click.option("--rules", "rules_file", type=click.Path(), metavar="FILE", help="YAML: what types and fields are now.")
@click.option(
    "--old-path",
    "old_paths",
    multiple=True,
    metavar="DIR",
    help="A folder with the definitions of then, for bags that do not have theirs; may be given several times.",
)
@options.topics
@options.compression
@options.split_options
@click.option("--dry-run", is_flag=True, help="Only say what would be carried over, dropped and defaulted.")
@options.as_json
@verb
def migrate(
    path: str,
    output: str | None,
    paths: Sequence[str],
    old_paths: Sequence[str],
    rules_file: str | None,
    topics: Sequence[str],
    compression: str,
    split_bytes: int | None,
    split_s: float | None,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Carry a recording over to changed definitions, field by field, by their names.

    What is dropped, and what gets its default value, is listed. A file of rules says which types and fields have other
    names now:

    \b
    types:
      my_msgs/msg/Wheel: my_msgs/msg/WheelState
    fields:
      my_msgs/msg/Wheel:
        name: label
        debug: null     # let go

    \b
    rosidl-py bag migrate drive --path ~/robot_ws/src -o drive_now
    rosidl-py bag migrate drive --path ~/robot_ws/src --rules renames.yaml --dry-run
    """
    if output is None and not dry_run:
        raise click.UsageError("say where to write: --output, or --dry-run")
    from rosidl_py_gen.bags import BagReader, BagWriter
    from rosidl_py_gen.compiler.compatibility.migration import MigrationRules
    from rosidl_py_gen.ros_cli.bag.convert import remove
    from rosidl_py_gen.ros_cli.bag.migration_rules import read_rules
    from rosidl_py_gen.ros_cli.bag.selection import select_part

    rules = read_rules(rules_file) if rules_file else MigrationRules()
    with BagReader(path, search_path=old_paths, skip_damaged=True) as reader:
        wanted = select_part(reader, topics, 0.0, None).topics
        found = _planned(reader, wanted, paths, rules)
        _warn_unused_rules(rules, found)
        if not as_json:
            _show(found)
        if not dry_run:
            assert output is not None
            inside = "" if compression == "none" else compression
            writer = BagWriter(output, compression=inside, split_bytes=split_bytes, split_s=split_s)
            try:
                with writer:
                    _copy(reader, writer, wanted, found)
            except BaseException:
                remove(Path(output))  # part of a bag would look like all of it
                raise
    carried = sum(one.count for one in found.values() if one.carry)
    count = sum(one.count for one in found.values())
    if as_json:
        terminal_output.document(_document(output, found, None if dry_run else count))
    elif not dry_run:
        names = {one.old.name for one in found.values()}
        terminal_output.line(f"{count} messages of {len(names)} topics in {output}, {carried} of them carried over")
    return DAMAGED if reader.damaged else 0


class _NewDefinitions:
    """The definitions of now."""

    def __init__(self, paths: Sequence[str]) -> None:
        from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
        from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

        self._paths = tuple(paths)
        self._search = scan_search_path(self._paths)
        self._library = InterfaceRegistry(self._search)

    def found(self, name: str) -> tuple[type[Message], str] | str:
        """Class and text of a type; or why its messages stay as they are.

        Raises:
            DefinitionError: it has problems.
        """
        from rosidl_py_gen import get_message
        from rosidl_py_gen.compiler.frontend.definition_text import full_text, read_checked

        try:
            owner = read_checked(self._library, split_ros_name(name))
        except TypeNotFoundError:
            return "not among the new definitions"
        packages = {one.partition("/")[0] for one in self._library.all_hashes(name)}
        if not any(self._search.packages[one].origin in self._paths for one in packages):
            return "not defined in --path"
        return get_message(name, path=self._paths), full_text(self._library, owner)


def _planned(
    reader: BagReader, wanted: Sequence[str], paths: Sequence[str], rules: MigrationRules
) -> dict[tuple[str, ...], _Topic]:
    """What becomes of each channel, by its key; all that hinders is raised at once."""
    from rosidl_py_gen.compiler.compatibility.migration import MigrationError

    definitions = _NewDefinitions(paths)
    problems: list[str] = []
    found = {}
    for channel in reader.channels:
        if channel.name in wanted:
            try:
                found[channel.key] = _topic(reader, channel, definitions, rules)
            except (MigrationError, ToolError) as error:
                problems.append(str(error))
    if problems:
        raise ToolError(f"{reader.path} cannot be carried over: " + "\n".join(dict.fromkeys(problems)))
    return found


def _topic(reader: BagReader, channel: BagTopic, definitions: _NewDefinitions, rules: MigrationRules) -> _Topic:
    from rosidl_py_gen import type_hash
    from rosidl_py_gen.bags.definition_lookup import described
    from rosidl_py_gen.cdr.typesupport import referenced_classes
    from rosidl_py_gen.compiler.compatibility.migration import plan
    from rosidl_py_gen.ros_cli.bag.field_conversion import message_converter
    from rosidl_py_gen.ros_cli.bag.output_definitions import guess_mismatch

    if channel.message_encoding != "cdr":
        return _Topic(channel, channel, note=f"messages are {channel.message_encoding}")
    try:
        name = rules.type_name(str(split_ros_name(channel.type_name, "msg")))
    except InvalidNameError as error:
        return _Topic(channel, channel, note=str(error))
    now = definitions.found(name)
    if isinstance(now, str):
        if name != channel.type_name and channel.type_name in rules.types:
            raise ToolError(f"{rules.types[channel.type_name].place}: {name} is {now}")
        return _Topic(channel, channel, note=now)
    try:
        known = reader.definition(channel)
        reason = guess_mismatch(reader, channel)
    except RosidlError as error:
        reason = str(error)
    if reason:
        if channel.count == 0:
            return _Topic(channel, channel, note=f"no messages, and {reason}")
        raise ToolError(f"{reason}; --old-path gives the definitions of then, --topics leaves topics out")
    old: Any = known.message_class
    new, text = now
    target = replace(
        described(channel, known),
        type_name=name,
        definition=text,
        encoding="ros2idl" if text.startswith("=") else "ros2msg",
        type_hash=type_hash(new),
    )
    if type_hash(old) == type_hash(new):
        return _Topic(channel, target)
    plans = plan(fields_of(old), fields_of(new), old._TYPE.name, rules)
    shown = [one for one in plans.values() if one.is_conversion]
    classes: dict[str, Any] = referenced_classes(new)
    defaults = {one: cls._TYPE.defaults for one, cls in classes.items()}
    return _Topic(channel, target, shown, defaults, old.decode, message_converter(plans, old, new))


def fields_of(cls: type[Message]) -> dict[str, list[tuple[str, Any]]]:
    """A message and all it contains, as `plan` takes them."""
    from rosidl_py_gen.cdr.typesupport import referenced_classes

    classes: dict[str, Any] = referenced_classes(cls)
    return {name: [(one.ros_name, one.type) for one in found._TYPE.fields] for name, found in classes.items()}


def _warn_unused_rules(rules: MigrationRules, found: dict[tuple[str, ...], _Topic]) -> None:
    """Say which rules are about types that no message has: a mistyped name would go unnoticed."""
    used = {one.old for topic in found.values() for one in topic.plans}
    used |= {topic.old.type_name for topic in found.values()}
    for name in sorted({*rules.types, *rules.fields} - used):
        terminal_output.note(f"no rule about {name} was needed: the bag has no messages of it that change")


def _copy(reader: BagReader, writer: BagWriter, wanted: Sequence[str], found: dict[tuple[str, ...], _Topic]) -> None:
    from rosidl_py_gen.bags import RawMessage
    from rosidl_py_gen.ros_cli.bag.selection import progress

    for topic in found.values():
        writer.add_raw_topic(topic.new)
    total = sum(topic.old.count or 0 for topic in found.values())
    count, shown = 0, monotonic()
    known: dict[int, tuple[BagTopic, _Topic]] = {}  # by identity: comparing definitions takes long
    with progress() as show:
        for item in reader.raw_messages(wanted):
            if id(item.channel) not in known:
                known[id(item.channel)] = item.channel, found[item.channel.key]
            topic = known[id(item.channel)][1]
            data = _carried(reader, topic, item) if topic.carry else item.data
            writer.write_raw(RawMessage(topic.new, data, item.log_time, item.publish_time))
            topic.count += 1
            count += 1
            if monotonic() > shown + _PROGRESS_S:
                shown = monotonic()
                show(f"{count} of {total} messages")


def _carried(reader: BagReader, topic: _Topic, item: RawMessage) -> bytes:
    assert topic.decode is not None and topic.carry is not None
    place = f"{reader.path}: {topic.old.name} at {item.log_time} ns"
    try:
        message = topic.carry(topic.decode(item.data))
        data: bytes = message.encode()
    except DecodeError as error:
        raise DecodeError(f"{place}: {error.path}", error.offset_bytes, error.reason) from None
    except EncodeError as error:
        raise ToolError(f"{place}: {error.path}: {error.reason}") from None
    return data


def _show(found: dict[tuple[str, ...], _Topic]) -> None:
    shown: dict[tuple[str, ...], list[str]] = {}  # by what is said: two definitions of one type may change otherwise
    for topic in found.values():
        for one in topic.plans:
            was = "" if one.old == one.new else f"{one.old} -> "
            lines = f"{was}{one.new}", *_lines(one, topic.defaults.get(one.new, {}))
            shown.setdefault(lines, []).append(topic.old.name)
    for (head, *changes), topics in shown.items():
        terminal_output.line(f"{head}, in {', '.join(dict.fromkeys(topics))}", "bold")
        for text in changes:
            terminal_output.line(f"    {text}")
    for topic in found.values():
        if topic.note:
            terminal_output.line(f"{topic.old.name} [{topic.old.type_name}] stays as it is: {topic.note}")


def _lines(one: MessagePlan, defaults: Mapping[str, str]) -> list[str]:
    lines = []
    for step in one.steps:
        name = step.old if step.old == step.new else f"{step.old} -> {step.new}"
        if step.old_type != step.new_type:
            lines.append(f"{name}: {step.old_type} -> {step.new_type}")
        elif step.old != step.new:
            lines.append(name)
    lines += [f"- {name}: dropped{', as a rule says' if name in one.dropped_by_rule else ''}" for name in one.dropped]
    values = {name: f", {defaults[name][:60]}" if name in defaults else "" for name in one.defaulted}
    return lines + [f"+ {name}: its default{value}" for name, value in values.items()]


def _document(output: str | None, found: dict[tuple[str, ...], _Topic], count: int | None) -> dict[str, Any]:
    return {
        "path": output,
        "messages": count,
        "topics": [
            {
                "name": one.old.name,
                "type": one.new.type_name,
                "old_type": one.old.type_name,
                "count": one.count if count is not None else one.old.count,
                "carried_over": one.carry is not None,
                "note": one.note,
                "changes": [
                    {
                        "old_type": change.old,
                        "type": change.new,
                        "renamed": {step.old: step.new for step in change.steps if step.old != step.new},
                        "converted": {
                            step.new: [str(step.old_type), str(step.new_type)]
                            for step in change.steps
                            if step.old_type != step.new_type
                        },
                        "dropped": list(change.dropped),
                        "defaulted": list(change.defaulted),
                    }
                    for change in one.plans
                ],
            }
            for one in found.values()
        ],
    }
