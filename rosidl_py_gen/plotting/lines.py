"""Data of a plot: lines of a bounded number of points, which are filled from fields of messages, and the time axis.

A line stores every point until it has too many. Then it divides its time range into buckets, each about as wide as a
pixel, and retains of each bucket the first, the smallest, the largest and the last point.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from rosidl_py_gen.base.field_columns import Column, FieldPathError
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.stamps import NS_PER_S, stamp_ns
from rosidl_py_gen.command_support import CommandError, require_stamp, terminal_output

Floats: TypeAlias = "np.ndarray[Any, np.dtype[np.float64]]"
BUCKETS = 2000
"""Number of time buckets into which a line's points are reduced. A plot is about 1500 pixels wide; more buckets cost
time without visible effect."""
_MAX_POINTS = 8 * BUCKETS
MAX_ELEMENTS = 20
"""Maximum number of elements of one array that are drawn as lines; more lines could not be distinguished."""
MAX_LINES = 100
_MAX_LISTED = 60
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")


class PlotLine:
    """Line of one number over time. Values that are infinite become NaN, which interrupts the line."""

    def __init__(self, label: str, *, is_steps: bool = False) -> None:
        self.label, self.is_steps = label, is_steps
        self._times, self._values = array("d"), array("d")

    def add(self, time_s: float, value: float) -> None:
        """Add a point to the line."""
        self._times.append(time_s)
        self._values.append(value)
        if len(self._times) >= _MAX_POINTS:
            times, values = reduced(*self.points(), BUCKETS)
            self._times, self._values = array("d", times.tobytes()), array("d", values.tobytes())

    def retain_last(self, duration_s: float) -> None:
        """Remove points that are older than `duration_s`, once the line is longer than 1.25 times `duration_s`."""
        if not self._times or self._times[0] >= self._times[-1] - 1.25 * duration_s:
            return
        times, values = self.points()
        kept = times >= times[-1] - duration_s
        self._times = array("d", times[kept].tobytes())
        self._values = array("d", values[kept].tobytes())

    def points(self) -> tuple[Floats, Floats]:
        """Return times and values of the points in order of time, with NaN for infinite values."""
        times, values = np.array(self._times), np.array(self._values)
        values[~np.isfinite(values)] = np.nan
        if (np.diff(times) < 0).any():
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
        return times, values


def reduced(times: Floats, values: Floats, count: int) -> tuple[Floats, Floats]:
    """Return at most four points of each of `count` buckets of time: the first, smallest, largest and last.

    The times must be in ascending order. A point whose value is NaN is returned only as the first or last one.
    """
    width = (times[-1] - times[0]) / count or 1.0
    buckets = np.minimum((times - times[0]) // width, count - 1)
    starts = np.flatnonzero(np.diff(buckets, prepend=-1.0))
    ends = np.append(starts[1:], len(times)) - 1
    owner = np.repeat(np.arange(len(starts)), ends - starts + 1)
    by_value = np.lexsort((values, owner))  # NaN comes last
    sizes = np.add.reduceat(np.isfinite(values).astype(np.intp), starts)
    smallest = by_value[starts]
    largest = by_value[starts + np.maximum(sizes, 1) - 1]
    chosen = np.unique(np.concatenate((starts, smallest, largest, ends)))
    return times[chosen], values[chosen]


@dataclass(slots=True)
class PlotPanel:
    """Lines of one topic, which share an axis; `start_s` is the time of the first message, in seconds since 1970."""

    title: str
    lines: list[PlotLine] = field(default_factory=list)
    count: int = 0
    start_s: float = 0.0


class TopicLines:
    """Converter that adds the fields of a topic's messages to the lines of a panel.

    Args:
        topic: name for error texts.
        paths: paths of the fields; if empty, the only number that the messages have.
        by_stamp: use the time of ``header.stamp`` instead of the time that is passed to `add`.
        last_s: time before the last point to keep, in seconds; older points may be removed. None to keep all.
    """

    def __init__(
        self,
        panel: PlotPanel,
        topic: str,
        paths: Sequence[str],
        *,
        by_stamp: bool = False,
        last_s: float | None = None,
    ) -> None:
        self.panel = panel
        self._topic, self._paths, self._by_stamp, self._last_s = topic, paths, by_stamp, last_s
        self._note = terminal_output.OnceNotes()
        self._columns: dict[type[Any], list[Column]] = {}
        self._lines: dict[str, PlotLine] = {}

    def use(self, cls: type[Any]) -> None:
        """Prepare to add messages of a class; raises `CommandError` for fields that cannot be drawn."""
        if self._by_stamp:
            require_stamp(self._topic, cls)
        self._columns[cls] = columns = numeric_columns(cls, self._topic, self._paths)
        for column in columns:
            if column.length is None:
                self._line(column, column.name)

    def add(self, message: Any, time_ns: int) -> None:
        """Add the fields of a message, which was received at `time_ns`, to the lines."""
        if type(message) not in self._columns:
            self.use(type(message))
        if self._by_stamp:
            time_ns = stamp_ns(message.header.stamp)
        time_s = time_ns / NS_PER_S
        panel = self.panel
        panel.start_s = time_s if not panel.count else min(panel.start_s, time_s)
        panel.count += 1
        for column in self._columns[type(message)]:
            try:
                value = column.get(message)
            except IndexError:  # a sequence without this element
                continue
            scale = NS_PER_S if column.is_time else 1
            if column.length is None:
                self._lines[column.name].add(time_s, value / scale)
                continue
            for name, element in _elements(column, value, self._note):
                self._line(column, name).add(time_s, element / scale)
        if self._last_s is not None:
            for line in self._lines.values():
                line.retain_last(self._last_s)

    def _line(self, column: Column, name: str) -> PlotLine:
        line = self._lines.get(name)
        if line is None:
            line = self._lines[name] = PlotLine(name, is_steps=column.kind == "bool_")
            self.panel.lines.append(line)
            if len(self.panel.lines) > MAX_LINES:
                raise CommandError(f"{self._topic}: more than {MAX_LINES} lines; name fewer fields")
        return line


def _elements(column: Column, values: Any, note: Callable[[str], object]) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the first 20 elements of an array; print a note if further elements are not drawn."""
    before, _, after = column.name.partition("[") if ":" in column.name else (column.name, "", "]")
    part, _, after = after.partition("]")
    start = part.partition(":")[0].strip()
    first = int(start) if start and not start.startswith("-") else 0
    if len(values) > MAX_ELEMENTS:
        advice = f"{before}[{first + MAX_ELEMENTS}:{first + 2 * MAX_ELEMENTS}]"
        note(f"{column.name}: only the first {MAX_ELEMENTS} elements are drawn; name others, such as {advice}{after}")
    for number, value in enumerate(islice(values, MAX_ELEMENTS), first):
        yield f"{before}[{number}]{after}", value


def numeric_columns(cls: type[Any], topic: str, paths: Sequence[str]) -> list[Column]:
    """Return a column for each number in the fields that `paths` name.

    Texts inside a message are skipped; a path of a text is an error. Raises `CommandError`, whose text lists the
    numeric fields.
    """
    names = list(islice(_numeric_names(cls), _MAX_LISTED + 1))
    listed = ", ".join(names[:_MAX_LISTED]) + (", ..." if len(names) > _MAX_LISTED else "")
    numeric = f"numeric fields of {cls._TYPE.name}: {listed or 'none'}"
    if not paths:
        names = [name for name in names if not name.startswith("header.")]
        if len(names) != 1:
            raise CommandError(f"{topic}: expected a field after the topic; {numeric}")
        paths = names
    found: dict[str, Column] = {}
    for path in paths:
        try:
            columns = Column.of_message(cls, [path])
        except FieldPathError as error:
            reason = str(error).partition("; columns are ")[0].replace("no column", "no field", 1)
            raise CommandError(f"{topic}: {reason}; {numeric}") from None
        numbers = [column for column in columns if column.kind != "U"]
        if not numbers:
            raise CommandError(f"{topic}: {path} has no number, but text; {numeric}")
        found.update((column.name, column) for column in numbers)
    return list(found.values())


def _numeric_names(cls: type[Any], prefix: str = "", depth: int = 0) -> Iterator[str]:
    for one in cls._TYPE.fields:
        name = prefix + one.ros_name + ("" if one.type.arity is Arity.SCALAR else "[0]")
        if one.cls is None:
            if one.type.base not in ("string", "wstring"):
                yield name
        elif one.cls._TYPE.name in _TIMES:
            yield name
        elif depth < 20:
            yield from _numeric_names(one.cls, f"{name}.", depth + 1)


class DrawnLine(NamedTuple):
    """Points of a line in the form in which they are drawn.

    Times are seconds since the start of the plot, or since 1970.
    """

    label: str
    times: Floats
    values: Floats
    is_steps: bool


@dataclass(slots=True, kw_only=True)
class TimeAxis:
    """Time axis that all panels share.

    Attributes:
        is_wall_clock: local date and time instead of seconds since the start.
        by_stamp: the times are header stamps, which the label states.
        own_starts: each panel starts at 0.
        last_s: length of the drawn time before the last point, in seconds; None to draw all.
        start_s: time at which the axis has 0, in seconds since 1970.
    """

    is_wall_clock: bool = False
    by_stamp: bool = False
    own_starts: bool = False
    last_s: float | None = None
    start_s: float = 0.0

    @property
    def label(self) -> str:
        """Name of the axis, with its unit."""
        return ("time of header.stamp" if self.by_stamp else "time") + ("" if self.is_wall_clock else " [s]")

    def begin(self, panels: Sequence[PlotPanel]) -> None:
        """Set the time at which the axis has 0 to the time of the first message in all panels."""
        self.start_s = min((panel.start_s for panel in panels if panel.count), default=0.0)

    def drawn(self, panel: PlotPanel) -> list[DrawnLine]:
        """Return the lines of a panel that have points, with times relative to the 0 of the axis."""
        zero = 0.0 if self.is_wall_clock else panel.start_s if self.own_starts else self.start_s
        lines = []
        for line in panel.lines:
            times, values = line.points()
            if len(times):
                lines.append(DrawnLine(line.label, times - zero, values, line.is_steps))
        return lines

    def left(self, panels: Sequence[PlotPanel]) -> float | None:
        """Return the left end of the time axis if `last_s` limits the drawn time; None if all points are drawn."""
        ends = [line.times[-1] for panel in panels for line in self.drawn(panel)]
        starts = [line.times[0] for panel in panels for line in self.drawn(panel)]
        if self.last_s is None or not ends or max(ends) - min(starts) < self.last_s:
            return None
        return float(max(ends) - self.last_s)

    @staticmethod
    def dates(times: Floats) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Convert seconds since 1970 to days since 1970 in local time, which matplotlib displays as dates."""
        from datetime import datetime

        try:
            offset = datetime.fromtimestamp(float(times[0])).astimezone().utcoffset()
        except (OverflowError, ValueError, OSError):
            offset = None
        seconds = times + (offset.total_seconds() if offset else 0.0)
        return np.asarray(seconds / 86400.0)
