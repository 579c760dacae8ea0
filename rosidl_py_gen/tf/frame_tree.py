"""The frames and what is known of each over time, as a plain object: no node, no waiting.

Decides everything tf2's ``BufferCore`` decides: which transforms are taken, how long they are kept, what is between
two of them, and which error says what is missing. Times are nanoseconds; 0 asks for the latest common time.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any, Literal

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import printable
from rosidl_py_gen.tf.errors import ConnectivityError, ExtrapolationError, InvalidTransformError, UnknownFrameError
from rosidl_py_gen.tf.history import FrameInfo, Link, MovingFrame, NoDataError, StaticFrame, shown_time
from rosidl_py_gen.tf.quaternion_math import (
    IDENTITY,
    ORIGIN,
    Quaternion,
    Vector,
    add,
    conjugate,
    negate,
    normalized,
    product,
    rotate,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

_TOLERANCE = 10e-3
"""How far the square of a quaternion's length may be from 1, as in tf2."""
_MAX_NAME = 100
"""Number of characters that errors show of a frame's name, which peers choose."""


class FrameTree:
    """All frames. Methods that ask raise the errors of `errors.py`."""

    def __init__(self, cache_time: int) -> None:
        self._cache_time = cache_time
        self._frames: dict[str, StaticFrame | MovingFrame | None] = {}  # None: named as a parent only

    def insert(self, child: str, stamp: int, link: Link, *, is_static: bool) -> None:
        """Take a transform in; raises `InvalidTransformError`, and nothing has changed then."""
        child, link = without_slash(child), link._replace(parent=without_slash(link.parent))
        link = link._replace(rotation=_checked(child, link))
        frame = self._frames.get(child)
        if frame is None or isinstance(frame, StaticFrame) != is_static:
            frame = StaticFrame() if is_static else MovingFrame(self._cache_time)
        if not frame.insert(stamp, link):
            newest = frame.latest()[0]
            raise InvalidTransformError(
                f"{_quoted(child)}: {shown_time(stamp)} is {(newest - stamp) / NS_PER_S:.6g} s before the latest, "
                f"more than the {self._cache_time / NS_PER_S:.6g} s that are kept"
            )
        self._frames[child] = frame
        self._frames.setdefault(link.parent)

    def clear(self) -> None:
        """Forget what moves; static transforms stay, because nobody sends them again."""
        for name, frame in self._frames.items():
            if isinstance(frame, MovingFrame):
                self._frames[name] = MovingFrame(self._cache_time)

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
            return (time, *self._lookup(target, source, time))
        except NoDataError:
            raise self._without_data(target, source, time) from None

    def require(self, **frames: str) -> None:
        """Raise `UnknownFrameError` or `InvalidTransformError` for the first of these that is no frame."""
        for what, frame in frames.items():
            self._require(frame, what)

    def _require(self, frame: str, what: str) -> None:
        if not frame or frame.startswith("/"):
            reason = "is empty" if not frame else f"{_quoted(frame)} begins with /, which no frame does"
            raise InvalidTransformError(f"the {what} frame {reason}")
        if frame not in self._frames:
            known = sorted(self._frames)
            names = ", ".join(printable(name, _MAX_NAME) for name in known[:20])
            shown = names + (f" and {len(known) - 20} more" if len(known) > 20 else "")
            hint = did_you_mean(frame, known)
            raise UnknownFrameError(f"the {what} frame {_quoted(frame)} is not known{hint} (known: {shown or 'none'})")

    def _lookup(self, target: str, source: str, time: int) -> tuple[Vector, Quaternion]:
        """Walk up from the source to the top, then from the target until both meet."""
        up, down = _TransformChain(source), _TransformChain(target)
        missing: NoDataError | None = None
        try:
            while (link := self._link(up, time)) is not None:
                if up.frame == target:
                    return up.translation, up.rotation
                up.step(link)
        except NoDataError as error:  # the other end may still lead here
            missing = error
        while down.frame != up.frame:
            if (link := self._link(down, time)) is None:
                raise missing or self._not_connected(target, source)
            if down.frame == source:
                up = _TransformChain(source)
                break
            down.step(link)
        back = conjugate(down.rotation)
        return rotate(back, add(up.translation, negate(down.translation))), product(back, up.rotation)

    def _link(self, walk: _TransformChain, time: int) -> Link | None:
        """How the frame that a walk has reached lies in its parent; None for a root."""
        if walk.steps > len(self._frames):
            raise self._looped(walk.frame)
        cache = self._frames[walk.frame]
        return None if cache is None else cache.at(time)

    def _without_data(self, target: str, source: str, time: int) -> ExtrapolationError:
        """The error that names the transform which has no data: the first of those between the two frames."""
        up, down = list(self._near(source, time)), list(self._near(target, time))
        shared = {frame for frame, _ in up} & {frame for frame, _ in down}
        between = [one for one in (*up, *down) if one[0] not in shared] if shared else [*up, *down]
        text, frame = "", ""
        direction: Literal["", "past", "future"] = ""
        for frame, parent in between:
            cache = self._frames.get(frame)
            if isinstance(cache, MovingFrame) and cache.lacks(time):
                reason, direction = cache.why_not(time)
                of = f"{_quoted(frame)} in {_quoted(parent)}" if parent else _quoted(frame)
                text = f"from {_quoted(source)} to {_quoted(target)}: the transform of {of} {reason}"
                break
        if not shared:
            text += "; by their latest transforms the two are not connected"
        return ExtrapolationError(text, frame=frame, direction=direction)

    def _near(self, frame: str, time: int) -> Iterator[tuple[str, str]]:
        """Each frame from `frame` to the root, and its parent at `time`, or as near to it as is known."""
        for _ in range(len(self._frames) + 1):
            cache = self._frames.get(frame)
            if isinstance(cache, MovingFrame) and cache.lacks(time):
                link = cache.nearest(time)
            else:
                link = None if cache is None else cache.at(time)
            yield frame, "" if link is None else link.parent
            if link is None:
                return
            frame = link.parent

    def _looped(self, frame: str) -> UnknownFrameError:
        names = (printable(name, _MAX_NAME) for name in self._cycle(frame))
        return UnknownFrameError(f"the frames form a loop: {' -> '.join(names)}")

    def _cycle(self, frame: str) -> list[str]:
        seen = [frame]
        while (cache := self._frames.get(frame)) is not None:
            frame = cache.latest()[1]
            seen.append(frame)
            if frame in seen[:-1] or len(seen) > 20:
                break
        return seen

    def _not_connected(self, target: str, source: str) -> ConnectivityError:
        roots = [_quoted(self._root(frame)) for frame in (target, source)]
        return ConnectivityError(
            f"{_quoted(target)} and {_quoted(source)} are not connected: "
            f"they are in the trees of {roots[0]} and {roots[1]}"
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
        chain = list(self._ancestors(source, target))
        if chain and chain[-1][1] == target:
            return _earliest_nonzero(stamp for stamp, _ in chain)
        parents = [parent for _, parent in chain]
        times = []
        for stamp, parent in self._ancestors(target, source):
            times.append(stamp)
            if parent == source:
                return _earliest_nonzero(times)
            if parent in parents:
                shared = parents.index(parent) + 1
                return _earliest_nonzero([*times, *(stamp for stamp, _ in chain[:shared])])
        raise self._not_connected(target, source)

    def _ancestors(self, frame: str, end: str) -> Iterator[tuple[int, str]]:
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
        raise self._looped(start)


class _TransformChain:
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


def _earliest_nonzero(stamps: Any) -> int:
    return min((stamp for stamp in stamps if stamp), default=0)


def _checked(child: str, link: Link) -> Quaternion:
    """The rotation with length 1, of frames without a slash; raises `InvalidTransformError`."""
    name = _quoted(child)
    if not child or not link.parent:
        raise InvalidTransformError(f"frame_id {_quoted(link.parent)} and child_frame_id {name} must not be empty")
    if child == link.parent:
        raise InvalidTransformError(f"{name}: frame_id and child_frame_id are the same")
    if not all(map(isfinite, (*link.translation, *link.rotation))):
        raise InvalidTransformError(f"{name}: not finite: {link.translation} {link.rotation}")
    square = sum(value * value for value in link.rotation)
    if abs(square - 1) >= _TOLERANCE:
        raise InvalidTransformError(f"{name}: {link.rotation} is no rotation: its length is {square**0.5:.6g}, not 1")
    return normalized(link.rotation)


def _quoted(frame: str) -> str:
    return f'"{printable(frame, _MAX_NAME)}"'
