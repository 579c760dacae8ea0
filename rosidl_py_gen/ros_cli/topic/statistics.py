"""Statistics of ``topic hz``, ``bw`` and ``delay``, and their text.

Times are integer ns. They are computed from the last `window` values; a jump back in time starts a new window.
"""

from __future__ import annotations

from collections import deque
from math import inf
from time import time_ns
from typing import Any

import numpy as np

from rosidl_py_gen.base.stamps import NS_PER_S

HEADINGS = {
    "hz": ("rate", "min_delta", "max_delta", "std_dev", "window"),
    "bw": ("bandwidth", "mean", "min", "max", "window"),
    "delay": ("delay", "min", "max", "std_dev", "window"),
}
"""Headings of the columns that `report_row` returns, by kind of statistics."""


class TopicStatistics:
    """Statistics of the messages of one topic.

    Args:
        kind: ``hz`` (times between messages), ``bw`` (their sizes) or ``delay`` (their age at arrival).
    """

    def __init__(self, kind: str, window: int) -> None:
        self._kind = kind
        self._samples: deque[tuple[int, int]] = deque(maxlen=window)  # time of arrival, value
        self._last_ns = 0
        self._is_new = False

    def add(self, received_ns: int, value: int) -> None:
        """Add a message that was received at `received_ns`; `value` is its size for ``bw``, its stamp for ``delay``."""
        if received_ns < self._last_ns:
            self._samples.clear()
            self._last_ns = 0
        if self._kind != "hz":
            self._samples.append((received_ns, value if self._kind == "bw" else received_ns - value))
        elif self._last_ns:
            self._samples.append((received_ns, received_ns - self._last_ns))
        self._last_ns, self._is_new = received_ns, True

    def report(self) -> dict[str, float] | None:
        """Return the statistics since the last report.

        Returns None if no message arrived since then, or too few for statistics. The bandwidth decreases after the last
        message, and needs two messages.
        """
        is_new, self._is_new = self._is_new, False
        if self._kind == "bw":
            return self._bandwidth() if len(self._samples) > 1 else None
        return self._spread() if is_new and self._samples else None

    def _bandwidth(self) -> dict[str, float]:
        sizes = np.fromiter((size for _, size in self._samples), np.int64)
        took_ns = max(1, time_ns() - self._samples[0][0])
        bytes_per_s = float(sizes.sum()) * NS_PER_S / took_ns
        spread = {"mean": float(sizes.mean()), "min": int(sizes.min()), "max": int(sizes.max())}
        return {"bytes_per_s": bytes_per_s, **spread, "window": len(sizes)}

    def _spread(self) -> dict[str, float]:
        times = np.fromiter((value for _, value in self._samples), np.int64) / NS_PER_S
        spread = {"min": float(times.min()), "max": float(times.max()), "std_dev": float(times.std())}
        mean_s = float(times.mean())
        if self._kind == "delay":
            return {"delay": mean_s, **spread, "window": len(times)}
        # Messages that were received together have no measurable rate.
        return {"rate": 1 / mean_s if mean_s else inf, **spread, "window": len(times)}


def report_text(report: dict[str, Any]) -> str:
    """Return a report as text, in the form that ros2 prints."""
    if "bytes_per_s" in report:
        rate, mean, minimum, maximum, window = report_row(report)
        return f"{rate} from {window} messages\n\tMessage size mean: {mean} min: {minimum} max: {maximum}"
    name = next(iter(report))
    times = "min: {min:.3f}s max: {max:.3f}s std dev: {std_dev:.5f}s window: {window}".format_map(report)
    return f"average {name}: {report[name]:.3f}\n\t{times}"


def report_row(report: dict[str, Any]) -> list[str]:
    """Return a report as the columns of a table, in which all sizes have the same unit."""
    first, *values = report.values()
    if "bytes_per_s" not in report:
        minimum, maximum, std_dev, window = values
        return [f"{first:.3f}", f"{minimum:.3f}", f"{maximum:.3f}", f"{std_dev:.5f}", str(window)]
    unit, factor, digits = "B", 1, 0
    if first >= 1000:
        unit, factor, digits = ("KB", 1000, 2) if first < 1_000_000 else ("MB", 1_000_000, 2)
    bandwidth, *sizes = (f"{value / factor:.{digits}f} {unit}" for value in (first, *values[:-1]))
    return [f"{bandwidth}/s", *sizes, str(values[-1])]
