"""Clock functions that all nodes of a transport share."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class ClockFunctions:
    """Clocks of a transport: those of this machine, or those of a test with virtual time.

    Attributes:
        system_ns: nanoseconds since the epoch.
        steady_ns: nanoseconds of a monotonic clock. The event loop's `time` must run at the same speed.
    """

    system_ns: Callable[[], int] = time.time_ns
    steady_ns: Callable[[], int] = time.monotonic_ns


SYSTEM_CLOCKS = ClockFunctions()
"""Clocks of this machine."""
