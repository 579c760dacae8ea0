"""What time it is for those who meet."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class ClockFunctions:
    """Where the time of a transport's nodes comes from: of this machine, or of a test that lets time pass at will.

    Attributes:
        system_ns: nanoseconds since the epoch.
        steady_ns: nanoseconds since some moment; never goes back. The event loop's `time` has to pass as this does.
    """

    system_ns: Callable[[], int] = time.time_ns
    steady_ns: Callable[[], int] = time.monotonic_ns


SYSTEM_CLOCKS = ClockFunctions()
"""The clocks of this machine."""
