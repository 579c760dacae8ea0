"""Conversions between ``sensor_msgs/msg/CompressedImage`` and arrays, by Pillow (extra ``images``).

The field `format` has the forms that compressed_image_transport and compressed_depth_image_transport write: ``jpeg`` or
``png`` alone, ``bgr8; jpeg compressed bgr8``, ``16UC1; compressedDepth png``.
"""

from __future__ import annotations

import struct
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.numpy.common import ConversionError, M, flat_bytes, message_class, reads_message
from rosidl_py_gen.numpy.images import Pixels, checked_encoding, converted

if TYPE_CHECKING:
    from types import ModuleType

    from rosidl_py_gen.cdr import Message

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
        uint8 of shape ``(height, width, 3)``, red first whatever the original encoding; ``(height, width, 4)`` if some
        pixels are transparent; ``(height, width)`` of uint8 or uint16 without colours. Depths are uint16, or float32
        with NaN for unknown depths.

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
        raise missing_extra_message(missing) or missing from None
    return Image
