"""Images as arrays, and encodings converted on request."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from each_case import each_case
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from rosidl_py_gen import decode, get_message
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.numpy import ConversionError, array_to_image, convert_pixels, image_to_array

Image: Any = get_message("sensor_msgs/msg/Image")

KINDS = tuple(enumerate(("US", "US", "SF", "F")))
CHANNELS = (1, 2, 3, 4, 7)
# encoding -> bits of a value, channels: numChannels and bitDepth of sensor_msgs/image_encodings.hpp
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


def test_planar_encodings_are_read_as_rows_of_bytes() -> None:
    data = np.arange(4 * 6 * 3, dtype=np.uint8)
    nv21 = image_to_array(Image(height=4, width=6, encoding="nv21", step=6, data=data[:36]))
    assert nv21.shape == (6, 6) and nv21.tobytes() == data[:36].tobytes()
    nv24 = image_to_array(Image(height=4, width=6, encoding="nv24", step=6, data=data))
    assert nv24.shape == (12, 6)
    assert array_to_image(nv24, "nv24").height == 4
    with pytest.raises(ConversionError, match="even number of rows"):
        image_to_array(Image(height=3, width=6, encoding="nv21", step=6, data=data))


def test_image_data_is_not_copied_unless_requested() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    image = array_to_image(pixels)
    assert image.encoding == "rgb8"
    assert np.shares_memory(image.data, pixels)
    assert np.shares_memory(image_to_array(image), pixels)
    assert not np.shares_memory(image_to_array(image, copy=True), pixels)
    received = decode(Image, image.encode())
    assert np.shares_memory(image_to_array(received), received.data)


def test_encoding_is_derived_from_dtype_and_shape() -> None:
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
def test_dtypes_without_an_encoding_are_refused(kind: type) -> None:
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
def test_inconsistent_image_fields_are_reported(changes: dict[str, object], text: str) -> None:
    values = {"height": 2, "width": 2, "encoding": "rgb8", "step": 6, "data": bytes(12), **changes}
    with pytest.raises(ConversionError, match=text):
        image_to_array(Image(**values))


def test_an_array_that_does_not_fit_its_encoding_is_refused() -> None:
    with pytest.raises(ConversionError, match="rgb8 needs uint8 with 3 channels, got float32 with 3"):
        array_to_image(np.ones((2, 2, 3), np.float32), "rgb8")
    with pytest.raises(ConversionError, match="rows, columns"):
        array_to_image(np.ones(3, np.uint8))


def test_last_row_of_an_image_may_lack_its_padding() -> None:
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
def test_any_image_is_read_within_its_data_or_raises_our_error(image: object) -> None:
    try:
        array = image_to_array(image)
    except RosidlError:
        return
    assert array.nbytes <= 200


ORDERS = ("rgb", "bgr", "rgba", "bgra")
COLORS = [f"{order}{bits}" for order in ORDERS for bits in (8, 16)]
TARGETS = [*COLORS, "mono8", "mono16"]


def noise(encoding: str, height: int = 6, width: int = 8, seed: int = 1) -> Any:
    """Return an image of random values."""
    bits = 16 if encoding.endswith("16") else 8
    order = encoding.removesuffix(str(bits))
    shape = (height, width, len(order)) if order in ORDERS else (height, width)
    values = np.random.default_rng(seed).integers(0, 1 << bits, shape, f"u{bits // 8}")
    return array_to_image(values, encoding)


@each_case("source", COLORS)
@each_case("target", COLORS)
def test_converted_channels_are_ordered_like_the_letters_of_the_encoding(source: str, target: str) -> None:
    image = noise(source)
    before, after = image_to_array(image), image_to_array(image, to=target)
    letters, bits = target.rstrip("0123456789"), int(target.lstrip("rgba"))
    known, known_bits = source.rstrip("0123456789"), int(source.lstrip("rgba"))
    assert after.shape == (6, 8, len(letters)) and after.dtype == f"u{bits // 8}"
    for at, letter in enumerate(letters):
        if letter not in known:
            assert (after[..., at] == (1 << bits) - 1).all()
            continue
        value = before[..., known.index(letter)] / ((1 << known_bits) - 1) * ((1 << bits) - 1)
        assert (after[..., at] == np.floor(value + 0.5)).all()


@pytest.mark.parametrize("order", ORDERS)
def test_conversion_to_mono_equals_that_in_pillow(order: str) -> None:
    image = noise(f"{order}8", 50, 40)
    pixels = image_to_array(image, to="rgb8")
    gray = np.asarray(Pillow.fromarray(pixels).convert("L"))
    assert (image_to_array(image, to="mono8") == gray).all()
    again = image_to_array(array_to_image(gray, "mono8"), to="bgra8")
    assert (again[..., :3] == gray[..., None]).all() and (again[..., 3] == 255).all()
    deep = image_to_array(noise(f"{order}16", 50, 40), to="mono16")
    wide = image_to_array(noise(f"{order}16", 50, 40), to="rgb16")
    assert np.abs(deep - wide @ (0.299, 0.587, 0.114)).max() <= 1


def test_conversion_to_the_same_encoding_does_not_copy() -> None:
    image = noise("rgb8")
    assert np.shares_memory(image_to_array(image, to="rgb8"), image.data)
    assert not np.shares_memory(image_to_array(image, to="rgb8", copy=True), image.data)
    generic = array_to_image(np.ones((2, 2), np.uint8), "8UC1")
    assert image_to_array(generic, to="mono8").tolist() == [[1, 1], [1, 1]]
    assert image_to_array(array_to_image(np.full((1, 1), 514, ">u2"), "mono16"), to="mono8").tolist() == [[2]]


def yuv_to_rgb(y: float, u: float, v: float) -> list[float]:
    """BT.601 in the range of video, as its text gives it."""
    bright = 255 / 219 * (y - 16)
    red, blue = 255 / 112 * 0.701 * (v - 128), 255 / 112 * 0.886 * (u - 128)
    green = -255 / 112 * 0.886 * 0.114 / 0.587 * (u - 128) - 255 / 112 * 0.701 * 0.299 / 0.587 * (v - 128)
    return [min(255.0, max(0.0, bright + more)) for more in (red, green, blue)]


@pytest.mark.parametrize("encoding", ["yuv422", "uyvy", "yuv422_yuy2", "yuyv", "nv21", "nv24"])
def test_yuv_is_converted_by_the_formula_of_bt601(encoding: str) -> None:
    height, width = 4, 6
    rng = np.random.default_rng(2)
    y = rng.integers(16, 236, (height, width))
    shape = {"nv21": (2, 3), "nv24": (4, 6)}.get(encoding, (4, 3))
    u, v = rng.integers(16, 241, shape), rng.integers(16, 241, shape)
    if encoding.startswith("nv"):
        colors = np.stack((v, u) if encoding == "nv21" else (u, v), -1).reshape(-1, width)
        array = np.concatenate([y, colors])
    else:
        luma_first = encoding in ("yuv422_yuy2", "yuyv")
        chroma = np.stack([u, v], -1).reshape(height, width)
        array = np.stack((y, chroma) if luma_first else (chroma, y), -1)
    made = image_to_array(array_to_image(array.astype(np.uint8), encoding), to="rgb8")
    assert made.shape == (height, width, 3)
    for row, column in np.ndindex(height, width):
        at = row * shape[0] // height, column * shape[1] // width
        wanted = yuv_to_rgb(y[row, column], u[at], v[at])
        assert np.abs(made[row, column] - wanted).max() <= 1.01, (row, column)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("shape", [(2, 2), (6, 8), (5, 7)])
def test_bayer_conversion_keeps_measured_colours_and_averages_neighbours(
    bits: int, pattern: str, shape: tuple[int, int]
) -> None:
    values = np.random.default_rng(4).integers(0, 1 << bits, shape, f"u{bits // 8}")
    made = image_to_array(array_to_image(values, f"bayer_{pattern}{bits}"), to=f"rgb{bits}")
    for row, column, at in np.ndindex(*shape, 3):
        letter = "rgb"[at]
        around = [(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)]
        seen = {
            place: values[place]
            for place in around
            if 0 <= place[0] < shape[0]
            and 0 <= place[1] < shape[1]
            and pattern[place[0] % 2 * 2 + place[1] % 2] == letter
        }
        beside = {place: value for place, value in seen.items() if abs(place[0] - row) + abs(place[1] - column) <= 1}
        used = [seen[row, column]] if (row, column) in seen else [*(beside or seen).values()]
        assert abs(int(made[row, column, at]) - np.mean(used)) <= 0.5


@given(st.sampled_from([*COLORS, "mono8", "mono16", "bayer_gbrg8", "uyvy", "nv21"]), st.sampled_from(TARGETS))
def test_every_conversion_has_shape_and_dtype_of_the_target_encoding(source: str, target: str) -> None:
    if source == "uyvy":
        image = array_to_image(np.zeros((4, 6, 2), np.uint8), source)
    elif source == "nv21":
        image = array_to_image(np.zeros((6, 6), np.uint8), source)
    else:
        image = noise(source, 4, 6)
    made = image_to_array(image, to=target)
    assert image_to_array(array_to_image(made, target)).tobytes() == made.tobytes()


@pytest.mark.parametrize(
    ("source", "target", "text"),
    [
        ("rgb8", "rgb", "cannot convert to 'rgb'; did you mean"),
        ("rgb8", "yuyv", "expected one of rgb8, rgb16, bgr8"),
        ("rgb8", 8, "cannot convert to 8"),
        ("32FC1", "mono8", "encoding: 32FC1 has no colours that could be converted to mono8"),
        ("16UC1", "mono8", "encoding: 16UC1 may be depths, which cannot become mono8; mono16 has the same numbers"),
        ("16UC1", "rgb16", "encoding: 16UC1 may be depths, which cannot become rgb16"),
        ("8UC3", "rgb8", "encoding: 8UC3 has no colours"),
        ("odd", "rgb8", "width: two pixels share their colour, got 5"),
        ("tiny", "rgb8", "a Bayer pattern has 2 x 2 pixels at least, got 1 x 5"),
    ],
)
def test_impossible_conversions_are_refused_with_reason(source: str, target: Any, text: str) -> None:
    made = {
        "32FC1": lambda: array_to_image(np.zeros((2, 2), np.float32)),
        "16UC1": lambda: array_to_image(np.full((2, 2), 1000, np.uint16), "16UC1"),
        "8UC3": lambda: array_to_image(np.zeros((2, 2, 3), np.uint8), "8UC3"),
        "odd": lambda: array_to_image(np.zeros((2, 5, 2), np.uint8), "uyvy"),
        "tiny": lambda: array_to_image(np.zeros((1, 5), np.uint8), "bayer_rggb8"),
    }
    image = made[source]() if source in made else noise(source)
    with pytest.raises(ConversionError, match=text):
        image_to_array(image, to=target)


@pytest.mark.parametrize("source", [*COLORS, "mono8", "bayer_rggb16"])
def test_convert_pixels_converts_arrays_like_images(source: str) -> None:
    image = noise(source)
    for target in TARGETS:
        expected = image_to_array(image, to=target)
        assert convert_pixels(image_to_array(image), source, target).tolist() == expected.tolist()
    with pytest.raises(ConversionError, match=f"{source} needs uint.*got float32 with 2"):
        convert_pixels(np.zeros((2, 2, 2), "f4"), source, "rgb8")
