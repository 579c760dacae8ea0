"""Conversion of pixels from one encoding to another.

Results are those of cv_bridge with OpenCV: the brightness has the weights of BT.601, YUV is BT.601 in the video range,
and 16 bits become 8 by their value, not by their upper half. Bayer patterns are interpolated bilinearly. Values that
have no colour, for example depths, are never converted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.numpy.common import ConversionError

Pixels = np.ndarray[Any, np.dtype[Any]]

_COLORS = {f"{order}{bits}": (order, bits) for order in ("rgb", "bgr", "rgba", "bgra", "mono") for bits in (8, 16)}
"""Encodings that can be converted to; all others can only be converted from."""
_SAME = {"8UC1": "mono8", "16UC1": "mono16"}
_PACKED = {"yuv422": (1, 0, 2), "uyvy": (1, 0, 2), "yuv422_yuy2": (0, 1, 3), "yuyv": (0, 1, 3)}
"""Offsets of the brightness of the first pixel, of blue and of red in the four bytes of two pixels."""
_PLANES = ("nv21", "nv24")
_WEIGHTS = (19595, 38470, 7471)
"""Weights of red, green and blue in the brightness, in units of 1/65536."""


def converted(array: Pixels, encoding: str, to: str) -> Pixels:
    """Return the pixels of `encoding` converted to `to`; the same array if nothing changes."""
    if to not in _COLORS:
        hint = did_you_mean(to, _COLORS) if isinstance(to, str) else ""
        raise ConversionError(f"to: cannot convert to {to!r:.50}{hint}; expected one of {', '.join(_COLORS)}")
    source = _SAME.get(encoding, encoding)
    if source == to:
        return array
    if encoding == "16UC1":
        raise ConversionError(
            f"encoding: 16UC1 may be depths, which cannot become {to}; mono16 has the same numbers, which can be scaled"
        )
    order, bits = _COLORS[to]
    native = array.astype(array.dtype.newbyteorder("="), copy=False)
    channels = _channels(native, source)
    if channels is None:
        raise ConversionError(f"encoding: {encoding} has no colours that could be converted to {to}")
    dtype = np.dtype(f"u{bits // 8}")
    if order == "mono":
        gray = channels["mono"] if "mono" in channels else _brightness(channels)
        return _as_depth(gray, dtype)
    result = np.empty((*next(iter(channels.values())).shape, len(order)), dtype)
    for number, letter in enumerate(order):
        if letter == "a" and "a" not in channels:
            result[..., number] = np.iinfo(dtype).max
        else:
            result[..., number] = _as_depth(channels.get(letter, channels.get("mono", result[..., number])), dtype)
    return result


def _channels(array: Pixels, encoding: str) -> dict[str, Pixels] | None:
    """Return the planes by the letters r, g, b and a, or one called mono; None if the encoding has no colours."""
    if encoding in _COLORS:
        order = _COLORS[encoding][0]
        return {"mono": array} if order == "mono" else {letter: array[..., at] for at, letter in enumerate(order)}
    if encoding.startswith("bayer_"):
        return _bayer(array, encoding[6:10])
    if encoding in _PACKED:
        return _from_packed(array, *_PACKED[encoding])
    if encoding in _PLANES:
        return _from_planes(array, encoding)
    return None


def _brightness(channels: dict[str, Pixels]) -> Pixels:
    total = np.full(channels["r"].shape, 1 << 15, np.uint32)
    for letter, weight in zip("rgb", _WEIGHTS, strict=True):
        total += channels[letter] * np.uint32(weight)
    brightness: Pixels = (total >> 16).astype(channels["r"].dtype)
    return brightness


def _as_depth(values: Pixels, dtype: np.dtype[Any]) -> Pixels:
    """Scale values from the full range of their type to that of another."""
    if values.dtype == dtype:
        return values
    if dtype.itemsize == 2:
        wide: Pixels = values.astype(np.uint16) * np.uint16(257)
        return wide
    return ((values.astype(np.uint32) + 128) // 257).astype(np.uint8)


# ------------------------------------------------------------------------------------------------------------------ YUV


def _from_packed(array: Pixels, first: int, blue: int, red: int) -> dict[str, Pixels]:
    height, width = array.shape[:2]
    if width % 2:
        raise ConversionError(f"width: two pixels share their colour, got {width}")
    pairs = np.ascontiguousarray(array).reshape(height, width // 2, 4)
    bright = pairs[..., first::2].reshape(height, width)
    return _rgb(bright, np.repeat(pairs[..., blue], 2, 1), np.repeat(pairs[..., red], 2, 1))


def _from_planes(array: Pixels, encoding: str) -> dict[str, Pixels]:
    rows, width = array.shape
    flat = np.ascontiguousarray(array)
    if encoding == "nv24":
        height = rows // 3
        colors = flat[height:].reshape(height, width, 2)
        return _rgb(flat[:height], colors[..., 0], colors[..., 1])
    height = rows * 2 // 3
    if width % 2 or height % 2:
        raise ConversionError(f"height, width: four pixels share their colour, got {height} x {width}")
    colors = flat[height:].reshape(height // 2, width // 2, 2).repeat(2, 0).repeat(2, 1)
    return _rgb(flat[:height], colors[..., 1], colors[..., 0])


def _rgb(y: Pixels, u: Pixels, v: Pixels) -> dict[str, Pixels]:
    bright = (np.maximum(y, 16).astype(np.int32) - 16) * 1220542 + (1 << 19)
    blue, red = u.astype(np.int32) - 128, v.astype(np.int32) - 128
    planes = {"r": bright + 1673527 * red, "g": bright - 852492 * red - 409993 * blue, "b": bright + 2116026 * blue}
    return {letter: np.clip(plane >> 20, 0, 255).astype(np.uint8) for letter, plane in planes.items()}


# ---------------------------------------------------------------------------------------------------------------- Bayer


def _bayer(array: Pixels, pattern: str) -> dict[str, Pixels]:
    """Return each colour: measured where the pattern has it, elsewhere the mean of the neighbours."""
    height, width = array.shape
    if height < 2 or width < 2:
        raise ConversionError(f"height, width: a Bayer pattern has 2 x 2 pixels at least, got {height} x {width}")
    return {letter: _interpolated(array, pattern, letter) for letter in "rgb"}


def _interpolated(array: Pixels, pattern: str, letter: str) -> Pixels:
    height, width = array.shape
    values = np.zeros((height + 2, width + 2), np.uint32)
    weights = np.zeros((height + 2, width + 2), np.uint32)
    inner_values, inner_weights = values[1:-1, 1:-1], weights[1:-1, 1:-1]
    places = [(at // 2, at % 2) for at, one in enumerate(pattern) if one == letter]
    for row, column in places:
        inner_values[row::2, column::2] = array[row::2, column::2]
        inner_weights[row::2, column::2] = 1
    total, count = (_neighbours(plane, letter != "g") for plane in (values, weights))
    result: Pixels = ((total + count // 2) // np.maximum(count, 1)).astype(array.dtype)
    for row, column in places:
        result[row::2, column::2] = array[row::2, column::2]
    return result


def _neighbours(plane: Pixels, with_corners: bool) -> Pixels:
    """Return for each element the sum of its direct neighbours, with corners of all eight."""
    total: Pixels = plane[:-2, 1:-1] + plane[2:, 1:-1] + plane[1:-1, :-2] + plane[1:-1, 2:]
    if with_corners:
        total = total + plane[:-2, :-2] + plane[:-2, 2:] + plane[2:, :-2] + plane[2:, 2:]
    return total
