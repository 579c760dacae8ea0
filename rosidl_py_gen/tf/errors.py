"""Why a transform cannot be told."""

from typing import Literal

from rosidl_py_gen.errors import RosidlError


class TransformError(RosidlError, LookupError):
    """There is no such transform, now or at that time."""


class UnknownFrameError(TransformError):
    """No transform names this frame; tf2's LookupException. A loop between frames is one, too."""


class ConnectivityError(TransformError):
    """The frames are in different trees; tf2's ConnectivityException."""


class ExtrapolationError(TransformError):
    """The frames are connected, but not at that time; tf2's ExtrapolationException.

    Attributes:
        frame: child frame of the transform that has no data at that time.
        direction: where that time is, seen from the data: ``past`` or ``future``.
    """

    def __init__(self, text: str, *, frame: str = "", direction: Literal["", "past", "future"] = "") -> None:
        super().__init__(text)
        self.frame = frame
        self.direction = direction


class TransformTimeoutError(TransformError, TimeoutError):
    """What was waited for did not come; the text has the last reason."""


class InvalidTransformError(RosidlError, ValueError):
    """No transform: equal or empty frames, values that are not finite, no rotation, or older than the buffer keeps."""
