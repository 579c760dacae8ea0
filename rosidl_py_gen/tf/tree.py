"""The frames and what is known of each over time, as a plain object: no node, no waiting.

Decides everything tf2's ``BufferCore`` decides: which transforms are taken, how long they are kept, what is between
two of them, and which error says what is missing. Times are nanoseconds; 0 asks for the latest common time.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.tf.algebra import (
    IDENTITY,
    ORIGIN,
    Quaternion,
    Vector,
    add,
    conjugate,
    mix,
    negate,
    product,
    rotate,
    slerp,
    unit,
)
from rosidl_py_gen.tf.errors import ConnectivityError, ExtrapolationError, InvalidTransformError, UnknownFrameError

if TYPE_CHECKING:
    from collections.abc import Iterator

_TOLERANCE = 10e-3
"""How far the square of a quaternion's length may be from 1, as in tf2."""


class Link(NamedTuple):
    """How a frame lies in its parent."""

    parent: str
    translation: Vector
    rotation: Quaternion


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """What is known of a frame.

    Attributes:
        parent: of the newest transform; None for the root of a tree.
        oldest, newest: nanoseconds, None for static frames and roots.
        count: transforms that are kept.
    """

    parent: str | None
    is_static: bool
    oldest: int | None
    newest: int | None
    count: int


class _Static:
    """A frame that never moves: the last transform counts, at all times."""

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


class _Moving:
    """A frame with transforms over time, oldest first."""

    def __init__(self, cache_time: int) -> None:
        self._cache_time = cache_time
        self.stamps: list[int] = []
        self._links: list[Link] = []

    def insert(self, stamp: int, link: Link) -> bool:
        """False when it is older than what is kept."""
        stamps, links = self.stamps, self._links
        if stamps and stamp < stamps[-1] - self._cache_time:
            return False
        at = bisect_right(stamps, stamp)
        if link not in links[bisect_left(stamps, stamp) : at]:  # else it was said again
            stamps.insert(at, stamp)
            links.insert(at, link)
        old = bisect_left(stamps, stamps[-1] - self._cache_time)
        del stamps[:old], links[:old]
        return True

    def at(self, time: int) -> Link:
        """Raises `ExtrapolationError` without the frames' names."""
        stamps, links = self.stamps, self._links
        if not stamps:
            raise ExtrapolationError(f"nothing is in the buffer, {_shown(time)} was asked for")
        if time == 0 or time == stamps[-1]:
            return links[-1]
        if time == stamps[0]:
            return links[0]
        if not stamps[0] < time < stamps[-1]:
            raise ExtrapolationError(self._outside(time))
        after = bisect_right(stamps, time)
        one, two = links[after - 1], links[after]
        if one.parent != two.parent:  # reparented in between: the older one counts until then
            return one
        ratio = (time - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        moved = mix(one.translation, two.translation, ratio)
        return Link(one.parent, moved, slerp(one.rotation, two.rotation, ratio))

    def _outside(self, time: int) -> str:
        first, last = self.stamps[0], self.stamps[-1]
        if len(self.stamps) == 1:
            return f"asked for {_shown(time)}, but only {_shown(first)} is in the buffer"
        if time > last:
            return f"asked for {_shown(time)}, {(time - last) / NS_PER_S:.6g} s after the latest, {_shown(last)}"
        return f"asked for {_shown(time)}, {(first - time) / NS_PER_S:.6g} s before the earliest, {_shown(first)}"

    def latest(self) -> tuple[int, str]:
        return (self.stamps[-1], self._links[-1].parent) if self.stamps else (0, "")

    def info(self) -> FrameInfo:
        if not self.stamps:
            return FrameInfo(None, False, None, None, 0)
        return FrameInfo(self._links[-1].parent, False, self.stamps[0], self.stamps[-1], len(self.stamps))


class FrameTree:
    """All frames. Methods that ask raise the errors of `errors.py`."""

    def __init__(self, cache_time: int) -> None:
        self._cache_time = cache_time
        self._frames: dict[str, _Static | _Moving | None] = {}  # None: named as a parent only

    def insert(self, child: str, stamp: int, link: Link, *, is_static: bool) -> None:
        """Take a transform in; raises `InvalidTransformError`, and nothing has changed then."""
        child, link = without_slash(child), link._replace(parent=without_slash(link.parent))
        link = link._replace(rotation=_checked(child, link))
        frame = self._frames.get(child)
        if frame is None or isinstance(frame, _Static) != is_static:
            frame = _Static() if is_static else _Moving(self._cache_time)
        if not frame.insert(stamp, link):
            newest = frame.latest()[0]
            raise InvalidTransformError(
                f'"{child}": {_shown(stamp)} is {(newest - stamp) / NS_PER_S:.6g} s before the latest, '
                f"more than the {self._cache_time / NS_PER_S:.6g} s that are kept"
            )
        self._frames[child] = frame
        self._frames.setdefault(link.parent)

    def clear(self) -> None:
        """Forget what moves; static transforms stay, because nobody sends them again."""
        for name, frame in self._frames.items():
            if isinstance(frame, _Moving):
                self._frames[name] = _Moving(self._cache_time)

    def frames(self) -> dict[str, FrameInfo]:
        """Every frame that was ever named."""
        root = FrameInfo(None, False, None, None, 0)
        return {name: root if frame is None else frame.info() for name, frame in sorted(self._frames.items())}

    # ---------------------------------------------------------------------------------------------------- lookups

    def lookup(self, target: str, source: str, time: int) -> tuple[int, Vector, Quaternion]:
        """The time that it is of, translation and rotation from `source` to `target`."""
        if target == source:
            known = self._frames.get(target)
            return (known.latest()[0] if time == 0 and known is not None else time), ORIGIN, IDENTITY
        self.require(target=target, source=source)
        if time == 0:
            time = self._latest_common(target, source)
        try:
            return (time, *self._joined(target, source, time))
        except ExtrapolationError as error:
            raise ExtrapolationError(f'from "{source}" to "{target}": {error}') from None

    def require(self, **frames: str) -> None:
        """Raise `UnknownFrameError` or `InvalidTransformError` for the first of these that is no frame."""
        for what, frame in frames.items():
            self._require(frame, what)

    def _require(self, frame: str, what: str) -> None:
        if not frame or frame.startswith("/"):
            reason = "is empty" if not frame else f'"{frame}" begins with /, which no frame does'
            raise InvalidTransformError(f"the {what} frame {reason}")
        if frame not in self._frames:
            known = sorted(self._frames)
            shown = ", ".join(known[:20]) + (f" and {len(known) - 20} more" if len(known) > 20 else "")
            hint = did_you_mean(frame, known)
            raise UnknownFrameError(f'the {what} frame "{frame}" is not known{hint} (known: {shown or "none"})')

    def _joined(self, target: str, source: str, time: int) -> tuple[Vector, Quaternion]:
        """Walk up from the source to the top, then from the target until both meet."""
        up, down = _Walk(source), _Walk(target)
        missing: ExtrapolationError | None = None
        try:
            while (link := self._link(up, time)) is not None:
                if up.frame == target:
                    return up.translation, up.rotation
                up.step(link)
        except ExtrapolationError as error:  # the other end may still lead here
            missing = error
        while down.frame != up.frame:
            if (link := self._link(down, time)) is None:
                raise missing or self._apart(target, source)
            if down.frame == source:
                up = _Walk(source)
                break
            down.step(link)
        back = conjugate(down.rotation)
        return rotate(back, add(up.translation, negate(down.translation))), product(back, up.rotation)

    def _link(self, walk: _Walk, time: int) -> Link | None:
        """How the frame that a walk has reached lies in its parent; None for a root."""
        if walk.steps > len(self._frames):
            raise UnknownFrameError(f"the frames form a loop: {' -> '.join(self._loop(walk.frame))}")
        cache = self._frames[walk.frame]
        try:
            return None if cache is None else cache.at(time)
        except ExtrapolationError as error:
            raise ExtrapolationError(f'"{walk.frame}": {error}') from None

    def _loop(self, frame: str) -> list[str]:
        seen = [frame]
        while (cache := self._frames.get(frame)) is not None:
            frame = cache.latest()[1]
            seen.append(frame)
            if frame in seen[:-1] or len(seen) > 20:
                break
        return seen

    def _apart(self, target: str, source: str) -> ConnectivityError:
        roots = [self._root(frame) for frame in (target, source)]
        return ConnectivityError(
            f'"{target}" and "{source}" are not connected: they are in the trees of "{roots[0]}" and "{roots[1]}"'
        )

    def _root(self, frame: str) -> str:
        for _ in range(len(self._frames)):
            cache = self._frames.get(frame)
            if cache is None or not (parent := cache.latest()[1]):
                break
            frame = parent
        return frame

    def _latest_common(self, target: str, source: str) -> int:
        """The newest time at which every frame between the two is known; 0 when all are static."""
        chain = list(self._latest_up(source, target))
        if chain and chain[-1][1] == target:
            return _least(stamp for stamp, _ in chain)
        parents = [parent for _, parent in chain]
        times = []
        for stamp, parent in self._latest_up(target, source):
            times.append(stamp)
            if parent == source:
                return _least(times)
            if parent in parents:
                shared = parents.index(parent) + 1
                return _least([*times, *(stamp for stamp, _ in chain[:shared])])
        raise self._apart(target, source)

    def _latest_up(self, frame: str, end: str) -> Iterator[tuple[int, str]]:
        """Newest stamp and parent of each frame, up to `end` or the root."""
        start = frame
        for _ in range(len(self._frames) + 1):
            cache = self._frames.get(frame)
            if cache is None:
                return
            stamp, frame = cache.latest()
            if not frame:
                return
            yield stamp, frame
            if frame == end:
                return
        raise UnknownFrameError(f"the frames form a loop: {' -> '.join(self._loop(start))}")


class _Walk:
    """What adds up on the way from a frame to the top."""

    def __init__(self, frame: str) -> None:
        self.frame = frame
        self.steps = 0
        self.translation: Vector = ORIGIN
        self.rotation: Quaternion = IDENTITY

    def step(self, link: Link) -> None:
        self.translation = add(rotate(link.rotation, self.translation), link.translation)
        self.rotation = product(link.rotation, self.rotation)
        self.frame = link.parent
        self.steps += 1


def without_slash(frame: str) -> str:
    """The name of a frame without the slash that tf of ROS 1 began it with; tf2 takes one away, too."""
    return frame.removeprefix("/")


def _least(stamps: Any) -> int:
    return min((stamp for stamp in stamps if stamp), default=0)


def _checked(child: str, link: Link) -> Quaternion:
    """The rotation with length 1, of frames without a slash; raises `InvalidTransformError`."""
    if not child or not link.parent:
        raise InvalidTransformError(f'frame_id "{link.parent}" and child_frame_id "{child}" must not be empty')
    if child == link.parent:
        raise InvalidTransformError(f'"{child}": frame_id and child_frame_id are the same')
    if not all(map(isfinite, (*link.translation, *link.rotation))):
        raise InvalidTransformError(f'"{child}": not finite: {link.translation} {link.rotation}')
    square = sum(value * value for value in link.rotation)
    if abs(square - 1) >= _TOLERANCE:
        raise InvalidTransformError(
            f'"{child}": {link.rotation} is no rotation: its length is {square**0.5:.6g}, not 1'
        )
    return unit(link.rotation)


def _shown(time: int) -> str:
    sec, rest = sec_nanosec(abs(time))
    return f"{'-' if time < 0 else ''}{sec}.{rest:09}"
