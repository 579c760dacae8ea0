"""What ``topic hz``, ``bw`` and ``delay`` compute from the last messages of a topic, and the words for it.

Times are integer ns. The last `window` values count; time that goes back begins a new window.
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
    """Values of the messages of one topic."""

    HEADINGS: ClassVar[tuple[str, ...]]

    def __init__(self, window: int) -> None:
        self._window = window
        self._values: deque[int] = deque(maxlen=window)
        self._last_ns = 0
        self._is_new = False

    def add(self, received_ns: int, value: int) -> None:
        """Take in a message; what `value` is, each kind says."""
        if received_ns < self._last_ns:
            self.reset()
        self.add_value(received_ns, value)
        self._last_ns, self._is_new = received_ns, True

    def reset(self) -> None:
        """Forget all messages."""
        self._values.clear()
        self._last_ns = 0

    @abstractmethod
    def add_value(self, received_ns: int, value: int) -> None:
        """Keep what a message adds."""

    def report(self) -> dict[str, float] | None:
        """The figures; None when no message came since the last report, or not enough to tell."""
        is_new, self._is_new = self._is_new, False
        return self.computed() if is_new and self._values else None

    @abstractmethod
    def computed(self) -> dict[str, float]:
        """The figures of the values there are."""

    @abstractmethod
    def text(self, report: dict[str, Any]) -> str:
        """The figures of one topic in the form of ros2."""

    @abstractmethod
    def row(self, report: dict[str, Any]) -> list[str]:
        """The figures as columns, for several topics."""


class RateStatistics(TopicStatistics):
    """How often messages arrive; the values are the times between them."""

    HEADINGS = ("rate", "min_delta", "max_delta", "std_dev", "window")

    def add_value(self, received_ns: int, value: int) -> None:
        if self._last_ns:
            self._values.append(received_ns - self._last_ns)

    def computed(self) -> dict[str, float]:
        spread = _spread(self._values)
        mean_s = spread.pop("mean")
        # Messages that were received together have no measurable rate.
        return {"rate": 1 / mean_s if mean_s else inf, **spread}

    def text(self, report: dict[str, Any]) -> str:
        return "average rate: {rate:.3f}\n\t".format_map(report) + _SPREAD.format_map(report)

    def row(self, report: dict[str, Any]) -> list[str]:
        return [f"{report['rate']:.3f}", *_columns(report)]


class DelayStatistics(TopicStatistics):
    """How old messages are when they arrive; the values are ``header.stamp``."""

    HEADINGS = ("delay", "min", "max", "std_dev", "window")

    def add_value(self, received_ns: int, value: int) -> None:
        self._values.append(received_ns - value)

    def computed(self) -> dict[str, float]:
        spread = _spread(self._values)
        return {"delay": spread.pop("mean"), **spread}

    def text(self, report: dict[str, Any]) -> str:
        return "average delay: {delay:.3f}\n\t".format_map(report) + _SPREAD.format_map(report)

    def row(self, report: dict[str, Any]) -> list[str]:
        return [f"{report['delay']:.3f}", *_columns(report)]


class BandwidthStatistics(TopicStatistics):
    """How many bytes arrive; the values are the sizes of messages."""

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
        """None when there are less than two messages; else a topic that fell silent shows less and less."""
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
        rate, mean, least, most, window = self.row(report)
        return f"{rate} from {window} messages\n\tMessage size mean: {mean} min: {least} max: {most}"

    def row(self, report: dict[str, Any]) -> list[str]:
        unit, factor, digits = _unit(report["bytes_per_s"])
        bandwidth, *sizes = (
            f"{report[name] / factor:.{digits}f} {unit}" for name in ("bytes_per_s", "mean", "min", "max")
        )
        return [f"{bandwidth}/s", *sizes, str(report["window"])]


_SPREAD = "min: {min:.3f}s max: {max:.3f}s std dev: {std_dev:.5f}s window: {window}"


def _spread(values_ns: deque[int]) -> dict[str, float]:
    """In seconds."""
    values = np.fromiter(values_ns, np.int64) / NS_PER_S
    return {
        "mean": float(values.mean()),
        "min": float(values.min()),
        "max": float(values.max()),
        "std_dev": float(values.std()),
        "window": len(values),
    }


def _columns(report: dict[str, Any]) -> list[str]:
    return [f"{report['min']:.3f}", f"{report['max']:.3f}", f"{report['std_dev']:.5f}", str(report["window"])]


def _unit(bytes_per_s: float) -> tuple[str, int, int]:
    """One unit for all figures of a line: its name, its bytes, and digits behind the point."""
    if bytes_per_s < 1000:
        return "B", 1, 0
    return ("KB", 1000, 2) if bytes_per_s < 1_000_000 else ("MB", 1_000_000, 2)
