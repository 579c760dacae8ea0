"""Statistics of ``topic hz``, ``bw`` and ``delay``, and their text.

Times are integer ns. They are computed from the last `window` values; a jump back in time starts a new window.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from math import inf
from time import time_ns
from typing import Any, ClassVar

import numpy as np

from rosidl_py_gen.base.stamps import NS_PER_S


class TopicStatistics(ABC):
    """Statistics of the messages of one topic."""

    HEADINGS: ClassVar[tuple[str, ...]]

    def __init__(self, window: int) -> None:
        self._window = window
        self._values: deque[int] = deque(maxlen=window)
        self._last_ns = 0
        self._is_new = False

    def add(self, received_ns: int, value: int) -> None:
        """Add a message; the subclass defines its value."""
        if received_ns < self._last_ns:
            self.reset()
        self.add_value(received_ns, value)
        self._last_ns, self._is_new = received_ns, True

    def reset(self) -> None:
        """Remove all values."""
        self._values.clear()
        self._last_ns = 0

    @abstractmethod
    def add_value(self, received_ns: int, value: int) -> None:
        """Store the value of a message."""

    def report(self) -> dict[str, float] | None:
        """Return the statistics; None if no message arrived since the last report, or too few did."""
        is_new, self._is_new = self._is_new, False
        return self.computed() if is_new and self._values else None

    @abstractmethod
    def computed(self) -> dict[str, float]:
        """Return the statistics of the stored values."""

    @abstractmethod
    def text(self, report: dict[str, Any]) -> str:
        """Return the text of a report in the form of ros2."""

    @abstractmethod
    def row(self, report: dict[str, Any]) -> list[str]:
        """Return the columns of a report."""


class _SpreadStatistics(TopicStatistics):
    """Statistics of times in ns: mean, minimum, maximum and standard deviation in seconds."""

    NAME: ClassVar[str]

    def spread(self) -> dict[str, float]:
        """Return the statistics of the stored values."""
        values = np.fromiter(self._values, np.int64) / NS_PER_S
        return {
            "mean": float(values.mean()),
            "min": float(values.min()),
            "max": float(values.max()),
            "std_dev": float(values.std()),
            "window": len(values),
        }

    def text(self, report: dict[str, Any]) -> str:
        times = "min: {min:.3f}s max: {max:.3f}s std dev: {std_dev:.5f}s window: {window}".format_map(report)
        return f"average {self.NAME}: {report[self.NAME]:.3f}\n\t{times}"

    def row(self, report: dict[str, Any]) -> list[str]:
        times = [f"{report[name]:.3f}" for name in (self.NAME, "min", "max")]
        return [*times, f"{report['std_dev']:.5f}", str(report["window"])]


class RateStatistics(_SpreadStatistics):
    """Rate of messages; the values are the times between them."""

    HEADINGS = ("rate", "min_delta", "max_delta", "std_dev", "window")
    NAME = "rate"

    def add_value(self, received_ns: int, value: int) -> None:
        if self._last_ns:
            self._values.append(received_ns - self._last_ns)

    def computed(self) -> dict[str, float]:
        spread = self.spread()
        mean_s = spread.pop("mean")
        # Messages that were received together have no measurable rate.
        return {"rate": 1 / mean_s if mean_s else inf, **spread}


class DelayStatistics(_SpreadStatistics):
    """Age of messages at their arrival; the values are ``header.stamp``."""

    HEADINGS = ("delay", "min", "max", "std_dev", "window")
    NAME = "delay"

    def add_value(self, received_ns: int, value: int) -> None:
        self._values.append(received_ns - value)

    def computed(self) -> dict[str, float]:
        spread = self.spread()
        return {"delay": spread.pop("mean"), **spread}


class BandwidthStatistics(TopicStatistics):
    """Received bytes; the values are the sizes of messages."""

    HEADINGS = ("bandwidth", "mean", "min", "max", "window")

    def __init__(self, window: int) -> None:
        super().__init__(window)
        self._times: deque[int] = deque(maxlen=window)

    def reset(self) -> None:
        super().reset()
        self._times.clear()

    def add_value(self, received_ns: int, value: int) -> None:
        self._values.append(value)
        self._times.append(received_ns)

    def report(self) -> dict[str, float] | None:
        """Return None with less than two messages; after the last message the bandwidth decreases."""
        return self.computed() if len(self._values) > 1 else None

    def computed(self) -> dict[str, float]:
        sizes = np.fromiter(self._values, np.int64)
        took_ns = max(1, time_ns() - self._times[0])
        return {
            "bytes_per_s": float(sizes.sum()) * NS_PER_S / took_ns,
            "mean": float(sizes.mean()),
            "min": int(sizes.min()),
            "max": int(sizes.max()),
            "window": len(sizes),
        }

    def text(self, report: dict[str, Any]) -> str:
        rate, mean, minimum, maximum, window = self.row(report)
        return f"{rate} from {window} messages\n\tMessage size mean: {mean} min: {minimum} max: {maximum}"

    def row(self, report: dict[str, Any]) -> list[str]:
        unit, factor, digits = _unit(report["bytes_per_s"])
        bandwidth, *sizes = (
            f"{report[name] / factor:.{digits}f} {unit}" for name in ("bytes_per_s", "mean", "min", "max")
        )
        return [f"{bandwidth}/s", *sizes, str(report["window"])]


def _unit(bytes_per_s: float) -> tuple[str, int, int]:
    """Return the unit for all numbers of a line: its name, its bytes, and the number of decimals."""
    if bytes_per_s < 1000:
        return "B", 1, 0
    return ("KB", 1000, 2) if bytes_per_s < 1_000_000 else ("MB", 1_000_000, 2)
