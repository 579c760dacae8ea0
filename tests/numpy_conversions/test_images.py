"""Images as arrays."""

from __future__ import annotations

import numpy as np
import pytest
from each_case import each_case
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen import decode, get_message
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.numpy import ConversionError, array_to_image, image_to_array

Image = get_message("sensor_msgs/msg/Image")

KINDS = tuple(enumerate(("US", "US", "SF", "F")))
CHANNELS = (1, 2, 3, 4, 7)
# encoding -> bits of a value, channels: as numChannels and bitDepth of sensor_msgs/image_encodings.hpp give them
ENCODINGS = {
    **dict.fromkeys(("rgb8", "bgr8"), (8, 3)),
    **dict.fromkeys(("rgba8", "bgra8"), (8, 4)),
    **dict.fromkeys(("rgb16", "bgr16"), (16, 3)),
    **dict.fromkeys(("rgba16", "bgra16"), (16, 4)),
    **dict.fromkeys(("mono8", "bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"), (8, 1)),
    **dict.fromkeys(("mono16", "bayer_rggb16", "bayer_bggr16", "bayer_gbrg16", "bayer_grbg16"), (16, 1)),
    **dict.fromkeys(("yuv422", "yuv422_yuy2", "uyvy", "yuyv"), (8, 2)),
    **{f"{8 << n}{kind}C{c}": (8 << n, c) for n, kinds in KINDS for kind in kinds for c in CHANNELS},
    "8UC": (8, 1),
    "32FC": (32, 1),
}


@each_case("encoding", ENCODINGS)
@each_case("is_bigendian", [0, 1])
@each_case("padding", [0, 3])
def test_every_encoding_is_read_pixel_by_pixel(encoding: str, is_bigendian: int, padding: int) -> None:
    bits, channels = ENCODINGS[encoding]
    size, height, width = bits // 8, 3, 5
    step = width * channels * size + padding
    data = np.random.default_rng(1).integers(0, 256, height * step, np.uint8)
    image = Image(height=height, width=width, encoding=encoding, is_bigendian=is_bigendian, step=step, data=data)
    array = image_to_array(image)
    assert array.shape == ((height, width) if channels == 1 else (height, width, channels))
    kind = "f" if "F" in encoding else "i" if "SC" in encoding else "u"
    assert (array.dtype.kind, array.dtype.itemsize) == (kind, size)
    for row, column, channel in np.ndindex(height, width, channels):
        at = row * step + (column * channels + channel) * size
        value = data[at : at + size].tobytes()
        assert array.reshape(height, width, channels)[row, column, channel].tobytes() in (value, value[::-1])
        if kind != "f":
            wanted = int.from_bytes(value, "big" if is_bigendian else "little", signed=kind == "i")
            assert array.reshape(height, width, channels)[row, column, channel] == wanted
    again = array_to_image(array, encoding, cls=Image)
    assert (image_to_array(again) == array).all() or kind == "f"
    assert image_to_array(again).tobytes() == array.tobytes()
    assert again.step == width * channels * size


def test_planes_come_as_rows_of_bytes() -> None:
    data = np.arange(4 * 6 * 3, dtype=np.uint8)
    nv21 = image_to_array(Image(height=4, width=6, encoding="nv21", step=6, data=data[:36]))
    assert nv21.shape == (6, 6) and nv21.tobytes() == data[:36].tobytes()
    nv24 = image_to_array(Image(height=4, width=6, encoding="nv24", step=6, data=data))
    assert nv24.shape == (12, 6)
    assert array_to_image(nv24, "nv24").height == 4
    with pytest.raises(ConversionError, match="even number of rows"):
        image_to_array(Image(height=3, width=6, encoding="nv21", step=6, data=data))


def test_nothing_is_copied_when_nothing_has_to_be() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    image = array_to_image(pixels)
    assert image.encoding == "rgb8"
    assert np.shares_memory(image.data, pixels)
    assert np.shares_memory(image_to_array(image), pixels)
    assert not np.shares_memory(image_to_array(image, copy=True), pixels)
    received = decode(Image, image.encode())
    assert np.shares_memory(image_to_array(received), received.data)


def test_the_encoding_is_found_by_type_and_shape() -> None:
    for kind, shape, encoding in (
        (np.uint8, (2, 3), "mono8"),
        (np.uint16, (2, 3), "mono16"),
        (np.uint8, (2, 3, 4), "rgba8"),
        (np.uint16, (2, 3, 3), "rgb16"),
        (np.float32, (2, 3), "32FC1"),
        (np.int16, (2, 3, 2), "16SC2"),
        (">f8", (2, 3), "64FC1"),
    ):
        image = array_to_image(np.ones(shape, kind))
        assert image.encoding == encoding
        assert (image_to_array(image) == 1).all()


@pytest.mark.parametrize("kind", [np.int64, np.complex64, bool, object])
def test_what_no_encoding_has_is_refused(kind: type) -> None:
    with pytest.raises(ConversionError, match="no encoding"):
        array_to_image(np.ones((2, 3), kind))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"encoding": "rbg8"}, 'encoding: "rbg8" is not known; did you mean'),
        ({"encoding": "8UC0"}, "not known"),
        ({"step": 5}, "step: 5 bytes, but a row of 2 pixels of rgb8 needs 6"),
        ({"height": 3}, "data: 12 bytes, but 3 rows of 6 bytes need 18"),
        ({"width": 2**32 - 1, "step": 2**32 - 1}, "step"),
        ({"height": 2**32 - 1}, "data: 12 bytes"),
        ({"height": 2**70, "width": 0}, "height: expected a number from 0 to 4294967295"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, object], text: str) -> None:
    values = {"height": 2, "width": 2, "encoding": "rgb8", "step": 6, "data": bytes(12), **changes}
    with pytest.raises(ConversionError, match=text):
        image_to_array(Image(**values))


def test_an_array_that_does_not_fit_its_encoding_is_refused() -> None:
    with pytest.raises(ConversionError, match="rgb8 needs uint8 with 3 channels, got float32 with 3"):
        array_to_image(np.ones((2, 2, 3), np.float32), "rgb8")
    with pytest.raises(ConversionError, match="rows, columns"):
        array_to_image(np.ones(3, np.uint8))


def test_a_row_may_lack_its_padding_at_the_end() -> None:
    assert image_to_array(Image(height=2, width=2, encoding="mono8", step=4, data=bytes(6))).shape == (2, 2)


def test_an_empty_image_is_an_empty_array() -> None:
    assert image_to_array(Image(encoding="rgb8")).shape == (0, 0, 3)
    assert image_to_array(array_to_image(np.empty((0, 4), np.uint8))).shape == (0, 4)


@given(
    st.builds(
        Image,
        height=st.integers(0, 2**32 - 1),
        width=st.integers(0, 9),
        step=st.integers(0, 40) | st.integers(0, 2**32 - 1),
        encoding=st.sampled_from([*ENCODINGS, "nv21", "nv24", ""]) | st.text(max_size=9),
        is_bigendian=st.integers(0, 255),
        data=st.binary(max_size=200),
    )
)
def test_no_image_raises_anything_else_or_reads_beyond_its_data(image: object) -> None:
    try:
        array = image_to_array(image)
    except RosidlError:
        return
    assert array.nbytes <= 200
