"""Encodings converted on request."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from each_case import each_case
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from rosidl_py_gen import get_message
from rosidl_py_gen.numpy import ConversionError, array_to_image, convert_pixels, image_to_array

Image: Any = get_message("sensor_msgs/msg/Image")
ORDERS = ("rgb", "bgr", "rgba", "bgra")
COLORS = [f"{order}{bits}" for order in ORDERS for bits in (8, 16)]
TARGETS = [*COLORS, "mono8", "mono16"]


def noise(encoding: str, height: int = 6, width: int = 8, seed: int = 1) -> Any:
    """An image of random values."""
    bits = 16 if encoding.endswith("16") else 8
    order = encoding.removesuffix(str(bits))
    shape = (height, width, len(order)) if order in ORDERS else (height, width)
    values = np.random.default_rng(seed).integers(0, 1 << bits, shape, f"u{bits // 8}")
    return array_to_image(values, encoding)


@each_case("source", COLORS)
@each_case("target", COLORS)
def test_every_colour_lands_where_its_letter_stands(source: str, target: str) -> None:
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
def test_brightness_is_that_of_pillow(order: str) -> None:
    image = noise(f"{order}8", 50, 40)
    pixels = image_to_array(image, to="rgb8")
    gray = np.asarray(Pillow.fromarray(pixels).convert("L"))
    assert (image_to_array(image, to="mono8") == gray).all()
    again = image_to_array(array_to_image(gray, "mono8"), to="bgra8")
    assert (again[..., :3] == gray[..., None]).all() and (again[..., 3] == 255).all()
    deep = image_to_array(noise(f"{order}16", 50, 40), to="mono16")
    wide = image_to_array(noise(f"{order}16", 50, 40), to="rgb16")
    assert np.abs(deep - wide @ (0.299, 0.587, 0.114)).max() <= 1


def test_what_is_asked_for_already_is_not_copied() -> None:
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
def test_yuv_becomes_the_colours_of_its_formula(encoding: str) -> None:
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
def test_bayer_patterns_keep_what_they_saw_and_take_the_mean_of_neighbours(
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


def test_one_colour_stays_one_colour_through_a_bayer_pattern() -> None:
    color = np.array([200, 100, 50], np.uint8)
    values = np.zeros((8, 8), np.uint8)
    values[0::2, 0::2], values[0::2, 1::2], values[1::2, 0::2], values[1::2, 1::2] = color[[0, 1, 1, 2]]
    assert (image_to_array(array_to_image(values, "bayer_rggb8"), to="rgb8") == color).all()


@given(st.sampled_from([*COLORS, "mono8", "mono16", "bayer_gbrg8", "uyvy", "nv21"]), st.sampled_from(TARGETS))
def test_every_pair_gives_the_shape_and_type_that_its_name_says(source: str, target: str) -> None:
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
def test_what_cannot_be_converted_is_told(source: str, target: Any, text: str) -> None:
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
def test_arrays_alone_are_converted_as_images_are(source: str) -> None:
    image = noise(source)
    for target in TARGETS:
        expected = image_to_array(image, to=target)
        assert convert_pixels(image_to_array(image), source, target).tolist() == expected.tolist()
    with pytest.raises(ConversionError, match=f"{source} needs uint.*got float32 with 2"):
        convert_pixels(np.zeros((2, 2, 2), "f4"), source, "rgb8")
