"""Buffer and exceptions on which tf2_ros is based, implemented with `rosidl_py_gen.tf`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.logging import get_logger
from rclpy.time import Time

from rosidl_py_gen import tf
from rosidl_py_gen.numpy import matrix_to_quaternion

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]
Triple = tuple[float, float, float]
_NS_PER_S = 1_000_000_000
_MIN_SPAN_NS = 100_000
"""Minimum time span in nanoseconds over which the rate of a frame's transforms is calculated."""
_EARLIEST_TIME_S = 0.00001
"""Earliest time to look up, in seconds; not 0, because tf2 reads time 0 as "latest"."""


class TransformException(Exception):
    """Base class of errors about transforms."""


class ConnectivityException(TransformException):
    """Raised if two frames are in different trees."""


class LookupException(TransformException):
    """Raised if a frame is unknown."""


class ExtrapolationException(TransformException):
    """Raised if two frames are connected, but the transform at the requested time is not known."""


class InvalidArgumentException(TransformException):
    """Raised for a frame name that is empty or begins with a slash."""


class TimeoutException(TransformException):
    """Raised if a transform did not arrive in time."""


_EXCEPTIONS = (
    (tf.ConnectivityError, ConnectivityException),
    (tf.ExtrapolationError, ExtrapolationException),
    (tf.UnknownFrameError, LookupException),
    (tf.TransformError, TransformException),
    (tf.InvalidTransformError, InvalidArgumentException),
)


class BufferCore:
    """Buffer of the transforms of the last seconds, and of static transforms.

    Times are `Time` objects, or ``builtin_interfaces/Time`` messages.

    Args:
        cache_time: time for which transforms are stored. [default: 10 s]
    """

    def __init__(self, cache_time: Duration | None = None) -> None:
        seconds = 10.0 if cache_time is None else _nanoseconds(cache_time) / _NS_PER_S
        self._rosidl_buffer = tf.TransformBuffer(cache_time_s=seconds)
        self._rosidl_authorities: dict[str, str] = {}

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Store a transform; an invalid transform, or one that is too old, is logged and ignored."""
        self._rosidl_set(transform, authority, False)

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Store a transform that is valid at all times."""
        self._rosidl_set(transform, authority, True)

    def _rosidl_set(self, transform: TransformStamped, authority: str, is_static: bool) -> None:
        try:
            self._rosidl_buffer.set_transform(transform, static=is_static)
        except tf.InvalidTransformError as error:
            get_logger("tf2").warning(f"ignored a transform of {authority}: {error}")
            return
        self._rosidl_authorities[transform.child_frame_id.lstrip("/")] = authority

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Any) -> TransformStamped:
        """Return the transform from `source_frame` to `target_frame` at a time; time 0 means the latest.

        Raises:
            LookupException: a frame is unknown.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the frames are connected, but not at this time.
            InvalidArgumentException: the name of a frame is invalid.
        """
        with _tf2_errors():
            transform = self._rosidl_buffer.lookup_transform(target_frame, source_frame, _nanoseconds(time))
            return transform.to_message(cls=TransformStamped)

    def lookup_transform_full_core(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> TransformStamped:
        """Return the transform from `source_frame` at one time to `target_frame` at another time.

        The frame `fixed_frame` is assumed not to move between the times.

        Raises:
            LookupException: a frame is unknown.
            ConnectivityException: the frames are in different trees.
            ExtrapolationException: the frames are connected, but not at one of the times.
            InvalidArgumentException: the name of a frame is invalid.
        """
        times = _nanoseconds(target_time), _nanoseconds(source_time)
        with _tf2_errors():
            transform = self._rosidl_buffer.lookup_transform_full(
                target_frame, times[0], source_frame, times[1], fixed_frame
            )
            return transform.to_message(cls=TransformStamped)

    def can_transform_core(self, target_frame: str, source_frame: str, time: Any) -> tuple[bool, str]:
        """Return True and "" if `lookup_transform_core` would succeed, else False and the reason."""
        return _check_lookup(lambda: self.lookup_transform_core(target_frame, source_frame, time))

    def can_transform_full_core(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> tuple[bool, str]:
        """Return True and "" if `lookup_transform_full_core` would succeed, else False and the reason."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        return _check_lookup(lambda: self.lookup_transform_full_core(*arguments))

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """Return the latest time at which the transform between two frames is known.

        Raises:
            LookupException: a frame is unknown.
            ConnectivityException: the frames are in different trees.
            InvalidArgumentException: the name of a frame is invalid.
        """
        with _tf2_errors():
            return Time(nanoseconds=self._rosidl_buffer.lookup_transform(target_frame, source_frame).stamp)

    def lookupVelocityCore(
        self, tracking_frame: str, observation_frame: str, time: Any, averaging_interval: Any
    ) -> tuple[Triple, Triple]:
        """Return the linear and angular velocity of `tracking_frame` in `observation_frame`, in m/s and rad/s."""
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
        """Return the linear and angular velocity in axes of `reference_frame`, in m/s and rad/s.

        The linear velocity is the velocity of a point given in `reference_point_frame`.
        """
        frames = tracking_frame, observation_frame, reference_frame
        times = _nanoseconds(time) / _NS_PER_S, _nanoseconds(averaging_interval) / _NS_PER_S
        with _tf2_errors():
            return _velocity(self._rosidl_buffer, frames, reference_point, reference_point_frame, *times)

    def clear(self) -> None:
        """Remove all transforms except static transforms."""
        self._rosidl_buffer.clear()

    def all_frames_as_yaml(self) -> str:
        """Return each frame with its parent, sender, rate and times as YAML; ``[]`` if there are no frames."""
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
                f"  rate: {info.count * _NS_PER_S / max(newest - oldest, _MIN_SPAN_NS):.3f}",
                f"  most_recent_transform: {newest / _NS_PER_S:.6f}",
                f"  oldest_transform: {oldest / _NS_PER_S:.6f}",
                f"  buffer_length: {(newest - oldest) / _NS_PER_S:.3f}",
            ]
        return "\n".join(lines) + "\n" * bool(frames)

    def all_frames_as_string(self) -> str:
        """Return a text with a line for each frame and its parent."""
        frames = self._rosidl_buffer.frames().items()
        return "".join(f"Frame {name} exists with parent {info.parent or 'NO_PARENT'}.\n" for name, info in frames)

    def _frameExists(self, frame_id: str) -> bool:
        return frame_id in self._rosidl_buffer.frames()

    def _getFrameStrings(self) -> list[str]:
        return [*self._rosidl_buffer.frames()]


def _check_lookup(look_up: Callable[[], object]) -> tuple[bool, str]:
    """Call a lookup function; return True and "" if it succeeds, else False and the text of its TransformException."""
    try:
        look_up()
    except TransformException as error:
        return False, str(error)
    return True, ""


@contextmanager
def _tf2_errors() -> Iterator[None]:
    """Convert exceptions of `rosidl_py_gen.tf` in a block to exceptions of tf2."""
    try:
        yield
    except (tf.TransformError, tf.InvalidTransformError) as error:
        kind = next(kind for base, kind in _EXCEPTIONS if isinstance(error, base))
        raise kind(_error_text(error)) from None


def _error_text(error: tf.TransformError | tf.InvalidTransformError) -> str:
    """Return the error text for an exception of tf2.

    Texts about extrapolation begin as in tf2, because programs search for these words.
    """
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


def _velocity(
    buffer: tf.TransformBuffer,
    frames: tuple[str, str, str],
    point: Any,
    point_frame: str,
    time_s: float,
    interval_s: float,
) -> tuple[Triple, Triple]:
    """Return the linear and angular velocity of a frame in m/s and rad/s, calculated in the same way as by tf2.

    Args:
        buffer: transforms.
        frames: the moving frame, the frame in which it is observed, and the frame of the result.
        point: point to which the linear velocity applies, in `point_frame`.
        point_frame: frame of the point.
        time_s: middle of the interval; the interval is earlier if the latest transform is too old.
        interval_s: length of the interval over which the velocity is averaged.
    """
    tracking_frame, observation_frame, reference_frame = frames
    end = min(time_s + interval_s * 0.5, buffer.lookup_transform(observation_frame, tracking_frame).stamp / 1e9)
    start = max(_EARLIEST_TIME_S + interval_s, end) - interval_s
    before, after = (
        buffer.lookup_transform(observation_frame, tracking_frame, round(time * 1e9)) for time in (start, end)
    )
    now = round(time_s * 1e9)
    result = buffer.lookup_transform(reference_frame, tracking_frame, now)
    with np.errstate(all="ignore"):  # as in tf2, an interval of zero results in NaN
        angular = result.rotate(
            before.rotate(_rotation_vector(before.matrix[:3, :3].T @ after.matrix[:3, :3])) / np.float64(end - start)
        )
        linear = result.rotate((after.translation - before.translation) / np.float64(end - start))
    linear += np.cross(result.translation, angular)
    # An elementwise product, as in tf2, not a cross product.
    linear += angular * (buffer.lookup_transform(reference_frame, point_frame, now).apply(point) - result.translation)
    return _to_triple(linear), _to_triple(angular)


def _rotation_vector(rotation: Any) -> Any:
    """Return the axis of a rotation matrix multiplied by its angle; as in tf2, the angle may exceed half a turn."""
    x, y, z, w = quaternion = matrix_to_quaternion(rotation)
    if np.trace(rotation) <= 0 and quaternion[np.argmax(np.diag(rotation))] < 0:
        x, y, z, w = -quaternion
    length = math.sqrt(max(0.0, 1.0 - w * w))
    return np.array((x, y, z)) / length * 2.0 * math.acos(min(max(w, -1.0), 1.0)) if length > 1e-15 else np.zeros(3)


def _to_triple(values: Any) -> Triple:
    x, y, z = values.tolist()
    return x, y, z
