"""Compressed images as arrays, and arrays as compressed images."""

from __future__ import annotations

import struct
import sys
import zlib
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from rosidl_py_gen import decode, encode, get_message
from rosidl_py_gen.errors import ExtraMissingError
from rosidl_py_gen.numpy import (
    ConversionError,
    array_to_compressedimage,
    array_to_image,
    compressedimage_to_array,
    image_to_array,
)

CompressedImage: Any = get_message("sensor_msgs/msg/CompressedImage")


def smooth(channels: int = 3, dtype: str = "u1") -> Any:
    """Return a picture of smooth colour gradients, which JPEG changes little."""
    row, column = np.mgrid[0:48, 0:64]
    planes = (row * 5, column * 3, 255 - row * 2, 255 - column)[:channels]
    array = np.stack(planes, -1).astype(dtype)
    return array[..., 0] if channels == 1 else array


def message(picture: Any, kind: str = "PNG", text: str = "png", **options: Any) -> Any:
    out = BytesIO()
    picture.save(out, kind, **options)
    return CompressedImage(format=text, data=np.frombuffer(out.getvalue(), np.uint8))


@pytest.mark.parametrize(
    ("encoding", "channels", "dtype", "text"),
    [
        ("rgb8", 3, "u1", "rgb8; png compressed bgr8"),
        ("bgr8", 3, "u1", "bgr8; png compressed bgr8"),
        ("rgba8", 4, "u1", "rgba8; png compressed bgra8"),
        ("bgra8", 4, "u1", "bgra8; png compressed bgra8"),
        ("mono8", 1, "u1", "mono8; png compressed"),
        ("8UC1", 1, "u1", "8UC1; png compressed"),
        ("mono16", 1, "u2", "mono16; png compressed"),
        ("16UC1", 1, "u2", "16UC1; png compressed"),
        ("16UC1", 1, ">u2", "16UC1; png compressed"),
    ],
)
def test_png_preserves_every_value(encoding: str, channels: int, dtype: str, text: str) -> None:
    array = smooth(channels, dtype)
    made = array_to_compressedimage(array, encoding, format="png", cls=CompressedImage)
    assert made.format == text
    received = decode(CompressedImage, encode(made))
    same = encoding if encoding[-1] in "86" else {"8UC1": "mono8", "16UC1": "mono16"}[encoding]
    assert (compressedimage_to_array(received, to=same) == array).all()


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bgra8", "mono8"])
def test_jpeg_preserves_the_picture_approximately(encoding: str) -> None:
    array = smooth({"mono8": 1, "bgra8": 4}.get(encoding, 3))
    made = array_to_compressedimage(array, encoding)
    assert made.format == f"{encoding}; jpeg compressed {'' if encoding == 'mono8' else 'bgr8'}".rstrip()
    again = compressedimage_to_array(made, to=encoding)
    assert np.abs(again.astype(int) - array)[..., : 3 if array.ndim == 3 else None].mean() < 3
    worse = array_to_compressedimage(array, encoding, quality=10)
    assert len(worse.data) < len(made.data)
    with Pillow.open(BytesIO(bytes(made.data))) as picture:  # as other programs decode it
        assert picture.format == "JPEG"
        rgb = np.asarray(picture.convert("RGB")).astype(int)
    wanted = image_to_array(array_to_image(array, encoding), to="rgb8")
    assert np.abs(rgb - wanted).mean() < 3


def test_other_encodings_are_converted_before_they_are_compressed() -> None:
    yuv = np.full((4, 6, 2), 128, np.uint8)
    made = array_to_compressedimage(yuv, "yuyv", format="png")
    assert (compressedimage_to_array(made) == image_to_array(array_to_image(yuv, "yuyv"), to="rgb8")).all()
    bayer = np.arange(64, dtype=np.uint8).reshape(8, 8)
    made = array_to_compressedimage(bayer, "bayer_rggb8", format="png")
    assert (compressedimage_to_array(made) == image_to_array(array_to_image(bayer, "bayer_rggb8"), to="rgb8")).all()


def test_swapped_red_and_blue_of_stored_pictures_are_corrected() -> None:
    array = smooth()
    swapped = message(Pillow.fromarray(np.ascontiguousarray(array[..., ::-1])), text="rgb8; png compressed rgb8")
    assert (compressedimage_to_array(swapped) == array).all()
    assert (compressedimage_to_array(swapped, to="bgr8") == array[..., ::-1]).all()


@pytest.mark.parametrize(
    ("mode", "shape", "dtype"),
    [
        ("L", (48, 64), "u1"),
        ("1", (48, 64), "u1"),
        ("P", (48, 64, 3), "u1"),
        ("LA", (48, 64, 4), "u1"),
        ("RGBA", (48, 64, 4), "u1"),
        ("I;16", (48, 64), "u2"),
    ],
)
def test_every_png_mode_is_decoded_to_the_shape_of_its_colours(mode: str, shape: tuple[int, ...], dtype: str) -> None:
    picture = Pillow.fromarray(smooth(1, "u2")) if mode == "I;16" else Pillow.fromarray(smooth()).convert(mode)
    array = compressedimage_to_array(message(picture))
    assert (array.shape, array.dtype) == (shape, np.dtype(dtype)) and array.flags.writeable
    if mode not in ("I;16",):
        assert (compressedimage_to_array(message(picture), to="rgb8") == np.asarray(picture.convert("RGB"))).all()


@pytest.mark.parametrize("kind", ["TIFF", "WEBP"])
def test_tiff_and_webp_are_read(kind: str) -> None:
    picture = Pillow.fromarray(smooth())
    options = {"lossless": True} if kind == "WEBP" else {}
    assert (compressedimage_to_array(message(picture, kind, kind.lower(), **options)) == smooth()).all()


def depth_message(array: Any, text: str, scale: float = 0, offset: float = 0) -> Any:
    made = message(Pillow.fromarray(array), text=text)
    made.data = np.concatenate([np.frombuffer(struct.pack("<iff", 0, scale, offset), np.uint8), made.data])
    return made


def test_compressed_depth_images_are_decoded_to_depths() -> None:
    raw = smooth(1, "u2") * 100
    whole = compressedimage_to_array(depth_message(raw, "16UC1; compressedDepth png"))
    assert whole.dtype == np.uint16 and (whole == raw).all()
    assert (compressedimage_to_array(depth_message(raw, "16UC1; compressedDepth png"), to="mono16") == raw).all()
    for image in (
        depth_message(raw, "16UC1; compressedDepth png"),
        array_to_compressedimage(raw, "16UC1", format="png"),
    ):
        with pytest.raises(ConversionError, match="16UC1 may be depths, which cannot become mono8"):
            compressedimage_to_array(image, to="mono8")
    scale, offset = 100.0 * 101, 100.0 / 10 + 1 - 100  # as compressed_depth_image_transport: quantization 100, 10 m
    depth = np.array([[0.5, 2.0], [9.0, 0.0]])
    stored = np.zeros((2, 2), np.uint16)
    known = depth > 0
    stored[known] = (scale / depth[known] + offset).astype(np.uint16)
    again = compressedimage_to_array(depth_message(stored, "32FC1; compressedDepth", scale, offset))
    assert again.dtype == np.float32 and np.isnan(again[1, 1])
    assert np.allclose(again[known], depth[known], rtol=0.01)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, bits: int = 8, colors: int = 2, data: bytes = b"") -> Any:
    """Return a PNG picture assembled from chunks."""
    head = struct.pack(">IIBBBBB", width, height, bits, colors, 0, 0, 0)
    found = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")
    return CompressedImage(format="png", data=np.frombuffer(found, np.uint8))


def tiff(value: int) -> Any:
    return message(Pillow.fromarray(np.full((2, 2), value, np.int32)), "TIFF", "tiff")


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (CompressedImage(format="jpeg", data=b""), "data: 0 bytes are not a picture"),
        (CompressedImage(format="jpeg", data=b"\xff\xd8\xff garbage"), "data: 11 bytes are not a picture"),
        (CompressedImage(format="jpeg", data=b"GIF89a"), "not a picture: not JPEG, PNG, TIFF, WEBP$"),
        (png(50_000, 50_000), "more pixels than max_pixels=64000000, or .*2500000000 pixels"),
        (png(9000, 9000), "contain 9000 x 9000 pixels, more than max_pixels=64000000"),
        (png(4, 4, 16), "16 bits for each colour, of which Pillow reads only 8"),
        (png(4, 4, data=b"\0"), "are not a picture"),
        (CompressedImage(format="16UC1; compressedDepth rvl", data=b"x" * 20), "compressedDepth rvl is not supported"),
        (CompressedImage(format="16UC1; compressedDepth png", data=b"x"), "the header of a depth image needs 12"),
        (depth_message(smooth(), "32FC1; compressedDepth png"), "a picture of uint16 for 32FC1, got uint8"),
        (tiff(70_000), "from 70000 to 70000; expected"),
        (tiff(-1), "from -1 to -1; expected"),
    ],
)
def test_invalid_or_too_large_pictures_are_refused(image: Any, text: str) -> None:
    with pytest.raises(ConversionError, match=text):
        compressedimage_to_array(image)


def test_pictures_are_limited_by_format_max_pixels_and_pillow() -> None:
    assert compressedimage_to_array(tiff(65_535)).max() == 65_535
    image = array_to_compressedimage(smooth(), format="png")
    assert compressedimage_to_array(image, max_pixels=48 * 64).shape == (48, 64, 3)
    with pytest.raises(ConversionError, match="64 x 48 pixels, more than max_pixels=3071"):
        compressedimage_to_array(image, max_pixels=48 * 64 - 1)
    with pytest.raises(ConversionError, match=r"Pillow allows \(PIL.Image.MAX_IMAGE_PIXELS\)"):
        compressedimage_to_array(png(20_000, 20_000), max_pixels=1 << 40)


@given(st.data())
def test_damaged_pictures_are_decoded_or_raise_conversion_error(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["PNG", "JPEG", "TIFF", "WEBP"]))
    image = message(Pillow.fromarray(smooth()), kind)
    raw = bytearray(image.data)
    for _ in range(data.draw(st.integers(1, 8))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    image.data = bytes(raw[: data.draw(st.integers(0, len(raw)))])
    try:
        made = compressedimage_to_array(image, max_pixels=1 << 20)
    except ConversionError:
        return
    assert made.ndim in (2, 3) and made.shape[0] * made.shape[1] <= 1 << 20


@pytest.mark.parametrize(
    ("array", "options", "text"),
    [
        (smooth(), {"format": "gif"}, 'format: expected "jpeg" or "png", got \'gif\''),
        (smooth(), {"quality": 0}, "quality: expected a number from 1 to 95, got 0"),
        (smooth(), {"encoding": "mono8"}, "array: mono8 needs uint8 with 1 channels"),
        (smooth(3, "u2"), {"format": "png"}, "16 bits for each colour, of which Pillow writes only 8"),
        (smooth(1, "u2"), {"encoding": "16UC1"}, "16UC1 may be depths, which JPEG would make useless"),
        (smooth(1, "f4"), {"format": "png"}, "encoding: 32FC1 has no colours"),
        (np.zeros((0, 4, 3), np.uint8), {}, "there are no pixels to compress"),
        (np.zeros((1, 70_000), np.uint8), {}, "array: jpeg does not support"),
        (5, {}, "expected rows, columns"),
    ],
)
def test_arrays_that_cannot_be_compressed_are_refused_with_reason(
    array: Any, options: dict[str, Any], text: str
) -> None:
    with pytest.raises(ConversionError, match=text):
        array_to_compressedimage(array, **options)


def test_error_without_pillow_contains_the_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    image = array_to_compressedimage(smooth())
    monkeypatch.setitem(sys.modules, "PIL", None)
    for attempt in (lambda: compressedimage_to_array(image), lambda: array_to_compressedimage(smooth())):
        with pytest.raises(ExtraMissingError, match=r"this needs PIL.*\[images\]"):
            attempt()
