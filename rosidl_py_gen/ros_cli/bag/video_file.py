"""Video file of constant frame rate, encoded by PyAV (extra ``video``).

The frames of a video are equally spaced, so each image becomes the frame nearest to its time. Of several images of one
frame, the last is written. An image is repeated until the frame of the next image. So times in the video are right to
half a frame.
"""

from __future__ import annotations

from contextlib import contextmanager
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any

import av
import numpy as np

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    Pixels = np.ndarray[Any, np.dtype[Any]]

_MAX_GAP_S = 3600
"""Maximum time in seconds between two images of a video; with a wrong clock, a frame would be repeated for years."""
_BT709, _LIMITED_RANGE = 1, 1
"""Numbers in the standard H.273 for the colour space and range that players assume."""


class VideoFile:
    """H.264 video file whose frames have the size of the first image, rounded to even numbers.

    Attributes:
        images: number of added images.
        frames: number of written frames; the last image is not among them before `finish`.
        dropped: number of images that were replaced by a later image of the same frame.
    """

    def __init__(self, path: Path, rate: Fraction) -> None:
        self._path, self._rate = path, rate
        self.images = self.frames = self.dropped = 0
        self._start_ns = 0
        self._pixels = np.empty((0, 0, 3), np.uint8)
        self._container: Any = None

    @property
    def repeated(self) -> int:
        return self.frames - (self.images - self.dropped)

    @property
    def is_padded(self) -> bool:
        return any(length % 2 for length in self._pixels.shape[:2])

    def _due(self, time_ns: int) -> int:
        frame = (time_ns - self._start_ns) * self._rate / NS_PER_S
        return ceil(frame - Fraction(1, 2))  # round() would alternate steps of 1 and 3 at half the rate

    def mismatch_reason(self, time_ns: int, pixels: Pixels) -> str:
        """Return a text that states why an image cannot be added to the video; empty if it can."""
        if not self.images:
            return ""
        if pixels.shape != self._pixels.shape:
            new, old = (f"{one.shape[1]} x {one.shape[0]}" for one in (pixels, self._pixels))
            return f"the size of the image is {new}, before {old}"
        gap_s = float((self._due(time_ns) - self.frames) / self._rate)
        return f"there was no image for {gap_s:.0f} s" if gap_s > _MAX_GAP_S else ""

    def add(self, time_ns: int, pixels: Pixels) -> None:
        """Add an image to the video, after writing the previous image repeatedly up to the time of this one."""
        if self.images:
            due = self._due(time_ns)
            self.dropped += due == self.frames
            self._write(due - self.frames)
        else:
            self._start_ns = time_ns
            with self._errors(*pixels.shape[:2]):
                self._open(*pixels.shape[:2])
        self._pixels = pixels
        self.images += 1

    def finish(self) -> None:
        """Write the last image, and the frames that the encoder has buffered."""
        self._write(1)
        with self._errors(*self._pixels.shape[:2]):
            self._encode(None)

    def close(self) -> None:
        """Close the video file."""
        if self._container is not None:
            self._container.close()

    @contextmanager
    def _errors(self, height: int, width: int) -> Iterator[None]:
        """Convert errors of FFmpeg in the block to `CommandError`; errors about the file stay `OSError`."""
        try:
            yield
        except av.FFmpegError as error:
            if isinstance(error, OSError):  # a full disk
                raise
            size = f"{width} x {height}"
            raise CommandError(f"the encoder does not accept frames of {size}: {error.strerror}") from None

    def _open(self, height: int, width: int) -> None:
        self._container = av.open(f"file:{self._path}", "w")  # a name with a colon is no address
        self._stream: Any = self._container.add_stream("libx264", rate=self._rate)
        self._stream.height, self._stream.width = height + height % 2, width + width % 2
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.color_range = _LIMITED_RANGE

    def _write(self, count: int) -> None:
        if not count:
            return
        height, width = self._pixels.shape[:2]
        even = np.pad(self._pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
        with self._errors(height, width):
            frame: Any = av.VideoFrame.from_ndarray(even, format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace=_BT709, dst_color_range=_LIMITED_RANGE)
            frame.time_base = 1 / self._rate
            for _ in range(count):
                frame.pts = self.frames
                self.frames += 1
                self._encode(frame)

    def _encode(self, frame: av.VideoFrame | None) -> None:
        self._container.mux(self._stream.encode(frame))
