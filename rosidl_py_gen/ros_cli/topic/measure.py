"""Commands ``topic hz``, ``bw`` and ``delay``: statistics of one or several topics, once a second.

The subscriptions are best effort, which is compatible with every publisher, and receive bytes. Messages are decoded
only for a filter, or for a header that is not their first field. `topic/statistics.py` computes the statistics.
"""

from __future__ import annotations

import shutil
import struct
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen.base.stamps import NS_PER_S, stamp_ns
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.ros_cli.topic.statistics import TopicStatistics
    from rosidl_py_gen.runtime import Subscription


F = TypeVar("F", bound=Callable[..., Any])

_REPORT_INTERVAL_S = 1.0
_DEPTH = 1000
_TABLE_COLUMNS = 72
_Value = Callable[[Any], "int | None"]


@dataclass(frozen=True, slots=True)
class _TopicMeter:
    """Subscription to one topic with its statistics; messages for which `value` returns None do not count."""

    topic: str
    subscription: Subscription[Any]
    value: _Value
    statistics: TopicStatistics

    async def run(self) -> None:
        """Add received messages to the statistics until cancelled."""
        receive, value, add = self.subscription.receive_with_info, self.value, self.statistics.add
        while True:
            message, info = await receive()
            if (number := value(message)) is not None:
                add(info.received_timestamp_ns, number)


def _meter_options(window: int) -> Callable[[F], F]:
    return options.all_of(
        options.topic_argument("topics", nargs=-1, required=True),
        options.window(window),
        options.report_count,
        options.topic_timeout,
        options.paths,
        options.as_json,
    )


_node_verb = options.endless_node_verb(lambda arguments: arguments["times"] is None)


@click.command("hz")
@_meter_options(10000)
@click.option("--filter", "filter_text", metavar="EXPR", help="Count only messages m for which EXPR is true.")
@_node_verb
async def hz(**arguments: Any) -> None:
    """Print the rate of messages.

    \b
    rosidl-py topic hz /scan
    rosidl-py topic hz /scan /odom --json
    """
    await _measure(kind="hz", **arguments)


@click.command("bw")
@_meter_options(100)
@_node_verb
async def bw(**arguments: Any) -> None:
    """Print the received bytes per second.

    \b
    rosidl-py topic bw /camera/image_raw
    """
    await _measure(kind="bw", **arguments)


@click.command("delay")
@_meter_options(10000)
@_node_verb
async def delay(**arguments: Any) -> None:
    """Print the age of messages at their arrival, by the stamp in their headers.

    \b
    rosidl-py topic delay /scan
    """
    await _measure(kind="delay", **arguments)


async def _measure(
    command_node: CommandNode,
    kind: str,
    topics: tuple[str, ...],
    window: int,
    times: int | None,
    timeout_s: float | None,
    paths: tuple[str, ...],
    as_json: bool,
    filter_text: str | None = None,
) -> None:
    from rosidl_py_gen.command_support import first_of, opaque_class
    from rosidl_py_gen.ros_cli.topic.statistics import TopicStatistics
    from rosidl_py_gen.runtime import qos as presets

    meters = []
    for topic in topics:
        name = await command_node.find("topic", topic, timeout_s)
        cls, value = await _value_extractor(command_node, name, kind, paths, filter_text)
        raw: Any = cls is None
        subscription: Subscription[Any] = command_node.node.create_subscription(
            cls or opaque_class(command_node, name),
            name,
            qos=presets.SENSOR_DATA.keep_last(_DEPTH),
            raw=raw,
        )
        meters.append(_TopicMeter(name, subscription, value, TopicStatistics(kind, window)))
        if not as_json and (kind == "bw" or len(topics) > 1):
            terminal_output.line(f"Subscribed to [{name}]")
    await first_of(_report(meters, kind, times, as_json), *(meter.run() for meter in meters))


async def _report(meters: Sequence[_TopicMeter], kind: str, times: int | None, as_json: bool) -> None:
    import asyncio

    from rosidl_py_gen.ros_cli.topic.statistics import HEADINGS, report_row, report_text

    silent = False
    while times is None or times > 0:
        await asyncio.sleep(_REPORT_INTERVAL_S)
        reports = [(meter, report) for meter in meters if (report := meter.statistics.report()) is not None]
        if not reports and not silent:
            terminal_output.note("no new messages")
        silent = not reports
        if as_json:
            for meter, report in reports:
                terminal_output.document({"topic": meter.topic, **report}, in_stream=True)
        elif len(meters) == 1 or _is_narrow():
            for meter, report in reports:
                if len(meters) > 1:
                    terminal_output.line(meter.topic)
                terminal_output.block(report_text(report))
        elif reports:
            rows = [[meter.topic, *report_row(report)] for meter, report in reports]
            terminal_output.table(rows, "topic", *HEADINGS[kind])
        if times is not None and reports:
            times -= 1


def _is_narrow() -> bool:
    return sys.stdout.isatty() and shutil.get_terminal_size().columns < _TABLE_COLUMNS


async def _value_extractor(
    command_node: CommandNode, topic: str, kind: str, paths: Sequence[str], filter_text: str | None
) -> tuple[type[Message] | None, _Value]:
    """Return the class with which messages are decoded (None: use bytes), and a function for the value that is
    measured.
    """
    from rosidl_py_gen.command_support import interface_class, require_stamp
    from rosidl_py_gen.ros_cli.message_expressions import compile_filter

    if filter_text is not None:
        cls = await interface_class(command_node, "topic", topic, paths=paths)
        return cls, _zero_if(compile_filter(filter_text, cls))
    if kind != "delay":
        return None, len
    cls = await interface_class(command_node, "topic", topic, paths=paths)
    require_stamp(topic, cls)
    return (None, _first_stamp) if cls._TYPE.fields[0].ros_name == "header" else (cls, _stamp)


def _zero_if(condition: Callable[[Message], bool]) -> _Value:
    from rosidl_py_gen.ros_cli.message_expressions import FilterError

    def value(message: Message) -> int | None:
        try:
            return 0 if condition(message) else None
        except FilterError:
            return None

    return value


def _stamp(message: Any) -> int:
    return stamp_ns(message.header.stamp)


def _first_stamp(data: bytes) -> int | None:
    """Return the stamp in ns at the beginning of a serialized message; None if the message is too short."""
    if len(data) < 12:
        return None
    # Byte 1 of the encapsulation header contains the byte order.
    sec, nanosec = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(sec) * NS_PER_S + int(nanosec)
