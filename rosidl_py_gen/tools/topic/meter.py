"""``topic hz``, ``bw`` and ``delay``: figures of one or several topics, once a second.

Decides what is received: the bytes of messages, best effort, which every publisher offers. Messages are decoded only
where a filter, or a header that is not their first field, needs it. What is computed is in `topic/figures.py`.
"""

from __future__ import annotations

import asyncio
import shutil
import struct
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rosidl_py_gen.base.stamps import NS_PER_S, stamp_ns
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.runtime import Subscription
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools import Job, ToolError, printing, types
from rosidl_py_gen.tools.commands.topic import MeterOptions
from rosidl_py_gen.tools.filters import FilterError, compile_filter
from rosidl_py_gen.tools.names import find_topic
from rosidl_py_gen.tools.session import Network, Session, first_of
from rosidl_py_gen.tools.topic.figures import Bandwidth, Delay, Figures, Rate

_EVERY_S = 1.0
_DEPTH = 1000
_TABLE_COLUMNS = 72
_HEADER = "std_msgs/msg/Header"
_KINDS: dict[str, type[Figures]] = {"hz": Rate, "bw": Bandwidth, "delay": Delay}
_Value = Callable[[Any], "int | None"]


@dataclass(frozen=True, slots=True)
class _Meter:
    """One topic: where messages come from, what is taken of each (None: it does not count), and the figures."""

    topic: str
    subscription: Subscription[Any]
    value: _Value
    figures: Figures

    async def feed(self) -> None:
        """Take messages in, for ever."""
        receive, value, add = self.subscription.receive_with_info, self.value, self.figures.add
        while True:
            message, info = await receive()
            if (found := value(message)) is not None:
                add(info.received_timestamp_ns, found)


def run(network: Network, kind: str, options: MeterOptions) -> Job:
    """What the command does."""
    return Job(_measure(network, kind, options), endless=options.times is None)


async def _measure(network: Network, kind: str, options: MeterOptions) -> int:
    async with Session(network) as session:
        meters = []
        for topic in options.topics:
            name = await find_topic(session, topic, options.timeout_s)
            cls, value = await _taken(session, name, kind, options.paths, options.filter_text)
            raw: Any = cls is None
            subscription: Subscription[Any] = session.node.create_subscription(
                cls or types.opaque_class(session, name), name, qos=presets.SENSOR_DATA.keep_last(_DEPTH), raw=raw
            )
            meters.append(_Meter(name, subscription, value, _KINDS[kind](options.window)))
            if not options.as_json and (kind == "bw" or len(options.topics) > 1):
                printing.line(f"Subscribed to [{name}]")
        await first_of(_report(meters, options.times, options.as_json), *(meter.feed() for meter in meters))
    return 0


async def _report(meters: Sequence[_Meter], times: int | None, as_json: bool) -> None:
    silent = False
    while times is None or times > 0:
        await asyncio.sleep(_EVERY_S)
        reports = [(meter, report) for meter in meters if (report := meter.figures.report()) is not None]
        if not reports and not silent:
            printing.note("no new messages")
        silent = not reports
        if as_json:
            for meter, report in reports:
                printing.document({"topic": meter.topic, **report}, in_stream=True)
        elif len(meters) == 1 or _is_narrow():
            for meter, report in reports:
                if len(meters) > 1:
                    printing.line(meter.topic)
                printing.block(meter.figures.text(report))
        elif reports:
            rows = [[meter.topic, *meter.figures.row(report)] for meter, report in reports]
            printing.table(rows, "topic", *meters[0].figures.HEADINGS)
        if times is not None and reports:
            times -= 1


def _is_narrow() -> bool:
    """Whether a table would break its numbers."""
    return sys.stdout.isatty() and shutil.get_terminal_size().columns < _TABLE_COLUMNS


# ----------------------------------------------------------------------------------------------- what is taken of each


async def _taken(
    session: Session, topic: str, kind: str, paths: Sequence[str], filter_text: str | None
) -> tuple[type[Message] | None, _Value]:
    """The class to decode messages with, None to leave them as bytes, and what is taken of each."""
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
