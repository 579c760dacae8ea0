"""Tree of frames with their transforms over time. It needs no node, and no lookup waits.

The rules are the same as in tf2's ``BufferCore``: validity and age of transforms, interpolation, and the kind of error.
Times are nanoseconds; a lookup at 0 means the latest common time.

Arithmetic of single rotations and translations uses plain floats, which is faster than numpy for so few numbers.
Quaternions are (x, y, z, w) of length 1, as everywhere in ROS.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from math import acos, cos, isfinite, sin, sqrt
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.errors import RosidlError, printable

if TYPE_CHECKING:
    from collections.abc import Iterator

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation that applies first `b`, then `a`; both are quaternions."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse of a rotation, which is the conjugate of its quaternion."""
    return (-q[0], -q[1], -q[2], q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return the vector `v` rotated by the quaternion `q`."""
    x, y, z, w = q
    a, b, c = v
    # twice the cross product of the axis with v, then v + w t + axis x t
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


def add(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector, b: Vector) -> Vector:
    """Return the difference of two vectors."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def lerp(a: Vector, b: Vector, ratio: float) -> Vector:
    """Return the point on the line from `a` (ratio 0) to `b` (ratio 1)."""
    rest = 1 - ratio
    return (a[0] * rest + b[0] * ratio, a[1] * rest + b[1] * ratio, a[2] * rest + b[2] * ratio)


def slerp(a: Quaternion, b: Quaternion, ratio: float) -> Quaternion:
    """Return the rotation on the shorter arc from `a` (ratio 0) to `b` (ratio 1), at constant angular speed."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if cosine < 0 else 1.0
    angle = acos(min(1.0, abs(cosine)))
    if angle < 1e-9:
        return a
    one, two = sin((1 - ratio) * angle) / sin(angle), sign * sin(ratio * angle) / sin(angle)
    x, y, z, w = (start * one + end * two for start, end in zip(a, b, strict=True))
    return normalized((x, y, z, w))


def normalized(q: Quaternion) -> Quaternion:
    """Return the quaternion scaled to length 1."""
    length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


class Pose(NamedTuple):
    """Position and orientation of a frame in another frame."""

    translation: Vector
    rotation: Quaternion

    @classmethod
    def from_rpy(cls, roll: float, pitch: float, yaw: float, *, translation: Vector = ORIGIN) -> Pose:
        """Return a pose turned by `roll` about x, then by `pitch` about y, then by `yaw` about z, all fixed axes."""
        x = (sin(roll / 2), 0.0, 0.0, cos(roll / 2))
        y = (0.0, sin(pitch / 2), 0.0, cos(pitch / 2))
        z = (0.0, 0.0, sin(yaw / 2), cos(yaw / 2))
        return cls(translation, normalized(product(z, product(y, x))))

    def moved(self, vector: Vector) -> tuple[Vector, Quaternion]:
        """Return translation and rotation of the pose moved along a vector in its own frame."""
        translation, rotation = self
        return add(translation, rotate(rotation, vector)), rotation

    def turned(self, axis: Vector, angle: float) -> tuple[Vector, Quaternion]:
        """Return translation and rotation of the pose turned by radians about a unit vector in its own frame."""
        x, y, z = axis
        sine = sin(angle / 2)
        translation, rotation = self
        return translation, product(rotation, (x * sine, y * sine, z * sine, cos(angle / 2)))


# --------------------------------------------------------------------------------------------------------------- frames


_TOLERANCE = 10e-3
"""Maximum deviation of the square of a quaternion's length from 1, as in tf2."""
_MAX_NAME = 100
"""Maximum characters of a frame's name in error texts; peers choose these names."""
_MAX_REFUSED = 2
"""Number of consecutive transforms with rising stamps that a frame refuses as too old; the next transform replaces all
newer ones. tf2 refuses such transforms until it is cleared, so one stamp far in the future would block the frame for
ever. A larger number blocks the frame longer; with a smaller one a late packet could replace correct transforms."""


class TransformError(RosidlError, LookupError):
    """Error of a transform that is not known, or not known at the requested time."""


class UnknownFrameError(TransformError):
    """Error of a lookup with a frame that no transform names, or of frames that form a loop.

    The counterpart of tf2's LookupException.
    """


class ConnectivityError(TransformError):
    """Error of a lookup between two frames that no chain of transforms connects.

    The counterpart of tf2's ConnectivityException.
    """


class ExtrapolationError(TransformError):
    """Error of a lookup between connected frames at a time without data.

    The counterpart of tf2's ExtrapolationException.

    Attributes:
        frame: child frame of the transform that has no data at that time.
        direction: position of that time relative to the data: ``past`` or ``future``.
    """

    def __init__(self, text: str, *, frame: str = "", direction: Literal["", "past", "future"] = "") -> None:
        super().__init__(text)
        self.frame = frame
        self.direction = direction


class TransformTimeoutError(TransformError, TimeoutError):
    """Error of a transform that was not known within the timeout; the text has the last reason."""


class InvalidTransformError(RosidlError, ValueError):
    """Error of a transform that cannot be used.

    Its frames are equal or empty, its values are not finite, its quaternion is no rotation, or it is too old for the
    buffer.
    """


class Link(NamedTuple):
    """Transform of a child frame relative to its parent frame at one time."""

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


class Frame:
    """Transforms of one frame over time, oldest first; the only transform of a static frame is valid at all times."""

    def __init__(self, is_static: bool, cache_time: int) -> None:
        self.is_static, self._cache_time = is_static, cache_time
        self.stamps: list[int] = []
        self._links: list[Link] = []
        self._refused: list[tuple[int, Link]] = []

    def insert(self, stamp: int, link: Link) -> bool:
        """Insert a transform; return False if it is too old and was not inserted.

        After `_MAX_REFUSED` refused transforms, the next one replaces all newer transforms.
        """
        if self.is_static:
            self.stamps, self._links = [0], [link]
            return True
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
        """Return the transform of the frame at a time in nanoseconds, interpolated if necessary.

        Time 0 means the latest transform.

        Raises:
            NoDataError: the time is outside of the known times.
        """
        stamps, links = self.stamps, self._links
        if self.lacks(time):
            raise NoDataError
        if time == 0 or self.is_static or time == stamps[-1]:
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
        """Return True if the frame has no transform for `time`, neither stored nor interpolated."""
        return not self.stamps or not (time == 0 or self.is_static or self.stamps[0] <= time <= self.stamps[-1])

    def nearest(self, time: int) -> Link | None:
        """Return the frame's transform nearest to a time outside of the known times; None if there is none."""
        return (self._links[0 if time < self.stamps[0] else -1]) if self.stamps else None

    def why_not(self, time: int) -> tuple[str, Literal["", "past", "future"]]:
        """Return the reason why the frame has no transform for `time`, and the direction of the extrapolation."""
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
        oldest, newest = (None, None) if self.is_static else (self.stamps[0], self.stamps[-1])
        return FrameInfo(self._links[-1].parent, self.is_static, oldest, newest, len(self.stamps))


class NoDataError(RosidlError):
    """Error of a frame that has no transform at the requested time."""


def format_time(time: int) -> str:
    """Return a time in nanoseconds as text in seconds with nine decimals."""
    sec, rest = sec_nanosec(abs(time))
    return f"{'-' if time < 0 else ''}{sec}.{rest:09}"


class FrameTree:
    """All frames with their transforms. Lookups raise `TransformError` if the transform is not known."""

    def __init__(self, cache_time: int) -> None:
        self._cache_time = cache_time
        self._frames: dict[str, Frame | None] = {}  # None: named as a parent only

    def insert(self, child: str, stamp: int, link: Link, *, is_static: bool) -> None:
        """Insert a transform of the frame `child`; raises `InvalidTransformError` and then changes nothing."""
        child, link = without_slash(child), link._replace(parent=without_slash(link.parent))
        link = link._replace(rotation=_checked(child, link))
        frame = self._frames.get(child)
        if frame is None or frame.is_static != is_static:
            frame = Frame(is_static, self._cache_time)
        if not frame.insert(stamp, link):
            newest = frame.latest()[0]
            raise InvalidTransformError(
                f"{_quoted(child)}: {format_time(stamp)} is {(newest - stamp) / NS_PER_S:.6g} s before the latest; "
                f"expected at most the cache time, {self._cache_time / NS_PER_S:.6g} s"
            )
        self._frames[child] = frame
        self._frames.setdefault(link.parent)

    def clear(self) -> None:
        """Remove all transforms that are not static; static ones stay, because they are not sent again."""
        for name, frame in self._frames.items():
            if frame is not None and not frame.is_static:
                self._frames[name] = Frame(False, self._cache_time)

    def frames(self) -> dict[str, FrameInfo]:
        """Return all frames by name that a transform ever named, as child or parent."""
        root = FrameInfo(None, False, None, None, 0)
        return {name: root if frame is None else frame.info() for name, frame in sorted(self._frames.items())}

    # ---------------------------------------------------------------------------------------------------- lookups

    def lookup(self, target: str, source: str, time: int) -> tuple[int, Vector, Quaternion]:
        """Return time, translation and rotation of the transform from `source` to `target`.

        Raises `TransformError` or `InvalidTransformError`.
        """
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
        """Raise `UnknownFrameError` for the first unknown frame, or `InvalidTransformError` for the first invalid name.

        The keywords are the roles of the frames in the error text, such as ``target``.
        """
        for role, frame in frames.items():
            if not frame or frame.startswith("/"):
                reason = f"{_quoted(frame)} begins with /, which no frame does" if frame else "is empty"
                raise InvalidTransformError(f"the {role} frame {reason}")
            if frame not in self._frames:
                known = sorted(self._frames)
                names = ", ".join(printable(name, _MAX_NAME) for name in known[:20]) or "none"
                names += f" and {len(known) - 20} more" if len(known) > 20 else ""
                hint = did_you_mean(frame, known)
                raise UnknownFrameError(f"the {role} frame {_quoted(frame)} is not known{hint} (known: {names})")

    def _lookup(self, target: str, source: str, time: int) -> tuple[Vector, Quaternion]:
        """Return translation and rotation of the transform from `source` to `target` at a time.

        The first walk leads from the source to the root of the tree. The second walk leads from the target up to the
        frame where the first walk ended. Transforms above the common ancestor are in both walks, so they cancel.
        """
        up, down = _TransformChain(source), _TransformChain(target)
        missing: NoDataError | None = None
        try:
            while (link := self._link(up, time)) is not None:
                if up.frame == target:
                    return up.translation, up.rotation
                up.step(link)
        except NoDataError as error:  # the walk from the target may still lead here
            missing = error
        while down.frame != up.frame:
            if (link := self._link(down, time)) is None:
                raise missing or self._connectivity_error(target, source)
            if down.frame == source:
                up = _TransformChain(source)
                break
            down.step(link)
        back = conjugate(down.rotation)
        return rotate(back, subtract(up.translation, down.translation)), product(back, up.rotation)

    def _link(self, walk: _TransformChain, time: int) -> Link | None:
        """Return the transform of a frame relative to its parent on the way to the root; None if the frame is a root.

        Raises `NoDataError` for a frame without transform at `time`, `UnknownFrameError` for a loop.
        """
        if walk.steps > len(self._frames):
            raise self._loop_error(walk.frame, time)
        cache = self._frames[walk.frame]
        return None if cache is None else cache.at(time)

    def _without_data(self, target: str, source: str, time: int) -> ExtrapolationError:
        """Return the error for a lookup between two frames that fails at a time.

        It names the first frame without a transform.
        """
        up, down = list(self._near(source, time)), list(self._near(target, time))
        shared = {frame for frame, _ in up} & {frame for frame, _ in down}
        between = [one for one in (*up, *down) if one[0] not in shared] if shared else [*up, *down]
        text, frame = "", ""
        direction: Literal["", "past", "future"] = ""
        for frame, parent in between:
            cache = self._frames.get(frame)
            if cache is not None and cache.lacks(time):
                reason, direction = cache.why_not(time)
                of = f"{_quoted(frame)} in {_quoted(parent)}" if parent else _quoted(frame)
                text = f"from {_quoted(source)} to {_quoted(target)}: the transform of {of} {reason}"
                break
        if not shared:
            text += "; by their latest transforms the two are not connected"
        return ExtrapolationError(text, frame=frame, direction=direction)

    def _near(self, frame: str, time: int) -> Iterator[tuple[str, str]]:
        """Yield each frame from `frame` up to the root of the tree, each with its parent at `time`, or else at the
        nearest known time.
        """
        for _ in range(len(self._frames) + 1):
            cache = self._frames.get(frame)
            if cache is not None and cache.lacks(time):
                link = cache.nearest(time)
            else:
                link = None if cache is None else cache.at(time)
            yield frame, "" if link is None else link.parent
            if link is None:
                return
            frame = link.parent

    def _loop_error(self, frame: str, time: int) -> UnknownFrameError:
        seen: list[str] = []
        for name, _ in self._near(frame, time):
            seen.append(name)
            if name in seen[:-1] or len(seen) > 20:
                break
        names = (printable(name, _MAX_NAME) for name in seen)
        return UnknownFrameError(f"the frames form a loop: {' -> '.join(names)}")

    def _connectivity_error(self, target: str, source: str) -> ConnectivityError:
        roots = [_quoted([*self._near(frame, 0)][-1][0]) for frame in (target, source)]
        return ConnectivityError(
            f"{_quoted(target)} and {_quoted(source)} are not connected: "
            f"they are in the trees of {roots[0]} and {roots[1]}"
        )

    def _latest_common(self, target: str, source: str) -> int:
        """Return the latest time at which the transforms of all frames between two are known; 0 if all are static."""
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
        raise self._connectivity_error(target, source)

    def _ancestors(self, frame: str, end: str) -> Iterator[tuple[int, str]]:
        """Yield the newest stamp and the parent of `frame` and of each frame above it, up to the frame `end` or the
        root.
        """
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
        raise self._loop_error(start, 0)


class _TransformChain:
    """Product of the transforms on the way from a frame towards the root of the tree."""

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
    """Return the name of a frame without the leading slash of ROS 1; tf2 removes one, too."""
    return frame.removeprefix("/")


def _earliest_nonzero(stamps: Any) -> int:
    return min((stamp for stamp in stamps if stamp), default=0)


def _checked(child: str, link: Link) -> Quaternion:
    """Check the frames and values of a transform, and return its rotation scaled to length 1.

    Raises `InvalidTransformError` if they are not valid.
    """
    name = _quoted(child)
    if not child or not link.parent:
        raise InvalidTransformError(f"frame_id {_quoted(link.parent)} and child_frame_id {name} must not be empty")
    if child == link.parent:
        raise InvalidTransformError(f"{name}: frame_id and child_frame_id are the same")
    if not all(map(isfinite, (*link.translation, *link.rotation))):
        raise InvalidTransformError(f"{name}: not finite: {link.translation} {link.rotation}")
    square = sum(value * value for value in link.rotation)
    if abs(square - 1) >= _TOLERANCE:
        raise InvalidTransformError(
            f"{name}: {link.rotation} is not a rotation: its length is {square**0.5:.6g}, not 1"
        )
    return normalized(link.rotation)


def _quoted(frame: str) -> str:
    return f'"{printable(frame, _MAX_NAME)}"'
