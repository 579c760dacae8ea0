"""``rosidl-py bag images``: files of recorded images, their names, and what is skipped."""

from __future__ import annotations

import json
import struct
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.bag_damage import zeroed_chunk
from support.bag_samples import file_size_limit

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.bags import BagReader, BagTopic, BagWriter, RawMessage
from rosidl_py_gen.numpy import array_to_compressedimage, array_to_image, compressedimage_to_array, image_to_array

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

pytestmark = pytest.mark.needs("PIL")
S = 1_000_000_000
Image: Any = get_message("sensor_msgs/msg/Image")
CompressedImage: Any = get_message("sensor_msgs/msg/CompressedImage")
String: Any = get_message("std_msgs/msg/String")
COLOR = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
GRAY = np.arange(24, dtype=np.uint16).reshape(4, 6) * 2000


def write(path: Path, *messages: tuple[str, Any], step_ns: int = S // 10) -> str:
    with BagWriter(path) as bag:
        for number, (topic, message) in enumerate(messages):
            bag.write(topic, message, 10 * S + number * step_ns)
    return str(path)


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def pixels(path: Path) -> Any:
    from PIL import Image as PillowImage

    with PillowImage.open(path) as picture:
        return np.array(picture)


@pytest.mark.parametrize(
    ("encoding", "array", "expected"),
    [
        ("rgb8", COLOR, COLOR),
        ("bgr8", COLOR, COLOR[..., ::-1]),
        ("rgba8", np.dstack([COLOR, COLOR[..., 0]]), np.dstack([COLOR, COLOR[..., 0]])),
        ("mono8", COLOR[..., 0], COLOR[..., 0]),
        ("mono16", GRAY, GRAY),
        ("16UC1", GRAY, GRAY),
        ("16UC1", GRAY.astype(">u2"), GRAY),
    ],
)
def test_images_become_png_with_equal_pixels(
    run_here: Any, tmp_path: Path, encoding: str, array: Any, expected: Any
) -> None:
    bag = write(tmp_path / "bag", ("/camera/image", array_to_image(array, encoding)))
    out = tmp_path / "out"
    assert run_here("bag", "images", bag, "--out", str(out)) == (0, f"1 image of 1 topic in {out}\n", "")
    assert files(out) == ["camera/image/0000000010.000000000.png"]
    assert np.array_equal(pixels(out / "camera/image/0000000010.000000000.png"), expected)


def test_images_become_jpeg_with_similar_pixels(run_here: Any, tmp_path: Path) -> None:
    array = np.full((16, 16, 3), (200, 100, 50), np.uint8)
    bag = write(tmp_path / "bag", ("/a", array_to_image(array, "rgb8")))
    assert run_here("bag", "images", bag, "-o", str(tmp_path / "out"), "--format", "jpeg", "--quality", "90")[0] == 0
    assert files(tmp_path / "out") == ["a/0000000010.000000000.jpg"]
    assert np.abs(pixels(tmp_path / "out/a/0000000010.000000000.jpg").astype(int) - array).max() < 6


@pytest.mark.parametrize(("format", "suffix"), [("jpeg", ".jpg"), ("png", ".png")])
def test_compressed_images_keep_their_bytes(run_here: Any, tmp_path: Path, format: str, suffix: str) -> None:
    image: Any = array_to_compressedimage(COLOR, "rgb8", format=format)
    bag = write(tmp_path / "bag", ("/a", image))
    assert run_here("bag", "images", bag, "-o", str(tmp_path / "out"))[0] == 0
    assert (tmp_path / f"out/a/0000000010.000000000{suffix}").read_bytes() == image.data.tobytes()


def test_compressed_depth_of_16uc1_becomes_png(run_here: Any, tmp_path: Path) -> None:
    png: Any = array_to_compressedimage(GRAY, "mono16", format="png")
    image = CompressedImage(format="16UC1; compressedDepth png", data=struct.pack("<iff", 0, 0, 0) + png.data.tobytes())
    bag = write(tmp_path / "bag", ("/depth", image))
    assert run_here("bag", "images", bag, "-o", str(tmp_path / "out"))[0] == 0
    assert np.array_equal(pixels(tmp_path / "out/depth/0000000010.000000000.png"), GRAY)
    assert np.array_equal(compressedimage_to_array(image), GRAY)


def broken() -> Iterable[tuple[str, Any, str]]:
    good: Any = array_to_image(COLOR, "rgb8")
    jpeg: Any = array_to_compressedimage(COLOR, "rgb8")
    png: Any = array_to_compressedimage(COLOR, "rgb8", format="png")
    floats: Any = array_to_image(np.zeros((2, 2), np.float32), "32FC1")
    yield "unknown", Image(height=1, width=1, step=3, encoding="rgb9", data=[1, 2, 3]), 'encoding: "rgb9" is not known'
    yield "no form", floats, "encoding: 32FC1 has no colours"
    short = Image(height=good.height, width=good.width, step=good.step, encoding="rgb8", data=good.data[:-1])
    yield "short", short, "data: 71 bytes, but 4 rows of 18 bytes need 72"
    yield "empty", Image(encoding="rgb8"), "array: there are no pixels"
    yield "cut jpeg", CompressedImage(format="jpeg", data=jpeg.data[:-40]), "data: the jpg of "
    yield "cut png", CompressedImage(format="png", data=png.data[:-20]), "data: the png of "
    yield (
        "cut webp",
        CompressedImage(format="webp", data=b"RIFF\xff\0\0\0WEBP"),
        "data: the webp of 12 bytes breaks off",
    )
    yield "text", CompressedImage(format="jpeg", data=b"hello"), "data: 5 bytes are not JPEG, PNG, TIFF or WebP"
    yield "nothing", CompressedImage(format="jpeg"), "data: 0 bytes are not JPEG"
    yield "rvl", CompressedImage(format="16UC1; compressedDepth rvl", data=b"x" * 40), "is no picture file"
    yield "floats", CompressedImage(format="32FC1; compressedDepth png", data=b"x" * 40), "is no picture file"


BROKEN = [*broken()]


@pytest.mark.parametrize(("message", "reason"), [one[1:] for one in BROKEN], ids=[one[0] for one in BROKEN])
def test_image_that_cannot_be_written_is_skipped_and_counted(
    run_here: Any, tmp_path: Path, message: Any, reason: str
) -> None:
    good: Any = (array_to_image if isinstance(message, Image) else array_to_compressedimage)(COLOR, "rgb8")
    bag = write(tmp_path / "bag", ("/a", good), ("/a", message), ("/a", message), ("/a", good))
    out = tmp_path / "out"
    code, printed, err = run_here("bag", "images", bag, "-o", str(out))
    assert (code, printed) == (3, f"2 images of 1 topic in {out}\n")
    assert err.startswith("/a: 2 images skipped: the first at 10100000000 ns: ") and reason in err
    assert len(err.splitlines()) == 1 and len(files(out)) == 2


def test_message_that_cannot_be_decoded_is_skipped_and_counted(run_here: Any, tmp_path: Path) -> None:
    good = array_to_image(COLOR, "rgb8")
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", Image)
        for number, data in enumerate([good.encode(), good.encode()[:-30], good.encode()]):
            bag.write("/a", data, number)
    code, printed, err = run_here("bag", "images", str(tmp_path / "bag"), "-o", str(tmp_path / "out"))
    assert code == 3 and printed.startswith("2 images of 1 topic")
    assert "/a: 1 image skipped: " in err and "/a at 1 ns: " in err


def test_damaged_part_of_the_bag_is_reported(run_here: Any, tmp_path: Path) -> None:
    zeroed_chunk(tmp_path / "damaged.mcap", 1)
    with BagWriter(tmp_path / "bag.mcap", compression="") as bag:
        for number in range(3):
            bag.write("/a", array_to_image(np.full((400, 400, 3), number, np.uint8), "rgb8"), number)
            bag.flush()
    data = bytearray((tmp_path / "bag.mcap").read_bytes())
    middle = data.index(b"\1" * 1000)
    data[middle] = 7
    (tmp_path / "bag.mcap").write_bytes(data)
    code, printed, err = run_here("bag", "images", str(tmp_path / "bag.mcap"), "-o", str(tmp_path / "out"), "--json")
    document = json.loads(printed)
    assert code == 3 and "skipped a damaged part" in err
    assert document["topics"] == [{"topic": "/a", "images": 2}] and len(document["damaged"]) == 1


def test_topics_without_images_are_counted_and_cannot_be_selected(run_here: Any, tmp_path: Path) -> None:
    image = array_to_image(COLOR, "rgb8")
    messages = [("/a", image), ("/b", image), ("/text", String()), ("/more", String())]
    bag = write(tmp_path / "bag", *messages)
    code, printed, err = run_here("bag", "images", bag, "-o", str(tmp_path / "out"))
    assert (code, err) == (0, "2 topics of other types skipped\n") and printed.startswith("2 images of 2 topics")
    code, printed, err = run_here("bag", "images", bag, "-o", str(tmp_path / "b"), "--topics", "/b")
    assert (code, err) == (0, "") and files(tmp_path / "b") == ["b/0000000010.100000000.png"]
    code, _, err = run_here("bag", "images", bag, "-o", str(tmp_path / "c"), "--topics", "/b", "/text")
    assert code == 1 and "/text has messages of std_msgs/msg/String; expected sensor_msgs/msg/Image or" in err
    code, _, err = run_here("bag", "images", bag, "-o", str(tmp_path / "c"), "--topics", "/bb")
    assert code == 1 and "has no topic /bb" in err
    texts = write(tmp_path / "texts", ("/text", String()))
    code, _, err = run_here("bag", "images", texts, "-o", str(tmp_path / "c"))
    assert code == 1 and err.endswith("has no topic of sensor_msgs/msg/Image or sensor_msgs/msg/CompressedImage\n")
    assert not (tmp_path / "c").exists()


def test_messages_of_another_type_on_the_topic_are_skipped(run_here: Any, tmp_path: Path) -> None:
    first = write(tmp_path / "first.mcap", ("/a", array_to_image(COLOR, "rgb8")))
    second = write(tmp_path / "second.mcap", ("/a", String()), ("/a", String()))
    run_here("bag", "merge", str(tmp_path / "both.mcap"), first, second)
    code, printed, err = run_here("bag", "images", str(tmp_path / "both.mcap"), "-o", str(tmp_path / "out"))
    assert code == 3 and printed.startswith("1 image of 1 topic")
    assert err == "/a: 2 images skipped: messages of std_msgs/msg/String\n"


def test_part_of_a_bag_is_selected_by_times(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", *[("/a", array_to_image(COLOR, "rgb8"))] * 10)
    part = "--start-offset", "0.3", "--duration", "0.2"
    assert run_here("bag", "images", bag, "--output", str(tmp_path / "out"), *part)[0] == 0
    assert files(tmp_path / "out") == ["a/0000000010.300000000.png", "a/0000000010.400000000.png"]


def test_images_with_equal_time_get_different_names(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", *[("/a", array_to_image(COLOR + number, "rgb8")) for number in range(3)], step_ns=0)
    assert run_here("bag", "images", bag, "-o", str(tmp_path / "out"))[0] == 0
    names = ["a/0000000010.000000000-1.png", "a/0000000010.000000000-2.png", "a/0000000010.000000000.png"]
    assert files(tmp_path / "out") == names
    assert [pixels(tmp_path / "out" / name)[0, 0, 0] for name in names] == [1, 2, 0]


def test_topic_without_a_possible_file_name_is_skipped(run_here: Any, tmp_path: Path) -> None:
    long = f"/{'ü' * 100}"
    bag = write(tmp_path / "bag", *[(topic, array_to_image(COLOR, "rgb8")) for topic in ("/a", long, "/b")])
    code, printed, err = run_here("bag", "images", bag, "-o", str(tmp_path / "out"))
    assert (code, printed) == (3, f"2 images of 2 topics in {tmp_path / 'out'}\n")
    assert f"{long}: 1 image skipped" in err and "no file of this name" in err


def test_topic_with_an_invalid_definition_is_skipped_unless_selected(run_here: Any, tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    with BagWriter(path) as bag:
        bad = BagTopic("/bad", "sensor_msgs/msg/Image", "uint8 !!! x")
        bag.add_raw_topic(bad)
        bag.write_raw(RawMessage(bad, b"\0\1\0\0", S, S))
        bag.write("/good", array_to_image(COLOR, "rgb8"), S)
    code, printed, err = run_here("bag", "images", str(path), "-o", str(tmp_path / "out"))
    assert code == 3 and printed.startswith("1 image of 1 topic") and "/bad: 1 image skipped" in err
    assert run_here("bag", "images", str(path), "-o", str(tmp_path / "two"), "--topics", "/bad")[0] == 1


def test_part_without_images_is_an_error(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", *[("/a", array_to_image(COLOR, "rgb8"))] * 2, step_ns=10 * S)
    words = ("--start-offset", "3", "--duration", "1")
    code, _, err = run_here("bag", "images", bag, "-o", str(tmp_path / "out"), *words)
    assert code == 1 and err.endswith("bag has no images in the selected part\n")


@pytest.mark.parametrize("topic", ["/../../evil", "..", "/a/./b", "//x//", "/a b:c*\\d", "/ü"])
def test_files_stay_in_the_folder_for_any_topic_name(run_here: Any, tmp_path: Path, topic: str) -> None:
    (tmp_path / "deep/er").mkdir(parents=True)
    bag = write(tmp_path / "deep/er/bag.mcap", (topic, array_to_image(COLOR, "rgb8")))
    out = tmp_path / "deep/er/out"
    assert run_here("bag", "images", bag, "-o", str(out))[0] == 0
    (name,) = files(out)
    assert name.endswith("0000000010.000000000.png") and set(name) <= set(
        "%./-_abcdefghijklmnopqrstuvwxyz0123456789ABCDEF"
    )
    assert {path.name for path in (tmp_path / "deep/er").iterdir()} == {"bag.mcap", "out"}


def test_folder_with_files_is_refused(run_here: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", ("/a", array_to_image(COLOR, "rgb8")))
    for out in (tmp_path, tmp_path / "bag/metadata.yaml"):
        before = files(tmp_path)
        code, _, err = run_here("bag", "images", bag, "-o", str(out))
        assert code == 1 and err == f"error: {out} exists already; expected a new or an empty folder\n"
        assert files(tmp_path) == before
    (tmp_path / "empty").mkdir()
    assert run_here("bag", "images", bag, "-o", str(tmp_path / "empty"))[0] == 0


def test_full_disk_leaves_no_incomplete_file(run_here: Any, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (100, 100, 3), np.uint8)
    bag = write(tmp_path / "bag", ("/a", array_to_image(COLOR, "rgb8")), ("/a", array_to_image(noise, "rgb8")))
    with file_size_limit(10_000):
        code, _, err = run_here("bag", "images", bag, "-o", str(tmp_path / "out"))
    assert code == 1 and "File too large" in err
    assert files(tmp_path / "out") == ["a/0000000010.000000000.png"]


def test_definition_without_the_fields_of_an_image_is_skipped(run_here: Any, tmp_path: Path) -> None:
    odd = compile_definition("sensor_msgs/msg/CompressedImage", "string format\n")
    bag = write(tmp_path / "bag.mcap", ("/a", odd(format="jpeg")))
    code, printed, err = run_here("bag", "images", bag, "-o", str(tmp_path / "out"))
    assert (
        code == 3 and printed.startswith("0 images of 0 topics") and "expected a sensor_msgs/msg/CompressedImage" in err
    )


def test_missing_pillow_is_an_error_with_the_command(run_here: Any, tmp_path: Path, monkeypatch: Any) -> None:
    raw = write(tmp_path / "raw", ("/a", array_to_image(COLOR, "rgb8")))
    compressed = write(tmp_path / "compressed", ("/a", array_to_compressedimage(COLOR, "rgb8")))
    monkeypatch.setitem(sys.modules, "PIL", None)
    code, _, err = run_here("bag", "images", raw, "-o", str(tmp_path / "out"))
    assert code == 1 and "this needs PIL, which is not installed: pip install" in err and "[images]" in err
    assert run_here("bag", "images", compressed, "-o", str(tmp_path / "out"))[0] == 0  # its bytes are copied


def test_json_lists_topics_and_skipped_images(run_here: Any, tmp_path: Path) -> None:
    image, floats = array_to_image(COLOR, "rgb8"), array_to_image(np.zeros((2, 2), np.float32), "32FC1")
    bag = write(tmp_path / "bag", ("/a", image), ("/depth", floats), ("/text", String()))
    code, printed, err = run_here("bag", "images", bag, "-o", str(tmp_path / "out"), "--json")
    document = json.loads(printed)
    assert (code, err) == (3, "")
    assert document["topics"] == [{"topic": "/a", "images": 1}, {"topic": "/depth", "images": 0}]
    (skipped,) = document["skipped"]
    assert (skipped["topic"], skipped["images"], document["other_topics"]) == ("/depth", 1, 1)
    assert skipped["reason"].startswith("the first at 10100000000 ns: encoding: 32FC1 has no colours")


def test_written_pixels_equal_the_arrays_of_the_bag(run_here: Any, tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    arrays = [generator.integers(0, 255, (9, 7, 2), np.uint8) for _ in range(3)]
    bag = write(tmp_path / "bag", *[("/a", array_to_image(one[:, :6], "yuyv")) for one in arrays])
    assert run_here("bag", "images", bag, "-o", str(tmp_path / "out"))[0] == 0
    with BagReader(bag) as reader:
        for path, item in zip(sorted((tmp_path / "out/a").iterdir()), reader, strict=True):
            assert np.array_equal(pixels(path), image_to_array(item.message, to="rgb8"))
