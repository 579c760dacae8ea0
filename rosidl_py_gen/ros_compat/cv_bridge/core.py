"""Messages with images as arrays of OpenCV, and back."""

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
_BY_PILLOW = {"jpg": "jpeg", "jpeg": "jpeg", "jpe": "jpeg", "png": "png"}
_ORDERS = {1: "mono", 3: "bgr", 4: "bgra"}
_BITS = {"uint8": 8, "uint16": 16}


class CvBridgeError(TypeError):
    """A conversion is not possible."""


class CvBridge:
    """Converts images; what is blue, green, red for OpenCV is so in its arrays, too.

    Attributes:
        cvtype_to_name: OpenCV's numbers and names of types, such as 8UC3.
        cvdepth_to_numpy_depth: OpenCV's numbers and numpy's names of depths.
        numpy_type_to_cvtype: numpy's and OpenCV's names of depths, either way.
    """

    def __init__(self) -> None:
        names = [f"{depth}C{channels}" for depth in DEPTHS for channels in (1, 2, 3, 4)]
        self.cvtype_to_name = {getCvType(name): name for name in names}
        self.cvdepth_to_numpy_depth = dict(enumerate(NUMPY_DEPTHS))
        both = [*zip(NUMPY_DEPTHS, DEPTHS, strict=True), *zip(DEPTHS, NUMPY_DEPTHS, strict=True)]
        self.numpy_type_to_cvtype = dict(both)

    # --- encodings ----------------------------------------------------------------------------------------------------

    def dtype_with_channels_to_cvtype2(self, dtype: np.dtype[Any], n_channels: int) -> str:
        """OpenCV's name, such as 8UC3; raises KeyError for a type that it does not have."""
        return f"{self.numpy_type_to_cvtype[dtype.name]}C{n_channels}"

    def cvtype2_to_dtype_with_channels(self, cvtype: int) -> tuple[str, int]:
        """Numpy's name of the depth, and the channels."""
        return self.cvdepth_to_numpy_depth[CV_MAT_DEPTHWrap(cvtype)], CV_MAT_CNWrap(cvtype)

    def encoding_to_cvtype2(self, encoding: str) -> int:
        """OpenCV's number; raises `CvBridgeError` for an unknown encoding."""
        try:
            return getCvType(encoding)
        except RuntimeError as error:
            raise CvBridgeError(str(error)) from None

    def encoding_to_dtype_with_channels(self, encoding: str) -> tuple[str, int]:
        """Numpy's name of the depth, and the channels."""
        return self.cvtype2_to_dtype_with_channels(self.encoding_to_cvtype2(encoding))

    # --- images -------------------------------------------------------------------------------------------------------

    def imgmsg_to_cv2(self, img_msg: Any, desired_encoding: str = "passthrough") -> Pixels:
        """The pixels of a ``sensor_msgs/msg/Image``.

        With "passthrough", and no bytes between rows, they share the memory of the message.

        Raises:
            CvBridgeError: an unknown encoding, less data than there should be, or colours of what has none.
        """
        self.encoding_to_cvtype2(img_msg.encoding)
        try:
            pixels = np.ascontiguousarray(image_to_array(img_msg))
        except ConversionError as error:
            raise CvBridgeError(str(error)) from None
        pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
        if desired_encoding == "passthrough":
            return pixels
        return _converted(pixels, img_msg.encoding, desired_encoding)

    def cv2_to_imgmsg(self, cvim: Any, encoding: str = "passthrough", header: Any = None) -> Any:
        """A ``sensor_msgs/msg/Image`` of pixels; "passthrough" calls them what OpenCV does, such as 8UC3.

        Raises:
            CvBridgeError: the encoding is of another type.
            TypeError: no array.
        """
        pixels = _array(cvim)
        made = sensor_msgs.msg.Image(height=pixels.shape[0], width=pixels.shape[1])
        if header is not None:
            made.header = header
        found = self.dtype_with_channels_to_cvtype2(pixels.dtype, 1 if pixels.ndim < 3 else pixels.shape[2])
        made.encoding = found if encoding == "passthrough" else encoding
        if self.encoding_to_cvtype2(made.encoding) != getCvType(found):
            raise CvBridgeError(f"encoding specified as {encoding}, but image has incompatible type {found}")
        made.is_bigendian = int(pixels.dtype.byteorder == ">" or (sys.byteorder == "big" and pixels.dtype.isnative))
        made.data.frombytes(pixels.tobytes())
        made.step = len(made.data) // (made.height or 1)
        return made

    # --- compressed images --------------------------------------------------------------------------------------------

    def compressed_imgmsg_to_cv2(self, cmprs_img_msg: Any, desired_encoding: str = "passthrough") -> Pixels:
        """The pixels of a ``sensor_msgs/msg/CompressedImage``, blue first: as OpenCV reads them, or else Pillow.

        Raises:
            CvBridgeError: it is no picture, or cannot become `desired_encoding`.
        """
        cv2 = opencv()
        pixels: Any
        if cv2 is None:
            pixels = _unpacked(cmprs_img_msg.data)
        else:
            data = np.frombuffer(cmprs_img_msg.data, np.uint8)
            pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
            if pixels is None:
                raise CvBridgeError(f"data: {len(data)} bytes are no picture")
        if desired_encoding in ("passthrough", "bgr8"):  # what the real one takes any picture for
            return np.asarray(pixels)
        before = _order(pixels)
        if before is None:
            raise CvBridgeError(f"a picture of {pixels.dtype} with shape {pixels.shape} has no encoding")
        return _converted(pixels, before, desired_encoding)

    def cv2_to_compressed_imgmsg(self, cvim: Any, dst_format: str = "jpg") -> Any:
        """A ``sensor_msgs/msg/CompressedImage``; without OpenCV it can be a JPEG or PNG.

        Raises:
            CvBridgeError: the format does not take such pixels, or needs OpenCV.
            TypeError: no array.
        """
        pixels, cv2 = _array(cvim), opencv()
        made = sensor_msgs.msg.CompressedImage(format=dst_format)
        if cv2 is None:
            made.data.frombytes(_packed(pixels, dst_format))
            return made
        try:
            _, data = cv2.imencode(f".{dst_format}", pixels)
        except cv2.error as error:
            raise CvBridgeError(str(error)) from None
        made.data.frombytes(data.tobytes())
        return made


def _array(cvim: Any) -> Pixels:
    if not isinstance(cvim, np.ndarray | np.generic):
        raise TypeError("Your input type is not a numpy array")
    return np.asarray(cvim)


def _order(pixels: Pixels) -> str | None:
    """What such pixels are to OpenCV."""
    order, bits = _ORDERS.get(pixels.shape[2] if pixels.ndim == 3 else 1), _BITS.get(pixels.dtype.name)
    return f"{order}{bits}" if order and bits else None


def _converted(pixels: Pixels, before: str, after: str) -> Pixels:
    try:
        return cvtColor2(pixels, before, after)
    except RuntimeError as error:
        raise CvBridgeError(str(error)) from None


def _unpacked(data: Any) -> Pixels:
    try:
        pixels = compressedimage_to_array(SimpleNamespace(format="", data=data))
        after = _order(pixels)
        if pixels.ndim == 2 or after is None:
            return pixels
        return convert_pixels(pixels, after.replace("bgr", "rgb"), after)
    except (ConversionError, ModuleNotFoundError) as error:
        raise CvBridgeError(f"{error}; without OpenCV, Pillow reads pictures") from None


def _packed(pixels: Pixels, dst_format: str) -> bytes:
    shaped = pixels[..., 0] if pixels.ndim == 3 and pixels.shape[2] == 1 else pixels
    encoding = _order(shaped)
    if dst_format not in _BY_PILLOW or encoding is None:
        what = f"{dst_format} of {pixels.dtype} with shape {pixels.shape}"
        raise CvBridgeError(f"{what} needs OpenCV, which is not installed (opencv-python-headless)")
    try:
        return bytes(array_to_compressedimage(shaped, encoding, format=_BY_PILLOW[dst_format]).data)
    except (ConversionError, ModuleNotFoundError) as error:
        raise CvBridgeError(str(error)) from None
