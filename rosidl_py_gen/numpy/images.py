"""Conversions between images and arrays, and from one encoding of pixels to another.

Encodings of ``sensor_msgs/msg/Image`` have the names of sensor_msgs/image_encodings.hpp. Converted pixels equal the
pixels of cv_bridge with OpenCV: brightness has the weights of BT.601, YUV is BT.601 in the video range, and 16 bits
become 8 by their value, not by their upper half. Bayer patterns are interpolated bilinearly. Values without colour, for
example depths, are never converted.

``sensor_msgs/msg/CompressedImage`` is converted by Pillow (extra ``images``). Its field `format` has the forms that
compressed_image_transport and compressed_depth_image_transport write: ``jpeg`` or ``png`` alone,
``bgr8; jpeg compressed bgr8``, ``16UC1; compressedDepth png``.
"""

from __future__ import annotations

import re
import struct
from io import BytesIO
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.numpy.common import (
    ConversionError,
    M,
    check_count,
    check_flag,
    contiguous_native,
    flat_bytes,
    message_class,
    reads_message,
)

if TYPE_CHECKING:
    from types import ModuleType

    from rosidl_py_gen.cdr import Message

Pixels = np.ndarray[Any, np.dtype[Any]]

_COLORS = {f"{order}{bits}": (order, bits) for order in ("rgb", "bgr", "rgba", "bgra", "mono") for bits in (8, 16)}
"""Encodings to which pixels can be converted, with the order and bits of their channels. Images in other encodings can
only be converted from."""
_PACKED = {"yuv422": (1, 0, 2), "uyvy": (1, 0, 2), "yuv422_yuy2": (0, 1, 3), "yuyv": (0, 1, 3)}
"""Byte offsets of the first pixel's brightness, of blue and of red in the four bytes that encode two pixels, by
encoding."""
_KNOWN: dict[str, tuple[str, int]] = {
    **{name: (f"u{bits // 8}", 1 if order == "mono" else len(order)) for name, (order, bits) in _COLORS.items()},
    **{f"bayer_{order}{bits}": (f"u{bits // 8}", 1) for order in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)},
    **dict.fromkeys(_PACKED, ("u1", 2)),
}
_PLANES = {"nv21": (3, 2), "nv24": (3, 1)}
"""Number of byte rows for a number of pixel rows, by encoding. An image has a plane of brightness, then a plane of
colour."""
_GENERIC = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C([0-9]{0,4})")
_KINDS = {"U": "u", "S": "i", "F": "f"}
_DEFAULT_ENCODING = {("u1", 1): "mono8", ("u2", 1): "mono16", ("u1", 3): "rgb8", ("u1", 4): "rgba8", ("u2", 3): "rgb16"}
_SAME = {"8UC1": "mono8", "16UC1": "mono16"}
_WEIGHTS = (19595, 38470, 7471)
"""Weights of red, green and blue in the brightness of a pixel, in units of 1/65536."""


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
    if check_flag(image.is_bigendian, "is_bigendian"):
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
    """Return an image message with the pixels of an array, the inverse of `image_to_array`.

    Args:
        array: pixels as `image_to_array` returns them. A contiguous array is not copied: the message shares its memory.
        encoding: None means ``mono8``, ``mono16``, ``rgb8``, ``rgba8`` or ``rgb16`` if the shape fits, else the OpenCV
            name, such as ``32FC1``.
        header: a ``std_msgs/msg/Header``.
        cls: class of the message; None uses `get_message`.

    Raises:
        ConversionError: dtype or shape do not fit the encoding, or no encoding fits them.
    """
    array, encoding = checked_encoding(array, encoding)
    dtype, channels, (more, less) = _layout(encoding)
    rows, width = array.shape[:2]
    piece, is_big = contiguous_native(array)
    return message_class(cls, "sensor_msgs/msg/Image", header)(
        height=rows * less // more,
        width=width,
        encoding=encoding,
        is_bigendian=int(is_big),
        step=width * channels * dtype.itemsize,
        data=piece.reshape(-1).view(np.uint8),
    )


def convert_pixels(array: Any, encoding: str, to: str) -> np.ndarray[Any, Any]:
    """Return pixels converted from one encoding to another; the same array if nothing changes.

    Args:
        array: pixels as `image_to_array` returns them.
        encoding: encoding of the array.
        to: an encoding, as for `image_to_array`.

    Raises:
        ConversionError: dtype or shape do not fit the encoding; it is unknown, or has no colours for `to`.
    """
    pixels, _ = checked_encoding(array, encoding)
    return converted(pixels, encoding, to)


def checked_encoding(array: Any, encoding: str | None) -> tuple[np.ndarray[Any, Any], str]:
    """Return pixels as an array, and their encoding, which is guessed from dtype and shape if None.

    Raises `ConversionError` if array and encoding do not fit.
    """
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


# -------------------------------------------------------------------------------------------------------------- colours


def converted(array: Pixels, encoding: str, to: str) -> Pixels:
    """Return pixels converted from one encoding to another; the same array if nothing changes.

    Raises `ConversionError` if `encoding` has no colours, or `to` is not an encoding that can be made.
    """
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
    """Return the colour planes of pixels by the letters r, g, b and a.

    Pixels of brightness have one plane, called mono. Returns None if the encoding has no colours.
    """
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
    """Return brightness or colour values scaled from the full range of their type, uint8 or uint16, to the full range
    of another type.
    """
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
    """Return the red, green and blue planes of a Bayer image: measured values where the pattern has the colour, else
    interpolated.
    """
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
    """Return, for each element of a padded plane, the sum of its four neighbours, or of all eight neighbours if
    `with_corners`.
    """
    total: Pixels = plane[:-2, 1:-1] + plane[2:, 1:-1] + plane[1:-1, :-2] + plane[1:-1, 2:]
    if with_corners:
        total = total + plane[:-2, :-2] + plane[:-2, 2:] + plane[2:, :-2] + plane[2:, 2:]
    return total


# ---------------------------------------------------------------------------------------------------- compressed images


_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP")
_ENCODINGS = {"L": "mono8", "RGB": "rgb8", "RGBA": "rgba8", "I;16": "mono16", "I;16B": "mono16", "F": "32FC1"}
_OTHER_MODES = {"1": "L", "P": "RGB", "PA": "RGBA", "LA": "RGBA", "CMYK": "RGB", "YCbCr": "RGB", "RGBX": "RGB"}
_DEPTH_HEADER = struct.Struct("<iff")
"""Struct layout of the header before the PNG data of compressed_depth_image_transport: a format, and two parameters of
32FC1."""
_MAX_GRAY = 65535


@reads_message("a sensor_msgs/msg/CompressedImage")
def compressedimage_to_array(
    image: Any, *, to: str | None = None, max_pixels: int = 64_000_000
) -> np.ndarray[Any, np.dtype[Any]]:
    """Return the pixels of a ``sensor_msgs/msg/CompressedImage``: JPEG, PNG, TIFF, WebP, or a depth image.

    Args:
        to: convert to this encoding, as `image_to_array` does.
        max_pixels: refuse pictures with more pixels; a few bytes can contain very many. For more than 179 million,
            ``PIL.Image.MAX_IMAGE_PIXELS`` must be raised as well.

    Returns:
        uint8 of shape ``(height, width, 3)``, in the order red, green, blue for every encoding;
        ``(height, width, 4)`` if some pixels are transparent; ``(height, width)`` of uint8 or uint16 without colours.
        Depths are uint16, or float32 with NaN for unknown depths.

    Raises:
        ConversionError: the data is damaged, too large, or has another format; or it cannot be converted to `to`.
        ExtraMissingError: Pillow is not installed.
    """
    text = image.format
    if not isinstance(text, str):
        raise ConversionError(f"format: expected text, got {text!r:.50}")
    data = flat_bytes(image.data, "data")
    before, _, how = text.partition(";")
    if "compressedDepth" in text:
        array, encoding = _depth(data, before.strip(), how, max_pixels)
    else:
        array, encoding = _decompress(data, max_pixels)
        if encoding == "mono16" and before.strip() == "16UC1":
            encoding = "16UC1"
        if "compressed rgb" in how and array.ndim == 3:  # OpenCV expects blue first, but red was first
            array = np.ascontiguousarray(array[..., [2, 1, 0, *range(3, array.shape[2])]])
    return array if to is None else converted(array, encoding, to)


def _decompress(data: Pixels, max_pixels: int) -> tuple[Pixels, str]:
    pillow = pillow_image()
    if bytes(data[:4]) == b"\x89PNG" and len(data) > 25 and data[24] == 16 and data[25] in (2, 6):
        raise ConversionError("data: PNG with 16 bits for each colour, of which Pillow reads only 8")
    try:
        with pillow.open(BytesIO(data.tobytes()), formats=_FORMATS) as picture:
            if picture.width * picture.height > max_pixels:
                size = f"{picture.width} x {picture.height} pixels"
                raise ConversionError(f"data: {len(data)} bytes contain {size}, more than max_pixels={max_pixels}")
            if picture.mode in _OTHER_MODES:
                has_alpha = picture.mode[-1] == "A" or "transparency" in picture.info
                picture = picture.convert("RGBA" if has_alpha else _OTHER_MODES[picture.mode])
            if picture.mode == "I":  # PNG with 16 bits in older versions of Pillow
                numbers = np.array(picture)
                if numbers.size and not 0 <= numbers.min() <= numbers.max() <= _MAX_GRAY:
                    limits = f"{numbers.min()} to {numbers.max()}"
                    raise ConversionError(f"data: the picture has values from {limits}; expected 0 to {_MAX_GRAY}")
                return numbers.astype(np.uint16), "mono16"
            if picture.mode not in _ENCODINGS:
                raise ConversionError(f"data: no encoding fits the mode {picture.mode} of the picture")
            array = np.array(picture)
            return array.astype(array.dtype.newbyteorder("="), copy=False), _ENCODINGS[picture.mode]
    except ConversionError:
        raise
    except pillow.UnidentifiedImageError:
        raise ConversionError(f"data: {len(data)} bytes are not a picture: not {', '.join(_FORMATS)}") from None
    except pillow.DecompressionBombError as error:
        raise ConversionError(
            f"data: {len(data)} bytes contain more pixels than max_pixels={max_pixels}, or than Pillow allows "
            f"(PIL.Image.MAX_IMAGE_PIXELS): {error!s:.200}"
        ) from None
    except Exception as error:  # decoders of Pillow raise OSError, SyntaxError, struct.error and others
        raise ConversionError(f"data: {len(data)} bytes are not a picture: {error!s:.200}") from None


def _depth(data: Pixels, encoding: str, how: str, max_pixels: int) -> tuple[Pixels, str]:
    if "rvl" in how:
        raise ConversionError(f"format: {how.strip()} is not supported; expected compressedDepth png")
    if len(data) < _DEPTH_HEADER.size:
        raise ConversionError(f"data: {len(data)} bytes, but the header of a depth image needs {_DEPTH_HEADER.size}")
    _, scale, offset = _DEPTH_HEADER.unpack(data[: _DEPTH_HEADER.size].tobytes())
    array, stored = _decompress(data[_DEPTH_HEADER.size :], max_pixels)
    if encoding != "32FC1":
        return array, "16UC1" if stored == "mono16" else stored
    if array.dtype != np.uint16 or array.ndim != 2:
        raise ConversionError(f"data: expected a picture of uint16 for 32FC1, got {array.dtype} of {array.shape}")
    with np.errstate(all="ignore"):
        depth = np.float32(scale) / (array.astype(np.float32) - np.float32(offset))
    depth[array == 0] = np.nan
    return depth, "32FC1"


def array_to_compressedimage(
    array: Any,
    encoding: str | None = None,
    *,
    format: str = "jpeg",
    quality: int = 95,
    header: Message | None = None,
    cls: type[M] | None = None,
) -> M:
    """Return a compressed image of an array, as compressed_image_transport would send it.

    Args:
        array: pixels as `image_to_array` returns them.
        encoding: encoding of the array, as for `array_to_image`; ``bgr8`` for an array of OpenCV.
        format: ``"jpeg"``, which changes values a little, or ``"png"``, which does not, and accepts 16 bits of
            brightness or depth.
        quality: quality of JPEG, from 1 to 95.
        header: a ``std_msgs/msg/Header``.

    Raises:
        ConversionError: dtype or shape do not fit the encoding, or the format does not support it.
        ExtraMissingError: Pillow is not installed.
    """
    pixels, encoding = checked_encoding(array, encoding)
    if format not in ("jpeg", "png"):
        raise ConversionError(f'format: expected "jpeg" or "png", got {format!r:.50}')
    if isinstance(quality, bool) or not isinstance(quality, int) or not 1 <= quality <= 95:
        raise ConversionError(f"quality: expected a number from 1 to 95, got {quality!r:.50}")
    is_gray = pixels.ndim == 2 and not encoding.startswith(("bayer", "nv"))
    deep = pixels.dtype.itemsize == 2 and format == "png"
    if encoding == "16UC1" and not deep:
        raise ConversionError('array: 16UC1 may be depths, which JPEG would make useless; expected format="png"')
    if not pixels.size:
        raise ConversionError(f"array: there are no pixels to compress, its shape is {pixels.shape}")
    if deep and not is_gray:
        raise ConversionError(f"array: PNG of {encoding} needs 16 bits for each colour, of which Pillow writes only 8")
    if is_gray:
        stored, order = "mono16" if deep else "mono8", ""
    elif format == "png" and encoding.startswith(("rgba", "bgra")):
        stored, order = "rgba8", "bgra8"
    else:
        stored, order = "rgb8", "bgr8"
    picture = np.ascontiguousarray(converted(pixels, encoding, stored))
    picture = picture.astype(picture.dtype.newbyteorder("="), copy=False)
    out = BytesIO()
    try:
        options: dict[str, Any] = {"quality": quality} if format == "jpeg" else {}
        pillow_image().fromarray(picture).save(out, format.upper(), **options)
    except (OSError, ValueError) as error:  # JPEG has at most 65535 rows and columns
        raise ConversionError(f"array: {format} does not support {pixels.shape}: {error!s:.200}") from None
    return message_class(cls, "sensor_msgs/msg/CompressedImage", header)(
        format=f"{encoding}; {format} compressed {order}".rstrip(), data=np.frombuffer(out.getvalue(), np.uint8)
    )


def pillow_image() -> ModuleType:
    """Return the module ``PIL.Image``; raises `ExtraMissingError` if Pillow is not installed."""
    try:
        from PIL import Image
    except ModuleNotFoundError as missing:
        raise Extra.missing_error(missing) or missing from None
    return Image
