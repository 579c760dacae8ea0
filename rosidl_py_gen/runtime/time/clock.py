"""Clocks: what time it is, and who hears when time jumps.

Decides ROS time: system time until an override is enabled, then whatever was last set, 0 before that. Subscribing to
`/clock` is `node/time.py`. Jump callbacks run on the thread that changes the time, before and after the change.

Source: protocol.md 9.6.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.time.values import ClockType, ClockTypeError, Duration, Time, TimeRangeError

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "Clock",
    "ClockChange",
    "ClockType",
    "ClockTypeError",
    "Duration",
    "JumpHandle",
    "Time",
    "TimeJump",
    "TimeRangeError",
]

_log = logging.getLogger(__name__)


class ClockChange(IntEnum):
    """What happened to the source of a clock; numbers of rcl."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


@dataclass(frozen=True, slots=True)
class TimeJump:
    """One jump; `delta` is 0 when the source changed, because the two zeros have nothing in common."""

    clock_change: ClockChange
    delta: Duration

    @property
    def source_changed(self) -> bool:
        """True when ROS time was activated or deactivated."""
        return self.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)


class JumpHandle:
    """A registered pair of jump callbacks; close it, or use it as a context manager, to stop them."""

    __slots__ = ("_clock", "_matches", "post", "pre")

    def __init__(
        self,
        clock: Clock,
        matches: Callable[[TimeJump], bool],
        pre: Callable[[TimeJump], None] | None,
        post: Callable[[TimeJump], None] | None,
    ) -> None:
        self._clock: Clock | None = clock
        self._matches = matches
        self.pre = pre
        self.post = post

    def matches(self, jump: TimeJump) -> bool:
        """True when the thresholds given at registration select this jump."""
        return self._clock is not None and self._matches(jump)

    def close(self) -> None:
        """Stop the callbacks; may be called twice."""
        clock, self._clock = self._clock, None
        if clock is not None:
            clock._forget(self)

    def __enter__(self) -> JumpHandle:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Clock:
    """One clock. `system_ns` and `steady_ns` replace the machine's clocks, for tests."""

    def __init__(
        self,
        clock_type: ClockType = ClockType.ROS_TIME,
        *,
        system_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.clock_type = ClockType(clock_type)
        self._source_ns = steady_ns if self.clock_type is ClockType.STEADY_TIME else system_ns
        self._override_ns = 0
        self._active = False
        self._handles: list[JumpHandle] = []

    def __repr__(self) -> str:
        state = ", overridden" if self._active else ""
        return f"Clock({self.clock_type.name}{state})"

    def now(self) -> Time:
        """The time now, stamped with this clock's type."""
        return Time(nanoseconds=self.now_ns(), clock_type=self.clock_type)

    def now_ns(self) -> int:
        """Nanoseconds since the clock's zero; 0 while ROS time is overridden but no time was set yet."""
        return self._override_ns if self._active else self._source_ns()

    @property
    def ros_time_is_active(self) -> bool:
        """True while an override decides the time."""
        return self._active

    def enable_ros_time_override(self) -> None:
        """Let the override decide; without effect when it already does. Raises `ClockTypeError` off ROS time."""
        self._change_source(True)

    def disable_ros_time_override(self) -> None:
        """Follow the system clock again; the stored override time is kept."""
        self._change_source(False)

    def set_ros_time_override(self, now: Time) -> None:
        """Set the simulated time; only stores it while the override is not enabled."""
        self._require_ros_time()
        if not isinstance(now, Time):
            raise TypeError(f"the override of a ROS clock must be a Time, got {now!r:.100}")
        if now.clock_type is not ClockType.ROS_TIME:
            raise ClockTypeError(f"the override of a ROS clock must be a ROS_TIME, got {now!r}")
        if not self._active:
            self._override_ns = now.nanoseconds
            return
        delta = Duration(nanoseconds=now.nanoseconds - self._override_ns)
        jump = TimeJump(ClockChange.ROS_TIME_NO_CHANGE, delta)
        chosen = self._call_before(jump)
        self._override_ns = now.nanoseconds
        self._call_after(chosen, jump)

    def create_jump_callback(
        self,
        *,
        pre: Callable[[TimeJump], None] | None = None,
        post: Callable[[TimeJump], None] | None = None,
        on_clock_change: bool = False,
        min_forward: Duration | None = None,
        min_backward: Duration | None = None,
    ) -> JumpHandle:
        """Call `pre` before and `post` after each jump that one of the thresholds selects.

        Raises `TimeRangeError` unless `min_forward` > 0 and `min_backward` < 0. Exceptions in a callback are logged.
        """
        for name, threshold in (("min_forward", min_forward), ("min_backward", min_backward)):
            if threshold is not None and not isinstance(threshold, Duration):
                raise TypeError(f"{name} must be a Duration or None, got {threshold!r:.100}")
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise TimeRangeError(f"min_forward must be a positive duration, got {min_forward!r}")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise TimeRangeError(f"min_backward must be a negative duration, got {min_backward!r}")

        def matches(jump: TimeJump) -> bool:
            if jump.source_changed:
                return on_clock_change
            forward = min_forward is not None and jump.delta >= min_forward
            return forward or (min_backward is not None and jump.delta <= min_backward)

        handle = JumpHandle(self, matches, pre, post)
        self._handles.append(handle)
        return handle

    async def sleep_until(self, until: Time) -> bool:
        """Sleep until this clock, simulated or not, reads `until` or later; see `sleep.py`.

        Returns:
            False when ROS time was activated or deactivated meanwhile: `until` has no meaning on the other time.

        Raises:
            ClockTypeError: `until` is of another clock. TypeError: it is no `Time`.
        """
        from rosidl_py_gen.runtime.time.sleep import sleep_until

        return await sleep_until(self, until)

    async def sleep_for(self, duration: Duration | float) -> bool:
        """Sleep by this clock, simulated or not; a number means seconds. False as in `sleep_until`.

        Time that jumps back to before the start of the sleep begins it anew, as a timer's period does.

        Raises:
            TypeError: no duration and no number. TimeRangeError: not finite.
        """
        from rosidl_py_gen.runtime.time.sleep import sleep_for

        return await sleep_for(self, duration)

    def _forget(self, handle: JumpHandle) -> None:
        self._handles.remove(handle)

    def _require_ros_time(self) -> None:
        if self.clock_type is not ClockType.ROS_TIME:
            raise ClockTypeError(f"only a ROS_TIME clock can be overridden, this one is {self.clock_type.name}")

    def _change_source(self, active: bool) -> None:
        self._require_ros_time()
        if active == self._active:
            return
        change = ClockChange.ROS_TIME_ACTIVATED if active else ClockChange.ROS_TIME_DEACTIVATED
        jump = TimeJump(change, Duration())
        chosen = self._call_before(jump)
        self._active = active
        self._call_after(chosen, jump)

    def _call_before(self, jump: TimeJump) -> list[JumpHandle]:
        chosen = [handle for handle in self._handles if handle.matches(jump)]
        for handle in chosen:
            _call(handle.pre, jump)
        return chosen

    def _call_after(self, chosen: list[JumpHandle], jump: TimeJump) -> None:
        for handle in chosen:
            # A callback may have closed another one in the meantime.
            if handle.matches(jump):
                _call(handle.post, jump)


def _call(callback: Callable[[TimeJump], None] | None, jump: TimeJump) -> None:
    if callback is None:
        return
    try:
        callback(jump)
    except Exception:
        _log.exception("a time jump callback failed; the others and the clock are not affected")
