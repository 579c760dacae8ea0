"""Errors of transforms."""

from __future__ import annotations

from typing import Literal

from rosidl_py_gen.errors import RosidlError


class TransformError(RosidlError, LookupError):
    """The transform is not known, or not at that time."""


class UnknownFrameError(TransformError):
    """No transform names this frame, or the frames form a loop; tf2's LookupException."""


class ConnectivityError(TransformError):
    """The frames are in different trees; tf2's ConnectivityException."""


class ExtrapolationError(TransformError):
    """The frames are connected, but not at that time; tf2's ExtrapolationException.

    Attributes:
        frame: child frame of the transform that has no data at that time.
        direction: position of that time relative to the data: ``past`` or ``future``.
    """

    def __init__(self, text: str, *, frame: str = "", direction: Literal["", "past", "future"] = "") -> None:
        super().__init__(text)
        self.frame = frame
        self.direction = direction


class TransformTimeoutError(TransformError, TimeoutError):
    """A transform was not known within the timeout; the text has the last reason."""


class InvalidTransformError(RosidlError, ValueError):
    """A transform with equal or empty frames, values that are not finite, no rotation, or too old for the buffer."""
