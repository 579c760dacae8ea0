"""Why a transform cannot be told."""

from rosidl_py_gen.errors import RosidlError


class TransformError(RosidlError, LookupError):
    """There is no such transform, now or at that time."""


class UnknownFrameError(TransformError):
    """No transform names this frame; tf2's LookupException. A loop between frames is one, too."""


class ConnectivityError(TransformError):
    """The frames are in different trees; tf2's ConnectivityException."""


class ExtrapolationError(TransformError):
    """The frames are connected, but not at that time; tf2's ExtrapolationException."""


class TransformTimeoutError(TransformError, TimeoutError):
    """What was waited for did not come; the text has the last reason."""


class InvalidTransformError(RosidlError, ValueError):
    """No transform: equal or empty frames, values that are not finite, no rotation, or older than the buffer keeps."""
