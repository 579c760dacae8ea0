"""``topic echo``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, ToolError, options, terminal_output, verb
from rosidl_py_gen.ros_cli.topic import qos as topic_qos

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
    from rosidl_py_gen.ros_cli.topic.formats import Style
    from rosidl_py_gen.runtime import AdaptiveSubscription


_LOST_EVERY_S = 1.0
_EARLY = 0.25
"""Of the period of ``--max-rate``: so much earlier than due a message is printed."""


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
    help="Print only a field: pose.position, poses[0].x, ranges[0:5]. May be repeated.",
)
@click.option("--filter", "filter_text", metavar="EXPR", help="Print only messages m for which this holds.")
@click.option(
    "--max-rate",
    "max_rate_hz",
    type=click.FloatRange(0, min_open=True),
    metavar="HZ",
    help="Print at most so many messages a second, drop the others, and say at the end how many.",
)
@click.option("--csv", "style", flag_value="csv", help="Print all values of a message on a line.")
@click.option("--json", "style", flag_value="json", help="Print a line of JSON for each message, nothing cut.")
@click.option("--flow-style", "style", flag_value="flow", help="Print a line of YAML for each message.")
@click.option("--raw", is_flag=True, help="Print the bytes of messages; needs no definition.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@click.option(
    "-l", "--truncate-length", type=click.IntRange(0), metavar="N", help="Cut arrays and strings here.  [default: 128]"
)
@click.option("--no-arr", "arrays", is_flag=True, flag_value=False, default=True, help="Print no elements of arrays.")
@click.option("--no-str", "strings", is_flag=True, flag_value=False, default=True, help="Print no strings.")
@click.option(
    "--no-lost-messages",
    "lost_messages",
    is_flag=True,
    flag_value=False,
    default=True,
    help="Do not tell when messages come faster than they are printed.",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0),
    metavar="SECONDS",
    help="How long to wait for the topic, 5 if not given, and for a message, without end if not given.",
)
@topic_qos.qos_options
@options.paths
@options.node_options
@verb
def echo(
    network: NetworkOptions,
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
) -> AsyncCommand:
    """Print the messages of a topic.

    \b
    rosidl-py topic echo /chatter
    rosidl-py topic echo /odom --field pose.pose.position --csv
    rosidl-py topic echo /rosout --filter 'm.level >= 30 and "lidar" in m.name'

    Without --qos-... options, it asks for what all publishers offer. In --filter there are comparisons, arithmetic, and
    or not in, abs all any bool float int isfinite isinf isnan len max min round sqrt sum, and
    any(x < 1 for x in m.ranges).
    """
    from rosidl_py_gen.ros_cli import types
    from rosidl_py_gen.ros_cli.command_node import CommandNode, now_s
    from rosidl_py_gen.ros_cli.message_expressions import compile_filter
    from rosidl_py_gen.ros_cli.name_lookup import find_topic, full_topic_name
    from rosidl_py_gen.ros_cli.topic.formats import Format
    from rosidl_py_gen.runtime import AdaptiveSubscription, WaitTimeoutError
    from rosidl_py_gen.runtime import qos as presets

    pace = _RateLimit(max_rate_hz, now_s)

    async def main() -> int:
        async with CommandNode(network) as session:
            naming = full_name(session)
            name = await (naming if raw else types.preload_while_waiting(naming))
            printer = Format(style or "yaml", full_length, truncate_length, arrays, strings).printer()
            cls: Any
            if raw:
                cls = types.opaque_class(session, name, type_name)
                show = _shows(lambda value: value, lambda value: True, pace, printer)
            else:
                cls = await types.message_class(session, name, type_name, paths)
                field = _fields(cls, fields, arrays)
                condition = compile_filter(filter_text, cls) if filter_text else lambda value: True
                show = _shows(field, condition, pace, printer)
            given = topic_qos.given(qos, presets.SENSOR_DATA)
            following: AdaptiveSubscription[Any] = AdaptiveSubscription(
                session.node, name, cls, raw=raw, qos=given, note=terminal_output.note
            )
            async with following as messages:
                try:
                    await print_from(messages, name, show)
                finally:
                    pace.tell()
        return 0

    async def full_name(session: CommandNode) -> str:
        """The full name of the topic, once its publishers had time to be seen."""
        if type_name is None:
            return await find_topic(session, topic, timeout_s)
        name = full_topic_name(session, topic)
        await session.wait_for_discovery()
        return name

    async def print_from(messages: AdaptiveSubscription[Any], name: str, show: Callable[[Any], bool]) -> None:
        lost, has_received, shown_at = _Lost(now_s), False, now_s()
        while True:
            left_s = None if timeout_s is None else max(0.0, shown_at + timeout_s - now_s())
            try:
                message, _ = await messages.receive_with_info(left_s)
            except WaitTimeoutError as error:
                text = f"on {name} in {timeout_s:g} s"
                if filter_text and has_received:
                    raise ToolError(f"no message that the filter lets through {text}") from None
                raise ToolError(f"no message {text}: {error.reason}") from None
            has_received = True
            if show(message):
                shown_at = now_s()
                if once:
                    return
            if lost_messages:
                lost.note(messages.dropped)

    return AsyncCommand(main(), endless=not once)


class _Lost:
    """Tells from time to time how many messages came faster than they were printed."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._noted, self._noted_at, self._now_s = 0, 0.0, now_s

    def note(self, total: int) -> None:
        """Print a note if more were lost since the last one, which is a while ago."""
        if total > self._noted and (now := self._now_s()) > self._noted_at + _LOST_EVERY_S:
            terminal_output.note(f"{total - self._noted} messages came faster than they were printed ({total} in all)")
            self._noted, self._noted_at = total, now


def _fields(cls: type[Message], paths: Sequence[str], arrays: bool) -> Callable[[Message], Any]:
    """Return what gives the values to print: the message, the value of one path, or a dict of several."""
    from rosidl_py_gen.base.fieldtype import Arity
    from rosidl_py_gen.ros_cli.message_expressions import compile_path, path_field
    from rosidl_py_gen.ros_cli.message_text import array_summary

    if not paths:
        return lambda message: message

    def one(path: str) -> Callable[[Message], Any]:
        value, field = compile_path(path, cls), None if arrays else path_field(path, cls)
        if field is None or field.type.arity is Arity.SCALAR:
            return value
        return lambda message: array_summary(field, value(message))

    values = {path: one(path) for path in paths}
    if len(values) == 1:
        return values[paths[0]]
    return lambda message: {path: value(message) for path, value in values.items()}


class _RateLimit:
    """Decides which messages are printed when at most `max_hz` a second may be: None for all.

    One may come a little early, at the cost of the next: of a topic that is just as fast, all are printed.
    """

    def __init__(self, max_hz: float | None, now_s: Callable[[], float]) -> None:
        self._max_hz, self._now_s = max_hz, now_s
        self._period_s = 1 / max_hz if max_hz else 0.0
        self._next_s = 0.0
        self._dropped = 0

    def allows(self) -> bool:
        """Whether one may be printed now; counts those that may not."""
        if self._max_hz is None:
            return True
        now = self._now_s()
        if now < self._next_s - self._period_s * _EARLY:
            self._dropped += 1
            return False
        self._next_s = max(now, self._next_s) + self._period_s
        return True

    def tell(self) -> None:
        """Say how many were not printed, if any."""
        if self._dropped:
            terminal_output.note(f"{self._dropped} messages were dropped, as --max-rate is {self._max_hz:g}")


def _shows(
    field: Callable[[Any], Any], condition: Callable[[Any], bool], pace: _RateLimit, show: Callable[[Any], None]
) -> Callable[[Any], bool]:
    """Prints a message that meets the condition, when it is time for one, and says whether it met it.

    What has no value is noted once.
    """
    from rosidl_py_gen.ros_cli.message_expressions import FilterError

    noted: set[str] = set()

    def shows(message: Any) -> bool:
        try:
            if not condition(message):
                return False
            value = field(message)
        except FilterError as error:
            if str(error) not in noted and len(noted) < 10:
                noted.add(str(error))
                terminal_output.note(f"left out a message: {error}")
            return False
        if pace.allows():
            show(value)
        return True

    return shows
