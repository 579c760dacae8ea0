"""``rosidl-py bag video``: frames, their times and colours, and what is skipped; read back with PyAV."""

from __future__ import annotations

import json
import sys
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.bag_samples import file_size_limit

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.numpy import array_to_compressedimage, array_to_image

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

pytestmark = pytest.mark.needs("av", "PIL")
S = 1_000_000_000
String: Any = get_message("std_msgs/msg/String")


def image(level: int, height: int = 32, width: int = 48, compressed: bool = False) -> Any:
    """Return an image whose red is `level`."""
    array = np.full((height, width, 3), (level, 128, 0), np.uint8)
    return array_to_compressedimage(array, "rgb8", format="png") if compressed else array_to_image(array, "rgb8")


def write(path: Path, *images: tuple[float, Any], topic: str = "/camera") -> str:
    """Write images at seconds."""
    with BagWriter(path) as bag:
        for seconds, message in images:
            bag.write(topic, message, 10 * S + round(seconds * S))
    return str(path)


def even(levels: Iterable[int], hz: float, **options: Any) -> list[tuple[float, Any]]:
    return [(number / hz, image(level, **options)) for number, level in enumerate(levels)]


def read(path: Path) -> tuple[Fraction, list[float], list[Any]]:
    """Return the rate of a video, and times and mean colours of its frames."""
    import av

    times, colors = [], []
    with av.open(str(path)) as container:
        (stream,) = container.streams
        assert stream.codec_context.name == "h264"
        for frame in container.decode(video=0):
            assert frame.time is not None
            times.append(round(frame.time, 4))
            colors.append(frame.to_ndarray(format="rgb24").mean((0, 1)))
        assert isinstance(stream, av.VideoStream) and stream.average_rate is not None
        return stream.average_rate, times, colors


def reds(path: Path) -> list[int]:
    """Return the red of the frames, to the next multiple of 20."""
    return [round(color[0] / 20) * 20 for color in read(path)[2]]


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".mov"])
@pytest.mark.parametrize("compressed", [False, True])
def test_even_images_become_one_frame_each(run_here: Any, tmp_path: Path, suffix: str, compressed: bool) -> None:
    bag = write(tmp_path / "bag", *even(range(0, 200, 20), 10, compressed=compressed))
    out = tmp_path / f"out{suffix}"
    done = run_here("bag", "video", bag, str(out), "--topic", "/camera")
    assert done == (0, f"10 frames at 10 Hz of 10 images (0 repeated, 0 dropped) in {out}\n", "")
    rate, times, colors = read(out)
    assert rate == 10 and times == [number / 10 for number in range(10)]
    expected = [(level, 128, 0) for level in range(0, 200, 20)]
    assert np.abs(np.array(colors) - expected).max() < 8
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", out.name]


def test_images_are_repeated_and_dropped_so_that_times_are_right(run_here: Any, tmp_path: Path) -> None:
    times = [0, 0.1, 0.2, 0.5, 0.52, 0.54, 0.6, 0.7, 0.8]
    bag = write(tmp_path / "bag", *[(seconds, image(20 * number)) for number, seconds in enumerate(times)])
    out = tmp_path / "out.mp4"
    code, printed, err = run_here("bag", "video", bag, str(out))
    assert (code, err) == (0, "")
    assert printed == f"9 frames at 10 Hz of 9 images (2 repeated, 2 dropped) in {out}\n"
    assert reds(out) == [0, 20, 40, 40, 40, 100, 120, 140, 160]


@pytest.mark.parametrize(("fps", "rate", "frames"), [("5", 5, 5), ("20", 20, 19), ("29.97", Fraction(30000, 1001), 28)])
def test_fps_selects_the_rate(run_here: Any, tmp_path: Path, fps: str, rate: Fraction, frames: int) -> None:
    bag = write(tmp_path / "bag", *even(range(0, 200, 20), 10))
    out = tmp_path / "out.mp4"
    code, printed, _ = run_here("bag", "video", bag, str(out), "--fps", fps)
    assert code == 0 and printed.startswith(f"{frames} frames at {float(fps):g} Hz of 10 images")
    found, times, _ = read(out)
    assert abs(found - rate) < Fraction(1, 100) and len(times) == frames
    assert times == pytest.approx([float(number / rate) for number in range(frames)], abs=1e-3)


def test_half_the_rate_shows_every_second_image(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", *even(range(0, 200, 20), 10))
    assert run_here("bag", "video", bag, str(tmp_path / "2024-01-01T12:00:00.mp4"), "--fps", "5")[0] == 0
    assert reds(tmp_path / "2024-01-01T12:00:00.mp4") == [20, 60, 100, 140, 180]


@pytest.mark.parametrize(
    ("interval", "rate"),
    [
        (1 / 29.9, 30),
        (1 / 30.1, 30),
        (2 / 15, Fraction(15, 2)),
        (0.4, Fraction(5, 2)),
        (0.5, 2),
        (1, 1),
        (2, Fraction(1, 2)),
        (100, Fraction(1, 60)),
        (0.001, 240),
    ],
)
def test_rate_comes_from_the_median_interval(run_here: Any, tmp_path: Path, interval: float, rate: Fraction) -> None:
    images = [(number * interval, image(0, 16, 16)) for number in range(5)]
    code, printed, _ = run_here("bag", "video", write(tmp_path / "bag", *images), str(tmp_path / "out.mp4"), "--json")
    assert code == 0 and json.loads(printed)["fps"] == pytest.approx(float(rate))


def test_one_image_is_one_frame(run_here: Any, tmp_path: Path) -> None:
    code, printed, _ = run_here("bag", "video", write(tmp_path / "bag", (0, image(100))), str(tmp_path / "out.mp4"))
    assert code == 0 and printed.startswith("1 frame at 1 Hz of 1 image (0 repeated, 0 dropped)")
    assert reds(tmp_path / "out.mp4") == [100]


def test_odd_sizes_are_padded_with_a_note(run_here: Any, tmp_path: Path) -> None:
    import av

    bag = write(tmp_path / "bag", *even([100, 100], 10, height=31, width=47))
    out = tmp_path / "out.mp4"
    code, _, err = run_here("bag", "video", bag, str(out))
    assert (code, err) == (0, "images have an odd size; a row or column is repeated, as H.264 needs even sizes\n")
    with av.open(str(out)) as container:
        (frame, _) = container.decode(video=0)
    assert (frame.width, frame.height) == (48, 32)
    assert np.abs(frame.to_ndarray(format="rgb24").astype(int) - (100, 128, 0)).max() < 8


@pytest.mark.parametrize(
    ("images", "reason"),
    [
        (
            [(0, image(0)), (1, image(0)), (2, image(0, 16, 16))],
            "/camera at 12000000000 ns: the size of the image is 16 x 16, before 48 x 32; select a part with",
        ),
        (
            [(0, image(0)), (1, image(0)), (4000, image(0))],
            "/camera at 4010000000000 ns: there was no image for 3999 s; select a part with --start-offset",
        ),
        ([(0, array_to_image(np.zeros((2, 2), np.float32), "32FC1"))], "/camera has no image that can be a frame"),
        ([(0, image(0, 2, 70_000))], "the encoder does not accept frames of 70000 x 2: "),
        ([(0, image(0, 1, 3_000_000))], "the encoder does not accept frames of 3000000 x 1: "),
    ],
)
def test_video_that_cannot_be_written_fails_and_leaves_no_file(
    run_here: Any, tmp_path: Path, images: list[tuple[float, Any]], reason: str
) -> None:
    code, printed, err = run_here("bag", "video", write(tmp_path / "bag", *images), str(tmp_path / "out.mp4"))
    assert (code, printed) == (1, "") and f"error: {reason}" in err, err
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_damaged_images_and_images_without_colours_are_skipped_and_counted(run_here: Any, tmp_path: Path) -> None:
    depth = array_to_image(np.zeros((32, 48), np.uint16), "16UC1")
    good = even([20, 40, 60, 80, 100], 10)
    bag = write(tmp_path / "bag", *good[:2], (0.2, depth), *good[3:])
    code, printed, err = run_here("bag", "video", bag, str(tmp_path / "out.mp4"))
    assert code == 3 and printed.startswith("5 frames at 10 Hz of 4 images (1 repeated, 0 dropped)")
    assert err.startswith("/camera: 1 image skipped: the first at 10200000000 ns: encoding: 16UC1 may be depths")
    assert reds(tmp_path / "out.mp4") == [20, 40, 40, 80, 100]


def test_topic_must_be_named_if_there_are_several(run_here: Any, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for topic in ("/a", "/b"):
            bag.write(topic, image(100), S)
        bag.write("/text", String(), S)
    path, out = str(tmp_path / "bag"), str(tmp_path / "out.mp4")
    code, _, err = run_here("bag", "video", path, out)
    assert code == 1 and "bag has images of /a, /b; select one with --topic" in err
    code, _, err = run_here("bag", "video", path, out, "--topic", "/text")
    assert code == 1 and "/text has messages of std_msgs/msg/String; expected sensor_msgs/msg/Image or" in err
    assert run_here("bag", "video", path, out, "--topic", "/b")[0::2] == (0, "")


def test_part_of_a_bag_is_selected_by_times(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", *even(range(0, 200, 20), 10))
    part = "--start-offset", "0.4", "--duration", "0.3"
    assert run_here("bag", "video", bag, str(tmp_path / "out.mp4"), *part)[0] == 0
    assert reds(tmp_path / "out.mp4") == [80, 100, 120]


def test_existing_files_and_other_suffixes_are_refused(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", (0, image(0)))
    (tmp_path / "out.mp4").write_bytes(b"mine")
    assert run_here("bag", "video", bag, str(tmp_path / "out.mp4"))[2].endswith("out.mp4 exists already\n")
    assert (tmp_path / "out.mp4").read_bytes() == b"mine"
    (tmp_path / ".new.mp4").write_bytes(b"mine")
    code, _, err = run_here("bag", "video", bag, str(tmp_path / "new.mp4"))
    assert code == 1 and ".new.mp4 exists, perhaps of a run that goes on or was killed; remove it" in err
    assert (tmp_path / ".new.mp4").read_bytes() == b"mine"
    code, _, err = run_here("bag", "video", bag, str(tmp_path / "out.avi"))
    assert code == 1 and err.endswith("out.avi: expected a file that ends with .mp4, .mkv, .mov\n")


def test_full_disk_fails_and_leaves_no_file(run_here: Any, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    noise = [array_to_image(generator.integers(0, 255, (200, 200, 3), np.uint8), "rgb8") for _ in range(100)]
    bag = write(tmp_path / "bag", *[(number / 10, one) for number, one in enumerate(noise)])
    with file_size_limit(100_000):
        code, printed, err = run_here("bag", "video", bag, str(tmp_path / "out.mp4"))
    assert (code, printed) == (1, "") and "File too large" in err
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_missing_av_is_an_error_with_the_command(run_here: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    code, _, err = run_here("bag", "video", str(tmp_path), str(tmp_path / "out.mp4"))
    assert code == 1 and "this needs av, which is not installed: pip install" in err and "[video]" in err
