"""The buffer of transforms that tf2_ros builds on, and what is raised; over `rosidl_py_gen.tf`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.time import Time

from rosidl_py_gen import tf
from tf2_py.velocity import Triple, velocity

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]
_NS_PER_S = 1_000_000_000
_SHORTEST_NS = 100_000
"""What transforms of less time count as, for their rate."""


class TransformException(Exception):
    """A transform cannot be told."""


class ConnectivityException(TransformException):
    """The frames are in different trees."""


class LookupException(TransformException):
    """No transform names this frame."""


class ExtrapolationException(TransformException):
    """The frames are connected, but not at that time."""


class InvalidArgumentException(TransformException):
    """No frame: it is empty, or begins with a slash."""


class TimeoutException(TransformException):
    """What was waited for did not come."""


_NAMES = (
    (tf.ConnectivityError, ConnectivityException),
    (tf.ExtrapolationError, ExtrapolationException),
    (tf.UnknownFrameError, LookupException),
    (tf.TransformError, TransformException),
    (tf.InvalidTransformError, InvalidArgumentException),
)


class BufferCore:
    """Transforms of the last seconds, and static ones; times are `Time`, or messages of that name.

    Args:
        cache_time: how long transforms are kept: ten seconds.
    """

    def __init__(self, cache_time: Duration | None = None) -> None:
        seconds = 10.0 if cache_time is None else _nanoseconds(cache_time) / _NS_PER_S
        self._rosidl_buffer = tf.TransformBuffer(cache_time_s=seconds)
        self._rosidl_authorities: dict[str, str] = {}

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Take a transform in; one that is none, or too old, is logged and left out."""
        self._rosidl_set(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Take in one that holds at all times."""
        self._rosidl_set(transform, authority, True)

    def _rosidl_set(self, transform: TransformStamped, authority: str, is_static: bool) -> None:
        try:
            self._rosidl_buffer.set_transform(transform, static=is_static)
        except tf.InvalidTransformError as error:
            get_logger("tf2").warning(f"ignored a transform of {authority}: {error}")
            return
        self._rosidl_authorities[transform.child_frame_id.lstrip("/")] = authority

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Any) -> TransformStamped:
        """How coordinates in `source_frame` become coordinates in `target_frame`; time 0 takes the newest.

        Raises:
            LookupException, ConnectivityException, ExtrapolationException, InvalidArgumentException: as they say.
        """
        with _named():
            return self._rosidl_message(
                self._rosidl_buffer.lookup_transform(target_frame, source_frame, _nanoseconds(time))
            )

    def lookup_transform_full_core(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> TransformStamped:
        """The same between two times, as `fixed_frame` did not move in between."""
        times = _nanoseconds(target_time), _nanoseconds(source_time)
        with _named():
            found = self._rosidl_buffer.lookup_transform_full(
                target_frame, times[0], source_frame, times[1], fixed_frame
            )
            return self._rosidl_message(found)

    def can_transform_core(self, target_frame: str, source_frame: str, time: Any) -> tuple[bool, str]:
        """Whether `lookup_transform_core` would give something, and what is wrong."""
        return _can(lambda: self.lookup_transform_core(target_frame, source_frame, time))

    def can_transform_full_core(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> tuple[bool, str]:
        """Whether `lookup_transform_full_core` would give something, and what is wrong."""
        asked = target_frame, target_time, source_frame, source_time, fixed_frame
        return _can(lambda: self.lookup_transform_full_core(*asked))

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """The newest time at which all between two frames is known; raises as `lookup_transform_core`."""
        with _named():
            return Time(nanoseconds=self._rosidl_buffer.lookup_transform(target_frame, source_frame).stamp)

    def lookupVelocityCore(
        self, tracking_frame: str, observation_frame: str, time: Any, averaging_interval: Any
    ) -> tuple[Triple, Triple]:
        """How `tracking_frame` moves in `observation_frame`: m/s and rad/s; raises as `lookup_transform_core`."""
        origin = (0.0, 0.0, 0.0), tracking_frame
        frames = tracking_frame, observation_frame, observation_frame
        return self.lookupVelocityFullCore(*frames, *origin, time, averaging_interval)

    def lookupVelocityFullCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Any,
        reference_point_frame: str,
        time: Any,
        averaging_interval: Any,
    ) -> tuple[Triple, Triple]:
        """The same in `reference_frame`, the first of a point in `reference_point_frame`."""
        frames = tracking_frame, observation_frame, reference_frame
        times = _nanoseconds(time) / _NS_PER_S, _nanoseconds(averaging_interval) / _NS_PER_S
        with _named():
            return velocity(self._rosidl_buffer, frames, reference_point, reference_point_frame, *times)

    def clear(self) -> None:
        """Forget what moves."""
        self._rosidl_buffer.clear()

    def all_frames_as_yaml(self) -> str:
        """Every frame with a parent: who sent it, how often, times; ``[]`` when there are no frames."""
        frames = self._rosidl_buffer.frames()
        lines = [] if frames else ["[]"]
        for name, info in frames.items():
            if info.parent is None:
                continue
            newest, oldest = info.newest or 0, info.oldest or 0
            lines += [
                f"{name}: ",
                f"  parent: '{info.parent}'",
                f"  broadcaster: '{self._rosidl_authorities.get(name, 'no recorded authority')}'",
                f"  rate: {info.count * _NS_PER_S / max(newest - oldest, _SHORTEST_NS):.3f}",
                f"  most_recent_transform: {newest / _NS_PER_S:.6f}",
                f"  oldest_transform: {oldest / _NS_PER_S:.6f}",
                f"  buffer_length: {(newest - oldest) / _NS_PER_S:.3f}",
            ]
        return "\n".join(lines) + "\n" * bool(frames)

    def all_frames_as_string(self) -> str:
        """A line for each frame: its parent."""
        frames = self._rosidl_buffer.frames().items()
        return "".join(f"Frame {name} exists with parent {info.parent or 'NO_PARENT'}.\n" for name, info in frames)

    def _frameExists(self, frame_id: str) -> bool:
        return frame_id in self._rosidl_buffer.frames()

    def _getFrameStrings(self) -> list[str]:
        return [*self._rosidl_buffer.frames()]

    def _rosidl_message(self, found: tf.Transform) -> TransformStamped:
        return found.to_message(cls=TransformStamped)


def _can(look_up: Callable[[], object]) -> tuple[bool, str]:
    """Whether that raises no TransformException, and the text of it."""
    try:
        look_up()
    except TransformException as error:
        return False, str(error)
    return True, ""


@contextmanager
def _named() -> Iterator[None]:
    """What is raised has tf2's names."""
    try:
        yield
    except (tf.TransformError, tf.InvalidTransformError) as error:
        kind = next(named for ours, named in _NAMES if isinstance(error, ours))
        raise kind(_text(error)) from None


def _text(error: tf.TransformError | tf.InvalidTransformError) -> str:
    """The error's text; of an extrapolation with the beginning that tf2 gives it, which programs look for."""
    if not isinstance(error, tf.ExtrapolationError):
        return str(error)
    into = f" into the {error.direction}" if error.direction else ""
    return f"Lookup would require extrapolation{into}. {error}"


def _nanoseconds(time: Any) -> int:
    if hasattr(time, "nanoseconds"):
        return int(time.nanoseconds)
    if hasattr(time, "sec") and hasattr(time, "nanosec"):
        return int(time.sec) * _NS_PER_S + int(time.nanosec)
    raise TypeError("time must have sec and nanosec, or nanoseconds.")
