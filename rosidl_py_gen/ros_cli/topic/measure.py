"""``topic hz``, ``bw`` and ``delay``: figures of one or several topics, once a second.

Decides what is received: the bytes of messages, best effort, which every publisher offers. Messages are decoded only
where a filter, or a header that is not their first field, needs it. What is computed is in `topic/statistics.py`.
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
from rosidl_py_gen.ros_cli import AsyncCommand, ToolError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
    from rosidl_py_gen.ros_cli.topic.statistics import TopicStatistics
    from rosidl_py_gen.runtime import Subscription


F = TypeVar("F", bound=Callable[..., Any])

_EVERY_S = 1.0
_DEPTH = 1000
_TABLE_COLUMNS = 72
_HEADER = "std_msgs/msg/Header"
_Value = Callable[[Any], "int | None"]


@dataclass(frozen=True, slots=True)
class _TopicMeter:
    """One topic: where messages come from, what is taken of each (None: it does not count), and the figures."""

    topic: str
    subscription: Subscription[Any]
    value: _Value
    figures: TopicStatistics

    async def feed(self) -> None:
        """Take messages in, for ever."""
        receive, value, add = self.subscription.receive_with_info, self.value, self.figures.add
        while True:
            message, info = await receive()
            if (found := value(message)) is not None:
                add(info.received_timestamp_ns, found)


def _meter_options(window: int) -> Callable[[F], F]:
    """Arguments and options of the commands that measure."""

    def add(command: F) -> F:
        for option in reversed(
            (
                options.topic_argument("topics", nargs=-1, required=True),
                click.option(
                    "-w",
                    "--window",
                    type=click.IntRange(2),
                    default=window,
                    show_default=True,
                    metavar="N",
                    help="How many messages count.",
                ),
                click.option("-n", "--times", type=click.IntRange(1), metavar="N", help="End after N reports."),
                options.topic_timeout,
                options.paths,
                options.as_json,
                options.node_options,
            )
        ):
            command = option(command)
        return command

    return add


def _measuring(network: NetworkOptions, times: int | None, **arguments: Any) -> AsyncCommand:
    return AsyncCommand(_measure(network, times=times, **arguments), endless=times is None)


@click.command("hz")
@_meter_options(10000)
@click.option("--filter", "filter_text", metavar="EXPR", help="Count only messages m for which this holds.")
@verb
def hz(**arguments: Any) -> AsyncCommand:
    """Print how often messages arrive.

    \b
    rosidl-py topic hz /scan
    rosidl-py topic hz /scan /odom --json
    """
    return _measuring(kind="hz", **arguments)


@click.command("bw")
@_meter_options(100)
@verb
def bw(**arguments: Any) -> AsyncCommand:
    """Print how many bytes per second arrive.

    \b
    rosidl-py topic bw /camera/image_raw
    """
    return _measuring(kind="bw", **arguments)


@click.command("delay")
@_meter_options(10000)
@verb
def delay(**arguments: Any) -> AsyncCommand:
    """Print how old messages are when they arrive, by the stamp in their headers.

    \b
    rosidl-py topic delay /scan
    """
    return _measuring(kind="delay", **arguments)


async def _measure(
    network: NetworkOptions,
    kind: str,
    topics: tuple[str, ...],
    window: int,
    times: int | None,
    timeout_s: float | None,
    paths: tuple[str, ...],
    as_json: bool,
    filter_text: str | None = None,
) -> int:
    from rosidl_py_gen.ros_cli import types
    from rosidl_py_gen.ros_cli.command_node import CommandNode, first_of
    from rosidl_py_gen.ros_cli.name_lookup import find_topic
    from rosidl_py_gen.ros_cli.topic.statistics import BandwidthStatistics, DelayStatistics, RateStatistics
    from rosidl_py_gen.runtime import qos as presets

    kinds: dict[str, type[TopicStatistics]] = {
        "hz": RateStatistics,
        "bw": BandwidthStatistics,
        "delay": DelayStatistics,
    }
    async with CommandNode(network) as session:
        meters = []
        for topic in topics:
            name = await find_topic(session, topic, timeout_s)
            cls, value = await _value_extractor(session, name, kind, paths, filter_text)
            raw: Any = cls is None
            subscription: Subscription[Any] = session.node.create_subscription(
                cls or types.opaque_class(session, name), name, qos=presets.SENSOR_DATA.keep_last(_DEPTH), raw=raw
            )
            meters.append(_TopicMeter(name, subscription, value, kinds[kind](window)))
            if not as_json and (kind == "bw" or len(topics) > 1):
                terminal_output.line(f"Subscribed to [{name}]")
        await first_of(_report(meters, times, as_json), *(meter.feed() for meter in meters))
    return 0


async def _report(meters: Sequence[_TopicMeter], times: int | None, as_json: bool) -> None:
    import asyncio

    silent = False
    while times is None or times > 0:
        await asyncio.sleep(_EVERY_S)
        reports = [(meter, report) for meter in meters if (report := meter.figures.report()) is not None]
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
                terminal_output.block(meter.figures.text(report))
        elif reports:
            rows = [[meter.topic, *meter.figures.row(report)] for meter, report in reports]
            terminal_output.table(rows, "topic", *meters[0].figures.HEADINGS)
        if times is not None and reports:
            times -= 1


def _is_narrow() -> bool:
    """Whether a table would break its numbers."""
    return sys.stdout.isatty() and shutil.get_terminal_size().columns < _TABLE_COLUMNS


async def _value_extractor(
    session: CommandNode, topic: str, kind: str, paths: Sequence[str], filter_text: str | None
) -> tuple[type[Message] | None, _Value]:
    """The class to decode messages with, None to leave them as bytes, and what is taken of each."""
    from rosidl_py_gen.ros_cli import types
    from rosidl_py_gen.ros_cli.message_expressions import compile_filter

    if filter_text is not None:
        cls = await types.message_class(session, topic, paths=paths)
        return cls, _where(compile_filter(filter_text, cls))
    if kind != "delay":
        return None, len
    cls = await types.message_class(session, topic, paths=paths)
    headers = [field.py_name for field in cls._TYPE.fields if str(field.type) == _HEADER and field.ros_name == "header"]
    if not headers:
        raise ToolError(f"messages of {topic} have no header with a stamp: {cls._TYPE.name}")
    return (None, _first_stamp) if cls._TYPE.fields[0].ros_name == "header" else (cls, _stamp)


def _where(condition: Callable[[Message], bool]) -> _Value:
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
    """The stamp at the beginning of a serialized message; byte 1 of it tells the byte order."""
    if len(data) < 12:
        return None
    sec, nanosec = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(sec) * NS_PER_S + int(nanosec)
