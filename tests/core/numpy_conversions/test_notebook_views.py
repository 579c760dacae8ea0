"""Views of notebooks: pictures are decoded again, and texts of messages are escaped."""

from __future__ import annotations

import base64
import io
import re
import subprocess
import sys
import time
from html.parser import HTMLParser
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from PIL import Image as Pillow
from sensor_msgs.msg import CompressedImage, Image, Imu, LaserScan, PointCloud2
from std_msgs.msg import String

from rosidl_py_gen import compile_definition, get_message, type_name
from rosidl_py_gen.numpy import (
    array_to_compressedimage,
    array_to_image,
    array_to_occupancygrid,
    array_to_pointcloud,
    image_to_array,
)
from rosidl_py_gen.numpy.notebook import bag_html, message_html, node_html

GRAY_ENCODINGS = ("mono8", "mono16", "8UC1")
COLOR_ENCODINGS = (
    *GRAY_ENCODINGS,
    *(f"{order}{bits}" for order in ("rgb", "bgr", "rgba", "bgra") for bits in (8, 16)),
    *(f"bayer_{order}{bits}" for order in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)),
    *("yuv422", "uyvy", "yuv422_yuy2", "yuyv", "nv21", "nv24"),
)
EVIL = "<script>alert(1)</script>\x1b[31m\"'&"


class _Checker(HTMLParser):
    """Parser that raises for tags that are not closed in order, and for tags that views do not use."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        assert tag in {"b", "div", "details", "i", "img", "summary", "table", "tbody", "td", "th", "thead", "tr"}, tag
        assert {name for name, _ in attrs} <= {"alt", "src", "style", "open"}
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def text_of(html: str) -> str:
    checker = _Checker()
    checker.feed(html)
    checker.close()
    assert not checker.open
    return checker.text


def pixels(message: Any) -> np.ndarray[Any, Any]:
    """Return the pixels of the picture of a message; its tree must be there, and closed."""
    html = message_html(message)
    text_of(html)
    found = re.search(r'src="data:image/png;base64,([^"]+)"', html)
    assert found and f"<details><summary><i>{type_name(message)}</i>" in html, html[:500]
    return np.asarray(Pillow.open(io.BytesIO(base64.b64decode(found[1]))))


def fallback(message: Any) -> str:
    """Return the reason why a message has no picture; its tree must be open."""
    html = message_html(message)
    text_of(html)
    assert "<img" not in html and f"<details open><summary><i>{type_name(message)}</i>" in html
    found = re.match(r"<div>No picture: ([^<]+)</div>", html)
    assert found, html[:500]
    return found[1]


def test_pictures_of_images_have_their_colours() -> None:
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[:20, :, 0], picture[20:, :30] = 255, (0, 128, 255)
    for encoding, order in (("rgb8", slice(None)), ("bgr8", slice(None, None, -1))):
        message = array_to_image(np.ascontiguousarray(picture[..., order]), encoding)
        assert (pixels(message) == picture).all()
        assert "60 x 40, " + encoding in text_of(message_html(message))
    assert (pixels(array_to_image(picture[..., 0], "mono8")) == picture[..., 0]).all()
    assert pixels(array_to_image(picture[..., 0].astype(np.uint16) * 257, "mono16")).max() == 255
    assert pixels(array_to_image(picture[..., 0], "bayer_rggb8")).shape == (40, 60, 3)
    large = np.zeros((3000, 4000, 3), np.uint8)
    large[:, 2000:] = 200
    start = time.process_time()
    small = pixels(array_to_image(large, "rgb8"))
    assert time.process_time() - start < 2 and small.shape == (429, 572, 3)
    assert (small[:, :280] == 0).all() and (small[:, 290:] == 200).all()


@pytest.mark.parametrize("encoding", COLOR_ENCODINGS)
def test_pictures_have_the_pixels_of_the_conversion(encoding: str) -> None:
    image = Image(encoding=encoding, width=12, height=8, step=8 * 12)
    image.data = np.random.default_rng(1).bytes(image.step * image.height * 3)
    to = "mono8" if encoding in GRAY_ENCODINGS else "rgb8"
    assert (pixels(image) == image_to_array(image, to=to)).all()


def test_depths_are_scaled_and_unknown_ones_are_black() -> None:
    depths = np.linspace(1, 5, 600, dtype=np.float32).reshape(20, 30)
    depths[0, 0], depths[0, 1] = np.nan, np.inf
    gray = pixels(array_to_image(depths, "32FC1"))
    assert gray[0, 0] == gray[0, 1] == 0 and gray[-1, -1] == 255 and (np.diff(gray[5:].ravel().astype(int)) >= 0).all()
    assert "values from 1.01" in text_of(message_html(array_to_image(depths, "32FC1")))
    assert pixels(array_to_image((depths[1:] * 1000).astype(np.uint16), "16UC1")).shape == (19, 30)
    assert fallback(array_to_image(np.full((2, 2), np.nan, np.float32), "32FC1")).endswith(
        "no pixel is a finite number"
    )


def test_compressed_images_are_decoded_and_downscaled(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = np.zeros((1000, 1500, 3), np.uint8)
    picture[..., 1] = 90
    small = pixels(array_to_compressedimage(picture, format="png"))
    assert small.shape == (334, 500, 3) and (small[..., 1] == 90).all()
    jpeg = array_to_compressedimage(picture, format="jpeg")
    assert abs(pixels(jpeg)[..., 1].mean() - 90) < 3
    assert fallback(CompressedImage(format="jpeg", data=b"nothing")).startswith("data: ")
    monkeypatch.setitem(sys.modules, "PIL", None)
    missing = fallback(array_to_image(picture, "rgb8"))
    assert re.match(r"this needs PIL, which is not installed: pip install .*\[images\]", missing)
    html = message_html(jpeg)
    found = re.search(r'src="data:image/jpeg;base64,([^"]+)"', html)
    assert found and base64.b64decode(found[1]) == bytes(jpeg.data)
    reason = fallback(CompressedImage(format="jpeg", data=b"nothing"))
    assert "pip install" in reason


def test_pictures_of_maps_have_the_first_row_at_the_bottom_and_visible_walls() -> None:
    cells = np.zeros((30, 50), np.int8)
    cells[0], cells[10:, :10] = 100, -1
    gray = pixels(array_to_occupancygrid(cells, 0.05))
    assert (gray[-1] == 0).all() and (gray[0, :10] == 160).all() and gray[0, -1] == 255
    wide = np.zeros((100, 3000), np.int8)
    wide[:, 1501] = 100
    small = pixels(array_to_occupancygrid(wide, 0.05))
    assert small.shape == (20, 600) and (small[:, 300] == 0).all()
    grid = array_to_occupancygrid(cells, 0.05)
    grid.info.width = 51
    assert fallback(grid) == "data: 1500 cells, but 30 x 51 need 1530"
    assert fallback(OccupancyGrid()).endswith("no pixels")


def points(x: Any, y: Any, z: Any) -> Any:
    rows = np.zeros(len(x), [(name, np.float32) for name in "xyz"])
    rows["x"], rows["y"], rows["z"] = x, y, z
    return array_to_pointcloud(rows)


def test_clouds_are_displayed_from_above() -> None:
    side = np.linspace(0, 4, 300)
    low, high = np.zeros(300), np.full(300, 2.0)
    cloud = points(np.append(side, low), np.append(low, side / 2), np.append(low, high))
    picture = pixels(cloud)
    rows, columns = np.nonzero((picture != 255).any(2))
    assert np.ptp(columns) > 450 and 220 < np.ptp(rows) < 240  # 4 m to the right, 2 m upwards
    colors = {tuple(color) for color in picture.reshape(-1, 3).tolist()}
    assert colors == {(255, 255, 255), (68, 1, 84), (253, 231, 37)}  # low and high points
    some = points([np.nan, np.inf, 1, 2], [1, 1, 1, 2], [0, 0, 0, 0])
    assert "4 points from above; x from 1 to 2 m, y from 1 to 2 m" in text_of(message_html(some))
    assert fallback(points([np.nan], [0], [0])).endswith("no finite points")
    assert "no field" in fallback(PointCloud2())
    random = np.random.default_rng(1)
    many = points(*random.normal(size=(3, 1_000_000)))
    start = time.process_time()
    assert max(pixels(many).shape) == 480 and time.process_time() - start < 3
    assert len(message_html(many)) < 600_000
    assert pixels(points([3e38, -3e38], [0, 0], [0, 0])).shape == (40, 480, 3)


def test_scans_and_paths_are_displayed_from_above() -> None:
    scan = LaserScan(angle_min=0.0, angle_increment=np.pi / 180, range_min=0.1, range_max=10.0)
    scan.ranges = np.array([2.0] * 180 + [np.inf] * 180, np.float32)
    picture = pixels(scan)
    assert "180 of 360 ranges" in text_of(message_html(scan))
    rows, columns = np.nonzero((picture == (31, 119, 180)).all(2))
    red = np.argwhere((picture == (214, 39, 40)).all(2)).mean(0)
    assert np.ptp(columns) > 450 and rows.max() <= red[0] + 4  # half a circle, above the scanner
    assert fallback(LaserScan()).endswith("no finite points")
    path = Path()
    for number in range(11):
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = number / 2, float(number >= 5)
        path.poses.append(pose)
    picture = pixels(path)
    start, end = (np.argwhere((picture == color).all(2)).mean(0) for color in ((44, 160, 44), (214, 39, 40)))
    assert start[1] < 30 and end[1] > 450 and end[0] < start[0]
    line = np.argwhere((picture == (31, 119, 180)).all(2))
    assert {*range(30, 450)} <= {*line[:, 1].tolist()}  # without gaps
    assert fallback(Path()).endswith("no finite points")
    path.poses[3].pose.position.x = float("nan")
    assert pixels(path).shape == (112, 480, 3)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"encoding": "rgb9", "height": 1, "width": 1}, "rgb9"),
        ({"encoding": EVIL, "height": 1, "width": 1}, "&lt;script&gt;"),
        ({"encoding": "rgb8", "height": 9, "width": 9, "step": 27, "data": b"123"}, "data: 3 bytes, but 9 rows"),
        ({"encoding": "rgb8", "height": 4_000_000_000, "width": 4_000_000_000, "step": 1}, "step: 1 bytes"),
        ({"encoding": "mono8"}, "0 x 0, mono8: no pixels"),
    ],
)
def test_invalid_images_are_displayed_as_tree_with_a_reason(fields: dict[str, Any], reason: str) -> None:
    assert reason in fallback(Image(**fields))


def test_messages_are_displayed_as_trees_with_truncated_values() -> None:
    imu = Imu()
    imu.header.frame_id, imu.header.stamp.sec, imu.header.stamp.nanosec = EVIL, 7, 5
    html = message_html(imu)
    text = text_of(html)
    assert html.startswith("<details open><summary><i>sensor_msgs/msg/Imu</i></summary>")
    assert "<b>header</b> <i>std_msgs/msg/Header</i></summary>" in html and "stamp 7.000000005 s" in text
    assert "<script" not in html and "\x1b" not in html and "<script>alert(1)</script>\ufffd[31m\"'&" in text
    assert "orientation_covariance float64[9] 0.0, 0.0" in text
    assert 'data "' + "x" * 200 + '" … 100000 characters' in text_of(message_html(String(data="x" * 100_000)))
    bytes_message = get_message("std_msgs/msg/UInt8MultiArray")(data=bytes(range(100)))
    assert "data uint8[100] 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, …" in text_of(message_html(bytes_message))
    poses = get_message("geometry_msgs/msg/PoseArray")(poses=[get_message("geometry_msgs/msg/Pose")()] * 5000)
    html = message_html(poses)
    assert len(html) < 20_000 and "[9] geometry_msgs/msg/Pose" in text_of(html) and "… 4990 more" in html
    names = get_message("sensor_msgs/msg/JointState")(name=[EVIL] * 3)
    assert "<script" not in message_html(names)
    wide = compile_definition("test_msgs/msg/Wide", "\n".join(f"float64 x{number}" for number in range(2000)))
    html = message_html(wide())
    assert "x999" in html and "x1000" not in html and text_of(html).endswith("…")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", range(4))
def test_any_bytes_are_displayed_without_warnings(seed: int) -> None:
    random = np.random.default_rng(seed)
    for encoding in ("32FC1", "64FC3", "16SC1", "8UC2", "bgra8", "nv21", "yuv422", "bayer_rggb8"):
        width, height = (2 * int(size) for size in random.integers(0, 30, 2))
        image = Image(encoding=encoding, width=width, height=height, step=24 * width)
        image.data = random.bytes(image.step * height * 2)
        text_of(message_html(image))
    field = get_message("sensor_msgs/msg/PointField")
    for kind, size in ((7, 4), (8, 8), (2, 1)):
        cloud = PointCloud2(
            height=1, width=100, point_step=3 * size, row_step=300 * size, data=random.bytes(300 * size)
        )
        cloud.fields = [field(name=name, offset=at * size, datatype=kind, count=1) for at, name in enumerate("xyz")]
        text_of(message_html(cloud))
    path = Path()
    for value in (1e308, -1e308, float("nan"), *random.normal(size=5)):
        pose = PoseStamped()
        pose.pose.position.x = float(value)
        path.poses.append(pose)
    text_of(message_html(path))


def test_messages_with_wrong_values_are_displayed() -> None:
    imu = Imu()
    imu.header, imu.orientation, imu.orientation_covariance = None, 5, [object()] * 3
    assert "orientation 5" in text_of(message_html(imu))
    scan = LaserScan()
    scan.ranges = "none"
    assert "No picture" in text_of(message_html(scan))
    path = Path()
    path.poses = 7
    assert "No picture" in text_of(message_html(path))


def test_bags_and_nodes_are_displayed_as_tables() -> None:
    topics = [SimpleNamespace(name=f"/{EVIL}", type_name="std_msgs/msg/String", count=None)]
    bag = SimpleNamespace(path="drive", start_ns=0, end_ns=2_500_000_000, topics={"a": 1}, channels=topics)
    text = text_of(bag_html(bag))
    assert "drive: 1 topic, 2.500 s" in text and "<script>" in text and "<script" not in bag_html(bag)
    bag.channels = topics * 600
    assert "100 more" in text_of(bag_html(bag))
    node = SimpleNamespace(entities=[SimpleNamespace()])
    assert "kind" in text_of(node_html(node))


@pytest.mark.slow
def test_process_without_ipython_loads_no_modules_for_views() -> None:
    program = (
        "import sys; import rosidl_py_gen.numpy\n"
        "print([name for name in ('IPython', 'PIL', 'rosidl_py_gen.runtime', 'rosidl_py_gen.numpy.pictures') "
        "if name in sys.modules])"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout == "[]\n"
