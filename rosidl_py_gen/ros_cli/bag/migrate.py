"""Command ``bag migrate``: converts a recording to changed definitions.

Topics are converted if their type, or a type in it, is defined in the folders of --path; others are copied. Messages of
types whose hash is equal keep their bytes. An incomplete output is removed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import DecodeError, EncodeError, InvalidNameError, RosidlError, TypeNotFoundError
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagCopy, BagReader, BagTopic, RawMessage
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.ros_cli.bag.migration import MessagePlan, MigrationRules


@dataclass(slots=True)
class _Topic:
    """Topic in a migration: recorded channel, channel of the new bag, and conversion.

    `convert` is None to copy bytes unchanged.
    """

    old: BagTopic
    new: BagTopic
    plans: list[MessagePlan] = field(default_factory=list)
    defaults: dict[str, dict[str, str]] = field(default_factory=dict)
    decode: Callable[[bytes], Any] | None = None
    convert: Callable[[Any], Any] | None = None
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
    help="Folder with the new definitions. May be repeated.",
)
@click.option("-o", "--output", type=click.Path(), help="Folder, or file that ends with .mcap.")
@click.option(
    "--rules",
    "rules_file",
    type=click.Path(),
    metavar="FILE",
    help="YAML file that maps old names of types and fields to new ones.",
)
@click.option(
    "--old-path",
    "old_paths",
    multiple=True,
    metavar="DIR",
    help="Folder with the old definitions, for bags without definitions. May be repeated.",
)
@options.topics
@options.compression
@options.split_options
@click.option("--dry-run", is_flag=True, help="Only print converted, dropped and defaulted fields.")
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
    """Convert a recording to changed definitions: fields are matched by name.

    Dropped fields, and fields that get their default value, are listed. A file of rules maps renamed types and fields:

    \b
    types:
      my_msgs/msg/Wheel: my_msgs/msg/WheelState
    fields:
      my_msgs/msg/Wheel:
        name: label
        debug: null     # dropped

    \b
    rosidl-py bag migrate drive --path ~/robot_ws/src -o drive_now
    rosidl-py bag migrate drive --path ~/robot_ws/src --rules renames.yaml --dry-run
    """
    if output is None and not dry_run:
        raise click.UsageError("expected --output or --dry-run")
    from rosidl_py_gen.ros_cli.bag.convert import copy_bag, new_bag
    from rosidl_py_gen.ros_cli.bag.migration import MigrationRules
    from rosidl_py_gen.ros_cli.bag.reading import damaged_rows, opened_source, select_part
    from rosidl_py_gen.ros_cli.bag.yaml_files import read_rules

    copy: BagCopy | None = None
    rules = read_rules(rules_file) if rules_file else MigrationRules()
    with opened_source(path, old_paths) as reader:
        selection = select_part(reader, topics, 0.0, None)
        planned = _plan_topics(reader, selection.topics, paths, rules)
        _warn_unused_rules(rules, planned)
        if not as_json:
            _show(planned)
        if output is not None and not dry_run:
            channels = {key: topic.new for key, topic in planned.items()}
            with new_bag(output, "mcap", compression, split_bytes, split_s) as writer:
                _, copy = copy_bag(
                    reader, writer, selection, channels, lambda one: _converter(reader, planned[one.key])
                )
    carried = sum(one.count for one in planned.values() if one.convert)
    count = sum(one.count for one in planned.values())
    if as_json:
        terminal_output.document(
            {
                **_document(output, planned, None if dry_run else count),
                "damaged": damaged_rows(reader.damaged),
                "unread_bytes": reader.unread_bytes,
                "not_carried_over": {} if copy is None else dict(copy.omitted),
            }
        )
    elif copy is not None:
        for line in copy.omission_lines():
            terminal_output.note(line)
        names = {one.old.name for one in planned.values()}
        counts = f"{pluralize(count, 'message')} of {pluralize(len(names), 'topic')}"
        terminal_output.line(f"{counts} in {output}, {carried} converted")
    return DAMAGED if reader.damaged else 0


class _NewDefinitions:
    def __init__(self, paths: Sequence[str]) -> None:
        from rosidl_py_gen.compiler.frontend import InterfaceRegistry, SearchPath

        self._paths = tuple(paths)
        self._search = SearchPath.scan(self._paths)
        self._library = InterfaceRegistry(self._search)

    def find(self, name: str) -> tuple[type[Message], str] | str:
        """Return the class and definition text of a type in ``--path``, or a text that states why messages are copied
        unchanged.
        """
        from rosidl_py_gen import get_message
        from rosidl_py_gen.compiler.frontend import DefinitionText

        try:
            owner = self._library.read_checked(RosName.parse(name))
        except TypeNotFoundError:
            return "not among the new definitions"
        packages = {one.partition("/")[0] for one in self._library.all_hashes(name)}
        if not any(self._search.packages[one].origin in self._paths for one in packages):
            return "not defined in --path"
        return get_message(name, path=self._paths), DefinitionText(self._library, owner).full


def _plan_topics(
    reader: BagReader, topics: Sequence[str], paths: Sequence[str], rules: MigrationRules
) -> dict[tuple[str, ...], _Topic]:
    """Return the conversion of each selected channel, by channel key; all failures are raised in one `CommandError`."""
    from rosidl_py_gen.ros_cli.bag.migration import MigrationError

    definitions = _NewDefinitions(paths)
    problems: list[str] = []
    planned = {}
    for channel in reader.channels:
        if channel.name in topics:
            try:
                planned[channel.key] = _topic(reader, channel, definitions, rules)
            except (MigrationError, CommandError) as error:
                problems.append(str(error))
    if problems:
        raise CommandError(f"{reader.path} cannot be converted: " + "\n".join(dict.fromkeys(problems)))
    return planned


def _topic(reader: BagReader, channel: BagTopic, definitions: _NewDefinitions, rules: MigrationRules) -> _Topic:
    from rosidl_py_gen import type_hash
    from rosidl_py_gen.bags import described
    from rosidl_py_gen.cdr.type_queries import referenced_classes
    from rosidl_py_gen.ros_cli.bag.migration import fields_of, message_converter, plan
    from rosidl_py_gen.ros_cli.bag.reading import guess_mismatch

    if channel.message_encoding != "cdr":
        return _Topic(channel, channel, note=f"messages are {channel.message_encoding}")
    try:
        name = rules.type_name(str(RosName.parse(channel.type_name, "msg")))
    except InvalidNameError as error:
        return _Topic(channel, channel, note=str(error))
    new_definition = definitions.find(name)
    if isinstance(new_definition, str):
        if name != channel.type_name and channel.type_name in rules.types:
            raise CommandError(f"{rules.types[channel.type_name].place}: {name} is {new_definition}")
        return _Topic(channel, channel, note=new_definition)
    try:
        definition = reader.definition(channel)
    except RosidlError as error:
        reason = str(error)
    else:
        reason = guess_mismatch(reader, channel, definition)
    if reason:
        if channel.count == 0:
            return _Topic(channel, channel, note=f"no messages, and {reason}")
        raise CommandError(f"{reason}; pass the old definitions with --old-path, or select topics with --topics")
    old: Any = definition.message_class
    new, text = new_definition
    target = replace(
        described(channel, definition),
        type_name=name,
        definition=text,
        encoding="ros2idl" if text.startswith("=") else "ros2msg",
        type_hash=type_hash(new),
    )
    if type_hash(old) == type_hash(new):
        return _Topic(channel, target)
    plans = plan(fields_of(old), fields_of(new), old._TYPE.name, rules)
    changed = [one for one in plans.values() if one.is_conversion]
    classes: dict[str, Any] = referenced_classes(new)
    defaults = {one: cls._TYPE.defaults for one, cls in classes.items()}
    return _Topic(channel, target, changed, defaults, old.decode, message_converter(plans, old, new))


def _warn_unused_rules(rules: MigrationRules, planned: dict[tuple[str, ...], _Topic]) -> None:
    used = {one.old for topic in planned.values() for one in topic.plans}
    used |= {topic.old.type_name for topic in planned.values()}
    for name in sorted({*rules.types, *rules.fields} - used):
        terminal_output.note(f"rule for {name} is unused: the bag has no messages of this type that change")


def _converter(reader: BagReader, topic: _Topic) -> Callable[[RawMessage], RawMessage]:
    def convert(item: RawMessage) -> RawMessage:
        topic.count += 1
        if topic.convert is None or topic.decode is None:
            return item
        place = f"{reader.path}: {topic.old.name} at {item.log_time} ns"
        try:
            data = topic.convert(topic.decode(item.data)).encode()
        except DecodeError as error:
            raise DecodeError(f"{place}: {error.path}", error.offset_bytes, error.reason) from None
        except EncodeError as error:
            raise CommandError(f"{place}: {error.path}: {error.reason}") from None
        return item._replace(data=data)

    return convert


def _show(planned: dict[tuple[str, ...], _Topic]) -> None:
    topics_by_text: dict[tuple[str, ...], list[str]] = {}  # definitions of a type may differ
    for topic in planned.values():
        for one in topic.plans:
            was = "" if one.old == one.new else f"{one.old} -> "
            lines = f"{was}{one.new}", *_change_lines(one, topic.defaults.get(one.new, {}))
            topics_by_text.setdefault(lines, []).append(topic.old.name)
    for (head, *changes), topics in topics_by_text.items():
        terminal_output.line(f"{head}, in {', '.join(dict.fromkeys(topics))}", "bold")
        for text in changes:
            terminal_output.line(f"    {text}")
    for topic in planned.values():
        if topic.note:
            terminal_output.line(f"{topic.old.name} [{topic.old.type_name}] is copied: {topic.note}")


def _change_lines(one: MessagePlan, defaults: Mapping[str, str]) -> list[str]:
    lines = []
    for step in one.steps:
        name = step.old if step.old == step.new else f"{step.old} -> {step.new}"
        if step.old_type != step.new_type:
            lines.append(f"{name}: {step.old_type} -> {step.new_type}")
        elif step.old != step.new:
            lines.append(name)
    lines += [f"- {name}: dropped{' by a rule' if name in one.dropped_by_rule else ''}" for name in one.dropped]
    values = {name: f", {defaults[name][:60]}" if name in defaults else "" for name in one.defaulted}
    return lines + [f"+ {name}: its default{value}" for name, value in values.items()]


def _document(output: str | None, planned: dict[tuple[str, ...], _Topic], count: int | None) -> dict[str, Any]:
    return {
        "path": output,
        "messages": count,
        "topics": [
            {
                "name": one.old.name,
                "type": one.new.type_name,
                "old_type": one.old.type_name,
                "count": one.count if count is not None else one.old.count,
                "carried_over": one.convert is not None,
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
            for one in planned.values()
        ],
    }
