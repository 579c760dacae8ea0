"""Types of OpenCV, and conversion of pixels between encodings. Errors are RuntimeError, as from C++.

As in cv_bridge, only encodings with colours are converted to other encodings with colours. All other conversions change
only the depth (type of the numbers): between 8 and 16 bits in proportion, otherwise by value.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from rosidl_py_gen.numpy import ConversionError, convert_pixels

Pixels = np.ndarray[Any, np.dtype[Any]]

DEPTHS = ("8U", "8S", "16U", "16S", "32S", "32F", "64F")
"""Names of depths (types of numbers) in the order of OpenCV's numbers."""
NUMPY_DEPTHS = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
_GENERIC_ENCODING = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)(?:C([0-9]+))?")
_CHANNELS = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
_CHANNELS.update({f"bayer_{order}": 1 for order in ("rggb", "bggr", "gbrg", "grbg")})
_PACKED = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
"""Index of the byte with the brightness, by encoding, for encodings with two bytes for each pixel."""
_INT_LIMIT = 2.0**31


class _Encoding(NamedTuple):
    depth: str  # of OpenCV
    channels: int
    family: str | None  # rgb, mono, ...; None without colours


def _parse(encoding: Any) -> _Encoding:
    if not isinstance(encoding, str):
        raise TypeError(f"encoding: expected a str, got {encoding!r:.50}")
    for bits in ("8", "16"):
        family = encoding.removesuffix(bits)
        if family != encoding and family in _CHANNELS:
            return _Encoding(f"{bits}U", _CHANNELS[family], family)
    if encoding in _PACKED:
        return _Encoding("8U", 2, encoding)
    match = _GENERIC_ENCODING.fullmatch(encoding)
    if match is None or not 0 < int(match[2] or 1) <= 512:
        raise RuntimeError(f"Unrecognized image encoding [{encoding:.50}]")
    return _Encoding(match[1], int(match[2] or 1), None)


@cache
def opencv() -> Any:
    """Return the module of OpenCV, or None if it is not installed."""
    try:
        return import_module("cv2")
    except ImportError:
        return None


def _depth_bits() -> int:
    """Return the number of low bits that hold the depth in a type number of OpenCV: 3, or 5 from OpenCV 5 on."""
    cv2 = opencv()
    return 3 if cv2 is None else int(cv2.CV_8UC2).bit_length() - 1


def getCvType(encoding: str) -> int:
    """Return OpenCV's type number, which contains depth and number of channels, for an encoding."""
    parsed_encoding = _parse(encoding)
    return DEPTHS.index(parsed_encoding.depth) | (parsed_encoding.channels - 1) << _depth_bits()


def CV_MAT_CNWrap(i: int) -> int:
    """Return the number of channels in a type number of OpenCV."""
    return (i >> _depth_bits()) + 1


def CV_MAT_DEPTHWrap(i: int) -> int:
    """Return the number of the depth in a type number of OpenCV."""
    return i & (1 << _depth_bits()) - 1


def cvtColor2(image: Any, encoding_in: str, encoding_out: str) -> Pixels:
    """Return a copy of pixels converted to another encoding; raise RuntimeError if the conversion is not possible."""
    pixels = np.asarray(image)
    if encoding_out in ("", encoding_in):
        copy: Pixels = pixels.copy()
        return copy
    before, after = _parse(encoding_in), _parse(encoding_out)
    if after.family is not None and before.family is None:
        raise RuntimeError(f"[{encoding_in}] has no colours, but [{encoding_out}] has")
    if after.family is None or before.family == after.family:
        if before.channels != after.channels:
            raise RuntimeError(f"[{encoding_in}] and [{encoding_out}] do not have the same number of channels")
        return _convert_depth(pixels, before.depth, after.depth)
    if before.family in _PACKED and after.family == "mono":
        return _convert_depth(pixels[..., _PACKED[before.family]].copy(), before.depth, after.depth)
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    try:
        result: Pixels = convert_pixels(pixels, encoding_in, encoding_out)
    except ConversionError as error:
        raise RuntimeError(f"Unsupported conversion from [{encoding_in}] to [{encoding_out}]: {error}") from None
    return result


def _convert_depth(pixels: Pixels, before: str, after: str) -> Pixels:
    """Convert pixels to another depth; numbers outside of its range become its minimum or maximum, as with OpenCV."""
    bits = before[:-1], after[:-1]
    dtype = np.dtype(NUMPY_DEPTHS[DEPTHS.index(after)])
    if bits == ("8", "16"):
        pixels = pixels.astype(np.int32) * 257
    elif bits == ("16", "8"):
        pixels = pixels.astype(np.float64) / 257
    if dtype.kind == "f" or (pixels.dtype.kind in "iu" and np.can_cast(pixels.dtype, dtype)):
        return pixels.astype(dtype)
    if pixels.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            pixels = np.where(np.abs(pixels) < _INT_LIMIT, np.rint(pixels), -_INT_LIMIT)
    limits = np.iinfo(dtype)
    return np.clip(pixels, limits.min, limits.max).astype(dtype)
