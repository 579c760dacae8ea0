"""``sensor_msgs/msg/CompressedImage`` and arrays, by Pillow (extra ``images``).

Decides what `format` means, as compressed_image_transport and compressed_depth_image_transport write it:
``jpeg`` or ``png`` alone, ``bgr8; jpeg compressed bgr8``, ``16UC1; compressedDepth png``.
"""

from __future__ import annotations

import struct
from io import BytesIO
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.numpy.colors import converted
from rosidl_py_gen.numpy.common import ConversionError, M, flat_bytes, message_class, reads_message
from rosidl_py_gen.numpy.images import checked_encoding

if TYPE_CHECKING:
    from types import ModuleType

    from rosidl_py_gen.cdr import Message

    Pixels = np.ndarray[Any, np.dtype[Any]]

_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP")
_ENCODINGS = {"L": "mono8", "RGB": "rgb8", "RGBA": "rgba8", "I;16": "mono16", "I;16B": "mono16", "F": "32FC1"}
_OTHER_MODES = {"1": "L", "P": "RGB", "PA": "RGBA", "LA": "RGBA", "CMYK": "RGB", "YCbCr": "RGB", "RGBX": "RGB"}
_DEPTH_HEADER = struct.Struct("<iff")
"""Of compressed_depth_image_transport, before the PNG: its format, and two parameters of 32FC1."""
_QUALITY = 95
_MAX_GRAY = 65535
MAX_PIXELS = 64_000_000
"""What a picture may unpack to when nobody says otherwise."""


@reads_message("a sensor_msgs/msg/CompressedImage")
def compressedimage_to_array(
    image: Any, *, to: str | None = None, max_pixels: int = MAX_PIXELS
) -> np.ndarray[Any, np.dtype[Any]]:
    """The pixels of a ``sensor_msgs/msg/CompressedImage``: JPEG, PNG, TIFF or WebP, or a depth image.

    Args:
        to: convert to this encoding, as `image_to_array` does.
        max_pixels: refuse what unpacks to more, which few bytes can do. From 179 million on, Pillow has to be told as
            well: ``PIL.Image.MAX_IMAGE_PIXELS``.

    Returns:
        Shape ``(height, width, 3)`` of uint8, red first, whatever the encoding was before; ``(height, width, 4)`` where
        some of it is transparent; ``(height, width)`` of uint8 or uint16 without colours. Depths are uint16, or float32
        with NaN for unknown ones.

    Raises:
        ConversionError: damaged, too large, another format; `to` is none that it can become.
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
        array, encoding = _unpacked(data, max_pixels)
        if encoding == "mono16" and before.strip() == "16UC1":
            encoding = "16UC1"
        if "compressed rgb" in how and array.ndim == 3:  # OpenCV, which takes blue first, was given red first
            array = np.ascontiguousarray(array[..., [2, 1, 0, *range(3, array.shape[2])]])
    return array if to is None else converted(array, encoding, to)


def _unpacked(data: Pixels, max_pixels: int) -> tuple[Pixels, str]:
    pillow = _pillow()
    if bytes(data[:4]) == b"\x89PNG" and len(data) > 25 and data[24] == 16 and data[25] in (2, 6):
        raise ConversionError("data: PNG with 16 bits for each colour, of which Pillow reads 8 only")
    try:
        with pillow.open(BytesIO(data.tobytes()), formats=_FORMATS) as picture:
            if picture.width * picture.height > max_pixels:
                size = f"{picture.width} x {picture.height} pixels"
                raise ConversionError(f"data: {len(data)} bytes unpack to {size}, more than max_pixels={max_pixels}")
            if picture.mode in _OTHER_MODES:
                has_alpha = picture.mode[-1] == "A" or "transparency" in picture.info
                picture = picture.convert("RGBA" if has_alpha else _OTHER_MODES[picture.mode])
            if picture.mode == "I":  # what PNG with 16 bits is to older versions
                numbers = np.array(picture)
                if numbers.size and not 0 <= numbers.min() <= numbers.max() <= _MAX_GRAY:
                    found = f"{numbers.min()} to {numbers.max()}"
                    raise ConversionError(f"data: a picture with values from {found}, beyond 16 bits of brightness")
                return numbers.astype(np.uint16), "mono16"
            if picture.mode not in _ENCODINGS:
                raise ConversionError(f"data: a picture of the mode {picture.mode}, which no encoding is like")
            array = np.array(picture)
            return array.astype(array.dtype.newbyteorder("="), copy=False), _ENCODINGS[picture.mode]
    except ConversionError:
        raise
    except pillow.UnidentifiedImageError:
        raise ConversionError(f"data: {len(data)} bytes are no picture: none of {', '.join(_FORMATS)}") from None
    except pillow.DecompressionBombError as error:
        raise ConversionError(
            f"data: {len(data)} bytes unpack to more than max_pixels={max_pixels}, or than Pillow allows "
            f"(PIL.Image.MAX_IMAGE_PIXELS): {error!s:.200}"
        ) from None
    except Exception as error:  # its decoders raise what they like: OSError, SyntaxError, struct.error, ...
        raise ConversionError(f"data: {len(data)} bytes are no picture: {error!s:.200}") from None


def _depth(data: Pixels, encoding: str, how: str, max_pixels: int) -> tuple[Pixels, str]:
    if "rvl" in how:
        raise ConversionError(f"format: {how.strip()} is not known here; compressedDepth png is")
    if len(data) < _DEPTH_HEADER.size:
        raise ConversionError(f"data: {len(data)} bytes, but the header of a depth image needs {_DEPTH_HEADER.size}")
    _, scale, offset = _DEPTH_HEADER.unpack(data[: _DEPTH_HEADER.size].tobytes())
    array, found = _unpacked(data[_DEPTH_HEADER.size :], max_pixels)
    if encoding != "32FC1":
        return array, "16UC1" if found == "mono16" else found
    if array.dtype != np.uint16 or array.ndim != 2:
        raise ConversionError(f"data: depths of 32FC1 are in a picture of uint16, got {array.dtype} of {array.shape}")
    with np.errstate(all="ignore"):
        depth = np.float32(scale) / (array.astype(np.float32) - np.float32(offset))
    depth[array == 0] = np.nan
    return depth, "32FC1"


@overload
def array_to_compressedimage(
    array: Any,
    encoding: str | None = None,
    *,
    format: str = "jpeg",
    quality: int = _QUALITY,
    header: Message | None = None,
    cls: type[M],
) -> M: ...
@overload
def array_to_compressedimage(
    array: Any,
    encoding: str | None = None,
    *,
    format: str = "jpeg",
    quality: int = _QUALITY,
    header: Message | None = None,
    cls: None = None,
) -> Any: ...
def array_to_compressedimage(
    array: Any,
    encoding: str | None = None,
    *,
    format: str = "jpeg",
    quality: int = _QUALITY,
    header: Any = None,
    cls: type[M] | None = None,
) -> Any:
    """A compressed image of an array, as compressed_image_transport would send it.

    Args:
        array: as `image_to_array` gives it.
        encoding: of the array, as for `array_to_image`; ``bgr8`` for one of OpenCV.
        format: ``"jpeg"``, which changes values a little, or ``"png"``, which keeps them, and takes 16 bits of
            brightness or depth.
        quality: of JPEG, 1 to 95.
        header: a ``std_msgs/msg/Header``.
        cls: the class of the result; None means the one that `get_message` gives.

    Raises:
        ConversionError: dtype or shape do not fit the encoding, or the format does not take it.
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
    if is_gray:
        kept = "mono16" if deep else "mono8"
    else:
        kept = "rgba8" if format == "png" and encoding.startswith(("rgba", "bgra")) else "rgb8"
    if not pixels.size:
        raise ConversionError(f"array: there are no pixels to compress, its shape is {pixels.shape}")
    if deep and not is_gray:
        raise ConversionError(
            f"array: PNG of {encoding} would need 16 bits for each colour, of which Pillow writes 8 only"
        )
    shown = np.ascontiguousarray(converted(pixels, encoding, kept))
    out = BytesIO()
    try:
        options: dict[str, Any] = {"quality": quality} if format == "jpeg" else {}
        _pillow().fromarray(shown.astype(shown.dtype.newbyteorder("="), copy=False)).save(
            out, format.upper(), **options
        )
    except (OSError, ValueError) as error:  # JPEG has at most 65535 rows and columns
        raise ConversionError(f"array: {format} does not take {pixels.shape}: {error!s:.200}") from None
    maker: Any = message_class(cls, "sensor_msgs/msg/CompressedImage")
    values = {"header": header} if header is not None else {}
    order = "" if is_gray else "bgra8" if kept == "rgba8" else "bgr8"
    data = np.frombuffer(out.getvalue(), np.uint8)
    return maker(format=f"{encoding}; {format} compressed {order}".rstrip(), data=data, **values)


def _pillow() -> ModuleType:
    try:
        from PIL import Image
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    return Image
