"""StaticFrame and MovingFrame: the transforms of one frame over time, in nanoseconds."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Literal, NamedTuple

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tf.quaternion_math import Quaternion, Vector, lerp, slerp

_MAX_REFUSED = 2
"""Number of transforms in a row, with rising stamps, that a frame refuses as too old; the next replaces newer ones.

tf2 refuses all of them until it is cleared: one stamp far in the future would block the frame for ever. A larger number
blocks the frame longer; with a smaller one a late packet could replace correct transforms.
"""


class Link(NamedTuple):
    """Transform of a frame in its parent at one time."""

    parent: str
    translation: Vector
    rotation: Quaternion


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """Summary of the transforms of one frame.

    Attributes:
        parent: parent in the newest transform; None for the root of a tree.
        oldest, newest: nanoseconds; None for static frames and roots.
        count: number of stored transforms.
    """

    parent: str | None
    is_static: bool
    oldest: int | None
    newest: int | None
    count: int


class StaticFrame:
    """Frame that never moves: its last transform is valid at all times."""

    def __init__(self) -> None:
        self.link: Link | None = None

    def insert(self, _: int, link: Link) -> bool:
        self.link = link
        return True

    def at(self, _: int) -> Link:
        assert self.link is not None
        return self.link

    def latest(self) -> tuple[int, str]:
        return 0, self.at(0).parent

    def info(self) -> FrameInfo:
        return FrameInfo(self.at(0).parent, True, None, None, 1)


class MovingFrame:
    """Frame with transforms over time, oldest first."""

    def __init__(self, cache_time: int) -> None:
        self._cache_time = cache_time
        self.stamps: list[int] = []
        self._links: list[Link] = []
        self._refused: list[tuple[int, Link]] = []

    def insert(self, stamp: int, link: Link) -> bool:
        """Return False if the transform is too old and does not replace the newer ones; see `_MAX_REFUSED`."""
        stamps, links, refused = self.stamps, self._links, self._refused
        if stamps and stamp < stamps[-1] - self._cache_time:
            if refused and stamp <= refused[-1][0]:
                refused.clear()
            refused.append((stamp, link))
            if len(refused) <= _MAX_REFUSED:
                return False
            stamps[:], links[:] = (list(column) for column in zip(*refused[:-1], strict=True))
        refused.clear()
        at = bisect_right(stamps, stamp)
        if link not in links[bisect_left(stamps, stamp) : at]:  # not a repeated transform
            stamps.insert(at, stamp)
            links.insert(at, link)
        old = bisect_left(stamps, stamps[-1] - self._cache_time)
        del stamps[:old], links[:old]
        return True

    def at(self, time: int) -> Link:
        """Return the interpolated transform at a time; raises `NoDataError`."""
        stamps, links = self.stamps, self._links
        if self.lacks(time):
            raise NoDataError
        if time == 0 or time == stamps[-1]:
            return links[-1]
        if time == stamps[0]:
            return links[0]
        after = bisect_right(stamps, time)
        one, two = links[after - 1], links[after]
        if one.parent != two.parent:  # reparented in between: the older transform is valid until then
            return one
        ratio = (time - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        rotation = slerp(one.rotation, two.rotation, ratio)
        return Link(one.parent, lerp(one.translation, two.translation, ratio), rotation)

    def lacks(self, time: int) -> bool:
        """Return True if `at` has no transform for `time`."""
        return not self.stamps or (time != 0 and not self.stamps[0] <= time <= self.stamps[-1])

    def nearest(self, time: int) -> Link | None:
        """Return the transform with the stamp nearest to a time that `at` has none for."""
        return (self._links[0 if time < self.stamps[0] else -1]) if self.stamps else None

    def why_not(self, time: int) -> tuple[str, Literal["", "past", "future"]]:
        """Return why `at` has no transform for `time`, and the direction of the extrapolation."""
        if not self.stamps:
            return f"has no data in the buffer; requested {format_time(time)}", ""
        first, last = self.stamps[0], self.stamps[-1]
        direction: Literal["past", "future"] = "past" if time < first else "future"
        text = f"needs extrapolation into the {direction}: requested {format_time(time)}"
        if first == last:
            return f"{text}, but only {format_time(first)} is in the buffer", direction
        if time > last:
            return f"{text}, {(time - last) / NS_PER_S:.6g} s after the latest, {format_time(last)}", direction
        return f"{text}, {(first - time) / NS_PER_S:.6g} s before the earliest, {format_time(first)}", direction

    def latest(self) -> tuple[int, str]:
        return (self.stamps[-1], self._links[-1].parent) if self.stamps else (0, "")

    def info(self) -> FrameInfo:
        if not self.stamps:
            return FrameInfo(None, False, None, None, 0)
        return FrameInfo(self._links[-1].parent, False, self.stamps[0], self.stamps[-1], len(self.stamps))


class NoDataError(RosidlError):
    """A frame has no transform at that time."""


def format_time(time: int) -> str:
    """Return a time as seconds with nine decimals."""
    sec, rest = sec_nanosec(abs(time))
    return f"{'-' if time < 0 else ''}{sec}.{rest:09}"
