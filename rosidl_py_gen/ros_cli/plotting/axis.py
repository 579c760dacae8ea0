"""Time axis of a plot: seconds since its start, or local date and time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rosidl_py_gen.ros_cli.plotting.lines import Floats, PlotPanel


class DrawnLine(NamedTuple):
    """Line as it is drawn; times are seconds since the start of the plot, or since 1970."""

    label: str
    times: Floats
    values: Floats
    is_steps: bool


class TimeAxis:
    """Time axis that all panels share.

    Args:
        is_wall_clock: local date and time instead of seconds since the start.
        by_stamp: the times are those of the headers, for the label.
        own_starts: each panel starts at 0.
        last_s: draw only this time before the last point.
    """

    def __init__(
        self,
        *,
        is_wall_clock: bool = False,
        by_stamp: bool = False,
        own_starts: bool = False,
        last_s: float | None = None,
    ) -> None:
        self.is_wall_clock, self.last_s = is_wall_clock, last_s
        self._own_starts = own_starts
        self.start_s = 0.0
        """Zero of the axis, seconds since 1970."""
        name = "time of header.stamp" if by_stamp else "time"
        self.label = name if is_wall_clock else f"{name} [s]"

    def begin(self, panels: Sequence[PlotPanel]) -> None:
        """Set the start to the first message of all panels."""
        self.start_s = min((panel.start_s for panel in panels if panel.count), default=0.0)

    def drawn(self, panel: PlotPanel) -> list[DrawnLine]:
        """Return the lines of a panel that have points."""
        zero = 0.0 if self.is_wall_clock else panel.start_s if self._own_starts else self.start_s
        lines = []
        for line in panel.lines:
            times, values = line.points()
            if len(times):
                lines.append(DrawnLine(line.label, times - zero, values, line.is_steps))
        return lines

    def left(self, panels: Sequence[PlotPanel]) -> float | None:
        """Return the left end of the axis for `last_s`; None if the whole time is drawn."""
        ends = [line.times[-1] for panel in panels for line in self.drawn(panel)]
        starts = [line.times[0] for panel in panels for line in self.drawn(panel)]
        if self.last_s is None or not ends or max(ends) - min(starts) < self.last_s:
            return None
        return float(max(ends) - self.last_s)

    @staticmethod
    def dates(times: Floats) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return seconds since 1970 as days in local time, which matplotlib displays as dates."""
        from datetime import datetime

        if not len(times):
            return times
        try:
            offset = datetime.fromtimestamp(float(times[0])).astimezone().utcoffset()
        except (OverflowError, ValueError, OSError):
            offset = None
        seconds = times + (offset.total_seconds() if offset else 0.0)
        return np.asarray(seconds / 86400.0)
