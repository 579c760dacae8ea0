"""Command ``topic echo``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.topic import qos_options, requested_profile

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.ros_cli.message_text import Style

_LOST_NOTE_INTERVAL_S = 1.0
_EARLY = 0.25
"""Fraction of the period of ``--max-rate`` by which a message may be printed before it is due."""


@click.command("echo", cls=options.MultiValueCommand)
@options.topic_argument()
@click.argument("type_name", metavar="[TYPE]", required=False, shell_complete=options.call_completion("topic"))
@click.option("--once", is_flag=True, help="Print one message.")
@click.option(
    "--field",
    "fields",
    multiple=True,
    metavar="PATH",
    shell_complete=options.field_completion,
    help="Print only a field, such as pose.position, poses[0].x or ranges[0:5]. May be repeated.",
)
@click.option("--filter", "filter_text", metavar="EXPR", help="Print only messages m for which EXPR is true.")
@options.rate(
    *("--max-rate", "max_rate_hz"),
    help="Maximum number of printed messages per second; the number of dropped ones is printed at the end.",
)
@click.option("--csv", "style", flag_value="csv", help="Print each message as a line of CSV.")
@click.option("--json", "style", flag_value="json", help="Print each message as a line of JSON, in full.")
@click.option("--flow-style", "style", flag_value="flow", help="Print each message as a line of YAML.")
@click.option("--raw", is_flag=True, help="Print the bytes of messages; no definition is needed.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@click.option(
    "-l",
    "--truncate-length",
    type=click.IntRange(0),
    metavar="N",
    help="Maximum length of printed arrays and strings.  [default: 128]",
)
@click.option(
    "--no-arr", "arrays", is_flag=True, flag_value=False, default=True, help="Print types and sizes of arrays only."
)
@click.option(
    "--no-str", "strings", is_flag=True, flag_value=False, default=True, help="Print lengths of strings only."
)
@click.option(
    *("--no-lost-messages", "lost_messages"),
    flag_value=False,
    default=True,
    help="Print no note if messages arrive faster than they are printed.",
)
@options.seconds(
    *("--timeout", "timeout_s"),
    help="Maximum time to wait for the topic, and for each message.  [default: 5, and no limit]",
)
@qos_options
@options.paths
@options.endless_node_verb(lambda arguments: not arguments["once"])
async def echo(
    command_node: CommandNode,
    topic: str,
    type_name: str | None,
    once: bool,
    fields: Sequence[str],
    filter_text: str | None,
    max_rate_hz: float | None,
    style: Style | None,
    raw: bool,
    full_length: bool,
    truncate_length: int | None,
    arrays: bool,
    strings: bool,
    lost_messages: bool,
    timeout_s: float | None,
    qos: dict[str, Any],
    paths: Sequence[str],
) -> None:
    """Print the messages of a topic.

    \b
    rosidl-py topic echo /chatter
    rosidl-py topic echo /odom --field pose.pose.position --csv
    rosidl-py topic echo /rosout --filter 'm.level >= 30 and "lidar" in m.name'

    Without --qos-... options, the QoS is what all publishers offer. --filter supports comparisons, arithmetic, and or
    not in, abs all any bool float int isfinite isinf isnan len max min round sqrt sum, and
    any(x < 1 for x in m.ranges).
    """
    from rosidl_py_gen.command_support import interface_class, opaque_class, preload_while_waiting
    from rosidl_py_gen.ros_cli.message_expressions import compile_filter
    from rosidl_py_gen.ros_cli.message_text import value_printer
    from rosidl_py_gen.runtime import AdaptiveSubscription, WaitTimeoutError
    from rosidl_py_gen.runtime import qos as presets

    naming = _full_name(command_node, topic, type_name, timeout_s)
    name = await (naming if raw else preload_while_waiting(naming))
    printer = value_printer(
        style or "yaml", full_length=full_length, truncate_length=truncate_length, arrays=arrays, strings=strings
    )
    rate_limit = _RateLimit(max_rate_hz, command_node.now_s)
    cls: Any
    if raw:
        cls = opaque_class(command_node, name, type_name)
        show = _message_printer(lambda value: value, lambda value: True, rate_limit, printer)
    else:
        cls = await interface_class(command_node, "topic", name, type_name, paths)
        condition = compile_filter(filter_text, cls) if filter_text else lambda value: True
        show = _message_printer(_fields(cls, fields, arrays), condition, rate_limit, printer)
    profile = requested_profile(qos, presets.SENSOR_DATA)
    subscription: AdaptiveSubscription[Any] = AdaptiveSubscription(
        command_node.node, name, cls, raw=raw, qos=profile, note=terminal_output.note
    )
    lost, has_received, printed_s = _LostNotes(command_node.now_s), False, command_node.now_s()
    async with subscription as messages:
        try:
            while True:
                message, _ = await messages.receive_with_info(
                    None if timeout_s is None else max(0.0, printed_s + timeout_s - command_node.now_s())
                )
                has_received = True
                if show(message):
                    printed_s = command_node.now_s()
                    if once:
                        return
                if lost_messages:
                    lost.note(messages.dropped)
        except WaitTimeoutError as error:
            text = f"on {name} in {timeout_s:g} s"
            if filter_text and has_received:
                raise CommandError(f"no message that passes the filter {text}") from None
            raise CommandError(f"no message {text}: {error.reason}") from None
        finally:
            rate_limit.report_dropped()


async def _full_name(command_node: CommandNode, topic: str, type_name: str | None, timeout_s: float | None) -> str:
    """Wait until the topic is found, or with `type_name` only until discovery is complete, and return the full name."""
    if type_name is None:
        return await command_node.find("topic", topic, timeout_s)
    name = command_node.full_name(topic)
    await command_node.wait_for_discovery()
    return name


class _LostNotes:
    """Printer of notes about lost messages, which arrived faster than they were printed."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._total, self._noted_s, self._now_s = 0, 0.0, now_s

    def note(self, total: int) -> None:
        if total > self._total and (now := self._now_s()) > self._noted_s + _LOST_NOTE_INTERVAL_S:
            missed = pluralize(total - self._total, "message")
            terminal_output.note(f"missed {missed}: more arrived than could be printed ({total} in total)")
            self._total, self._noted_s = total, now


def _fields(cls: type[Message], paths: Sequence[str], arrays: bool) -> Callable[[Message], Any]:
    """Return a function that selects what is printed of a message: all, the value of one path, or values by path."""
    from rosidl_py_gen.base.fieldtype import Arity
    from rosidl_py_gen.ros_cli.message_expressions import compile_path
    from rosidl_py_gen.ros_cli.message_text import array_summary

    if not paths:
        return lambda message: message

    def field_value(path: str) -> Callable[[Message], Any]:
        value, field = compile_path(path, cls)
        if arrays or field is None or field.type.arity is Arity.SCALAR:
            return value
        return lambda message: array_summary(field, value(message))

    values = {path: field_value(path) for path in paths}
    if len(values) == 1:
        return values[paths[0]]
    return lambda message: {path: value(message) for path, value in values.items()}


class _RateLimit:
    """Limit of ``--max-rate``; `max_hz` None means no limit.

    A message may be printed a little early, which delays the next message, so that all messages of a topic with exactly
    this rate are printed.
    """

    def __init__(self, max_hz: float | None, now_s: Callable[[], float]) -> None:
        self._max_hz, self._now_s = max_hz, now_s
        self._period_s = 1 / max_hz if max_hz else 0.0
        self._next_s = 0.0
        self._dropped = 0

    def allows(self) -> bool:
        """Return True if a message may be printed now; otherwise count the message as dropped."""
        if self._max_hz is None:
            return True
        now = self._now_s()
        if now < self._next_s - self._period_s * _EARLY:
            self._dropped += 1
            return False
        self._next_s = max(now, self._next_s) + self._period_s
        return True

    def report_dropped(self) -> None:
        """Print a note with the number of dropped messages, if there are any."""
        if self._dropped:
            terminal_output.note(f"dropped {pluralize(self._dropped, 'message')}, as --max-rate is {self._max_hz:g}")


def _message_printer(
    field: Callable[[Any], Any], condition: Callable[[Any], bool], rate_limit: _RateLimit, show: Callable[[Any], None]
) -> Callable[[Any], bool]:
    """Return a function that prints a message if the condition is true for it, and returns the result of the condition.

    A message without a value for the filter or field is skipped; each reason is noted once.
    """
    from rosidl_py_gen.ros_cli.message_expressions import FilterError

    note = terminal_output.OnceNotes()

    def print_message(message: Any) -> bool:
        try:
            if not condition(message):
                return False
            value = field(message)
        except FilterError as error:
            note(f"skipped a message: {error}")
            return False
        if rate_limit.allows():
            show(value)
        return True

    return print_message
