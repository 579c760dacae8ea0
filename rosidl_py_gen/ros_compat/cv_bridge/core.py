"""Conversion of image messages to arrays of OpenCV and back."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import sensor_msgs.msg

from cv_bridge.boost.cv_bridge_boost import (
    DEPTHS,
    NUMPY_DEPTHS,
    CV_MAT_CNWrap,
    CV_MAT_DEPTHWrap,
    cvtColor2,
    getCvType,
    opencv,
)
from rosidl_py_gen.numpy import (
    ConversionError,
    array_to_compressedimage,
    compressedimage_to_array,
    convert_pixels,
    image_to_array,
)

Pixels = np.ndarray[Any, np.dtype[Any]]
_PILLOW_FORMATS = {"jpg": "jpeg", "jpeg": "jpeg", "jpe": "jpeg", "png": "png"}
_CHANNEL_ORDERS = {1: "mono", 3: "bgr", 4: "bgra"}
_BITS = {"uint8": 8, "uint16": 16}


class CvBridgeError(TypeError):
    """Raised if an image cannot be converted."""


class CvBridge:
    """Converter between image messages and arrays. Arrays have the order of colours of OpenCV: blue, green, red.

    Attributes:
        cvtype_to_name: dict from type number of OpenCV to the name of the type, such as 8UC3.
        cvdepth_to_numpy_depth: dict from depth number of OpenCV to the name of the dtype.
        numpy_type_to_cvtype: dict from the name of a dtype to OpenCV's name of the depth, and back.
    """

    def __init__(self) -> None:
        names = [f"{depth}C{channels}" for depth in DEPTHS for channels in (1, 2, 3, 4)]
        self.cvtype_to_name = {getCvType(name): name for name in names}
        self.cvdepth_to_numpy_depth = dict(enumerate(NUMPY_DEPTHS))
        pairs = [*zip(NUMPY_DEPTHS, DEPTHS, strict=True), *zip(DEPTHS, NUMPY_DEPTHS, strict=True)]
        self.numpy_type_to_cvtype = dict(pairs)

    def dtype_with_channels_to_cvtype2(self, dtype: np.dtype[Any], n_channels: int) -> str:
        """Return OpenCV's name of a type, such as 8UC3; raise KeyError for a dtype that OpenCV does not have."""
        return f"{self.numpy_type_to_cvtype[dtype.name]}C{n_channels}"

    def cvtype2_to_dtype_with_channels(self, cvtype: int) -> tuple[str, int]:
        """Return the name of the dtype and the number of channels for a type number of OpenCV."""
        return self.cvdepth_to_numpy_depth[CV_MAT_DEPTHWrap(cvtype)], CV_MAT_CNWrap(cvtype)

    def encoding_to_cvtype2(self, encoding: str) -> int:
        """Return OpenCV's type number for an encoding; raise `CvBridgeError` for an unknown encoding."""
        try:
            return getCvType(encoding)
        except RuntimeError as error:
            raise CvBridgeError(str(error)) from None

    def encoding_to_dtype_with_channels(self, encoding: str) -> tuple[str, int]:
        """Return the name of the dtype and the number of channels for an encoding; raise `CvBridgeError` if unknown."""
        return self.cvtype2_to_dtype_with_channels(self.encoding_to_cvtype2(encoding))

    def imgmsg_to_cv2(self, img_msg: Any, desired_encoding: str = "passthrough") -> Pixels:
        """Return the pixels of a ``sensor_msgs/msg/Image``.

        With "passthrough", and without padding between rows, the pixels share the memory of the message.

        Raises:
            CvBridgeError: the encoding is unknown, data is missing, or an image without colours cannot be converted.
        """
        self.encoding_to_cvtype2(img_msg.encoding)
        try:
            pixels = np.ascontiguousarray(image_to_array(img_msg))
        except ConversionError as error:
            raise CvBridgeError(str(error)) from None
        pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
        if desired_encoding == "passthrough":
            return pixels
        return _convert(pixels, img_msg.encoding, desired_encoding)

    def cv2_to_imgmsg(self, cvim: Any, encoding: str = "passthrough", header: Any = None) -> Any:
        """Create a ``sensor_msgs/msg/Image``; with "passthrough" its encoding is OpenCV's name, such as 8UC3.

        Raises:
            CvBridgeError: the encoding has another type than the array.
            TypeError: `cvim` is not an array.
        """
        pixels = _array(cvim)
        message = sensor_msgs.msg.Image(height=pixels.shape[0], width=pixels.shape[1])
        if header is not None:
            message.header = header
        type_name = self.dtype_with_channels_to_cvtype2(pixels.dtype, 1 if pixels.ndim < 3 else pixels.shape[2])
        message.encoding = type_name if encoding == "passthrough" else encoding
        if self.encoding_to_cvtype2(message.encoding) != getCvType(type_name):
            raise CvBridgeError(f"encoding specified as {encoding}, but image has incompatible type {type_name}")
        message.is_bigendian = int(pixels.dtype.byteorder == ">" or (sys.byteorder == "big" and pixels.dtype.isnative))
        message.data.frombytes(pixels.tobytes())
        message.step = len(message.data) // (message.height or 1)
        return message

    def compressed_imgmsg_to_cv2(self, cmprs_img_msg: Any, desired_encoding: str = "passthrough") -> Pixels:
        """Return the pixels of a ``sensor_msgs/msg/CompressedImage``, read by OpenCV or Pillow.

        Raises:
            CvBridgeError: the data is not an image, or cannot be converted to `desired_encoding`.
        """
        cv2 = opencv()
        pixels: Any
        if cv2 is None:
            pixels = _decompress(cmprs_img_msg.data)
        else:
            data = np.frombuffer(cmprs_img_msg.data, np.uint8)
            pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
            if pixels is None:
                raise CvBridgeError(f"data: {len(data)} bytes are not an image")
        if desired_encoding in ("passthrough", "bgr8"):  # as in the real package, for every image
            return np.asarray(pixels)
        encoding = _native_encoding(pixels)
        if encoding is None:
            raise CvBridgeError(f"an image of {pixels.dtype} with shape {pixels.shape} has no encoding")
        return _convert(pixels, encoding, desired_encoding)

    def cv2_to_compressed_imgmsg(self, cvim: Any, dst_format: str = "jpg") -> Any:
        """Create a ``sensor_msgs/msg/CompressedImage``; without OpenCV only JPEG or PNG.

        Raises:
            CvBridgeError: the format does not support the pixels, or needs OpenCV.
            TypeError: `cvim` is not an array.
        """
        pixels, cv2 = _array(cvim), opencv()
        message = sensor_msgs.msg.CompressedImage(format=dst_format)
        if cv2 is None:
            message.data.frombytes(_compress(pixels, dst_format))
            return message
        try:
            _, data = cv2.imencode(f".{dst_format}", pixels)
        except cv2.error as error:
            raise CvBridgeError(str(error)) from None
        message.data.frombytes(data.tobytes())
        return message


def _array(cvim: Any) -> Pixels:
    if not isinstance(cvim, np.ndarray | np.generic):
        raise TypeError("Your input type is not a numpy array")
    return np.asarray(cvim)


def _native_encoding(pixels: Pixels) -> str | None:
    """Return the encoding that OpenCV assumes for an array of pixels, from its dtype and number of channels."""
    order, bits = _CHANNEL_ORDERS.get(pixels.shape[2] if pixels.ndim == 3 else 1), _BITS.get(pixels.dtype.name)
    return f"{order}{bits}" if order and bits else None


def _convert(pixels: Pixels, before: str, after: str) -> Pixels:
    try:
        return cvtColor2(pixels, before, after)
    except RuntimeError as error:
        raise CvBridgeError(str(error)) from None


def _decompress(data: Any) -> Pixels:
    try:
        pixels = compressedimage_to_array(SimpleNamespace(format="", data=data))
        after = _native_encoding(pixels)
        if pixels.ndim == 2 or after is None:
            return pixels
        return convert_pixels(pixels, after.replace("bgr", "rgb"), after)
    except (ConversionError, ModuleNotFoundError) as error:
        raise CvBridgeError(f"{error}; without OpenCV, images are read by Pillow") from None


def _compress(pixels: Pixels, dst_format: str) -> bytes:
    squeezed = pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] == 1 else pixels
    encoding = _native_encoding(squeezed)
    if dst_format not in _PILLOW_FORMATS or encoding is None:
        image = f"{dst_format} of {pixels.dtype} with shape {pixels.shape}"
        raise CvBridgeError(f"{image} needs OpenCV; install opencv-python-headless")
    try:
        return bytes(array_to_compressedimage(squeezed, encoding, format=_PILLOW_FORMATS[dst_format]).data)
    except (ConversionError, ModuleNotFoundError) as error:
        raise CvBridgeError(str(error)) from None
