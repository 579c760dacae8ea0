"""Conversions between ``sensor_msgs/msg/Image`` and arrays; encodings are those of sensor_msgs/image_encodings.hpp."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.numpy.colors import converted
from rosidl_py_gen.numpy.common import (
    ConversionError,
    M,
    check_count,
    contiguous_native,
    flat_bytes,
    message_class,
    reads_message,
)

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message

_BAYER = [f"bayer_{order}{bits}" for order in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)]
_KNOWN: dict[str, tuple[str, int]] = {
    **{f"{order}{bits}": (f"u{bits // 8}", len(order)) for order in ("rgb", "bgr", "rgba", "bgra") for bits in (8, 16)},
    **{name: ("u2" if name.endswith("16") else "u1", 1) for name in ("mono8", "mono16", *_BAYER)},
    **dict.fromkeys(("yuv422", "yuv422_yuy2", "uyvy", "yuyv"), ("u1", 2)),
}
_PLANES = {"nv21": (3, 2), "nv24": (3, 1)}
"""Rows of bytes and the rows of pixels that they store: a plane of brightness, then one of colour."""
_GENERIC = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C([0-9]{0,4})")
_KINDS = {"U": "u", "S": "i", "F": "f"}
_DEFAULT_ENCODING = {("u1", 1): "mono8", ("u2", 1): "mono16", ("u1", 3): "rgb8", ("u1", 4): "rgba8", ("u2", 3): "rgb16"}


class _Layout(NamedTuple):
    dtype: np.dtype[Any]
    channels: int
    rows: tuple[int, int]  # number of rows of bytes that store a number of rows of pixels


def _layout(encoding: Any) -> _Layout:
    if not isinstance(encoding, str):
        raise ConversionError(f"encoding: expected text, got {encoding!r:.50}")
    if encoding in _PLANES:
        return _Layout(np.dtype("u1"), 1, _PLANES[encoding])
    if encoding in _KNOWN:
        kind, channels = _KNOWN[encoding]
        return _Layout(np.dtype(kind), channels, (1, 1))
    match = _GENERIC.fullmatch(encoding)
    if match is None or match[2] == "0":
        known = [*_KNOWN, *_PLANES, "8UC3", "16UC1", "32FC1"]
        raise ConversionError(f'encoding: "{encoding[:50]}" is not known{did_you_mean(encoding, known)}')
    return _Layout(np.dtype(f"{_KINDS[match[1][-1]]}{int(match[1][:-1]) // 8}"), int(match[2] or 1), (1, 1))


@reads_message("a sensor_msgs/msg/Image")
def image_to_array(image: Any, *, to: str | None = None, copy: bool = False) -> np.ndarray[Any, Any]:
    """Return the pixels of a ``sensor_msgs/msg/Image``.

    Args:
        to: convert to this encoding: ``rgb8``, ``bgr8``, ``rgba8``, ``bgra8``, ``mono8``, or one of these with 16. All
            encodings with colours can be converted, YUV and Bayer patterns as well.
        copy: return a copy; otherwise, unless it was converted, the result shares the bytes of `image`, and is
            read-only if those are.

    Returns:
        Shape ``(height, width)``, or ``(height, width, channels)`` for several channels: 3 for ``rgb8``, 2 for
        ``yuyv``. ``nv21`` and ``nv24`` are returned as their planes, ``(height * 3 // 2, width)`` and ``(height * 3,
        width)``.
        Without `to`, values are unchanged: a big-endian image has a big-endian dtype.

    Raises:
        ConversionError: the encoding is unknown, or has no colours for `to`; `step` is shorter than a row, or `data`
            than the image.
    """
    dtype, channels, (more, less) = _layout(image.encoding)
    if image.is_bigendian:
        dtype = dtype.newbyteorder(">")
    height, width, step = (check_count(getattr(image, name), name) for name in ("height", "width", "step"))
    if height % less:
        raise ConversionError(f"height: {image.encoding} needs an even number of rows, got {height}")
    rows, row = height * more // less, width * channels * dtype.itemsize
    if step < row and rows:
        raise ConversionError(f"step: {step} bytes, but a row of {width} pixels of {image.encoding} needs {row}")
    data = flat_bytes(image.data, "data")
    needed = step * (rows - 1) + row if rows and row else 0
    if len(data) < needed:
        raise ConversionError(f"data: {len(data)} bytes, but {rows} rows of {step} bytes need {needed}")
    array: np.ndarray[Any, Any] = np.ndarray(
        (rows, width, channels), dtype, data[:needed], strides=(step, channels * dtype.itemsize, dtype.itemsize)
    )
    shaped = array[:, :, 0] if channels == 1 else array
    result = shaped if to is None else converted(shaped, image.encoding, to)
    return result.copy() if copy and result is shaped else result


def array_to_image(
    array: Any, encoding: str | None = None, *, header: Message | None = None, cls: type[M] | None = None
) -> M:
    """Return an image message of an array; the inverse of `image_to_array`.

    Args:
        array: pixels as `image_to_array` returns them. A contiguous array is not copied: the message shares its memory.
        encoding: None means ``mono8``, ``mono16``, ``rgb8``, ``rgba8`` or ``rgb16`` if the shape fits, else the OpenCV
            name, such as ``32FC1``.
        header: a ``std_msgs/msg/Header``.
        cls: the class of the result; None means the class that `get_message` returns.

    Raises:
        ConversionError: dtype or shape do not fit the encoding, or no encoding fits them.
    """
    array, encoding = checked_encoding(array, encoding)
    dtype, channels, (more, less) = _layout(encoding)
    rows, width = array.shape[:2]
    piece, is_big = contiguous_native(array)
    values = {"header": header} if header is not None else {}
    return message_class(cls, "sensor_msgs/msg/Image")(
        height=rows * less // more,
        width=width,
        encoding=encoding,
        is_bigendian=int(is_big),
        step=width * channels * dtype.itemsize,
        data=piece.reshape(-1).view(np.uint8),
        **values,
    )


def convert_pixels(array: Any, encoding: str, to: str) -> np.ndarray[Any, Any]:
    """Return pixels of one encoding converted to another; the same array if nothing changes.

    Args:
        array: pixels as `image_to_array` returns them.
        to: an encoding, as for `image_to_array`.

    Raises:
        ConversionError: dtype or shape do not fit the encoding; it is unknown, or has no colours for `to`.
    """
    pixels, _ = checked_encoding(array, encoding)
    return converted(pixels, encoding, to)


def checked_encoding(array: Any, encoding: str | None) -> tuple[np.ndarray[Any, Any], str]:
    """Return the array, and its encoding, guessed if None; raises `ConversionError` if they do not fit."""
    array = np.asarray(array)
    if array.ndim not in (2, 3):
        raise ConversionError(f"array: expected rows, columns and perhaps channels, got shape {array.shape}")
    channels = array.shape[2] if array.ndim == 3 else 1
    if encoding is None:
        encoding = _guess(array.dtype, channels)
    dtype, expected, (more, _) = _layout(encoding)
    if array.dtype.newbyteorder("=") != dtype or channels != expected:
        raise ConversionError(
            f"array: {encoding} needs {dtype} with {expected} channels, got {array.dtype} with {channels}"
        )
    if array.shape[0] % more:
        raise ConversionError(f"array: {encoding} needs a multiple of {more} rows, got {array.shape[0]}")
    return array, encoding


def _guess(dtype: np.dtype[Any], channels: int) -> str:
    kind = f"{dtype.kind}{dtype.itemsize}"
    generic = f"{dtype.itemsize * 8}{dtype.kind.upper().replace('I', 'S')}C{channels}"
    if (kind, channels) not in _DEFAULT_ENCODING and (_GENERIC.fullmatch(generic) is None or not channels):
        raise ConversionError(f"array: no encoding has {dtype} with {channels} channels")
    return _DEFAULT_ENCODING.get((kind, channels), generic)
