"""Codec of rclpy's messages: recorded bytes, errors, and messages of both kinds in one."""

from __future__ import annotations

import array
from collections import deque
from random import Random
from typing import Any

import numpy as np
import pytest
from each_case import each_case
from support.bundled_interfaces import message, reference, vectors, vectors_by_type
from support.example_counts import examples
from support.rclpy_messages import rclpy_class

from rosidl_py_gen import (
    DecodeError,
    EncodeError,
    decode,
    encode,
    from_dict,
    from_json,
    get_message,
    records,
    to_dict,
    to_json,
)
from rosidl_py_gen import messages as as_messages
from rosidl_py_gen.numpy import (
    array_to_image,
    array_to_occupancygrid,
    array_to_pointcloud,
    image_to_array,
    occupancygrid_to_array,
    pointcloud_to_array,
)

BY_TYPE = vectors_by_type()
pytestmark = [
    pytest.mark.usefixtures("message_api"),
    pytest.mark.filterwarnings("ignore::rosidl_py_gen.ImportHookWarning"),  # of classes other tests generate
]


@each_case("name", sorted(BY_TYPE))
def test_recorded_bytes_round_trip_and_equal_native_messages(name: str) -> None:
    cls, own = rclpy_class(name), message(name)
    for vector in BY_TYPE[name]:
        for data in (vector.cdr, bytearray(vector.cdr), memoryview(vector.cdr), vector.cdr + b"\0\0\0"):
            found = decode(cls, data)
            assert type(found) is cls and encode(found) == vector.cdr
            assert to_json(found) == to_json(decode(own, vector.cdr))
        assert encode(from_dict(cls, to_dict(found))) == encode(from_json(cls, to_json(found))) == vector.cdr
        again = decode(cls, vector.cdr, arrays=True)
        assert encode(again) == vector.cdr


def test_truncated_bytes_are_refused_as_by_native_messages() -> None:
    data = rclpy_class("std_msgs/msg/ByteMultiArray")(data=[b"a", b"b"]).encode()[:-1]
    for cls in (message("std_msgs/msg/ByteMultiArray"), rclpy_class("std_msgs/msg/ByteMultiArray")):
        with pytest.raises(DecodeError, match=r"ByteMultiArray\.data: at byte 16: expected 2 bytes"):
            decode(cls, data)


def test_damaged_bytes_have_equal_outcomes_with_both_message_apis() -> None:
    random = Random(5)
    for _ in range(examples(300)):
        vector = random.choice(vectors())
        data = bytearray(vector.cdr[: random.choice((len(vector.cdr), random.randrange(4, len(vector.cdr) + 1)))])
        for _ in range(random.choice((1, 2, 4))):
            at = random.randrange(4, len(data) + 1)
            data[at : at + 1] = bytes([random.choice((0, 1, 127, 255))])
        assert _decode_outcome(rclpy_class(vector.type), data) == _decode_outcome(message(vector.type), data)


def _decode_outcome(cls: Any, data: bytearray) -> Any:
    try:
        found = decode(cls, bytes(data))
    except DecodeError as error:
        return str(error)
    return to_json(found), encode(found)


def test_big_endian_bytes_are_decoded() -> None:
    for vector in vectors()[::10]:
        big = reference().encode(vector.type, vector.value, big_endian=True)
        assert encode(decode(rclpy_class(vector.type), big)) == vector.cdr


# --- values -----------------------------------------------------------------------------------------------------------


def test_received_values_can_be_modified() -> None:
    cls = rclpy_class("test_msgs/msg/Arrays")
    found = decode(cls, cls().encode())
    found.float64_values[1] = 5
    found.bool_values[0] = True
    found.byte_values[2] = b"\xff"
    assert to_dict(decode(cls, found.encode()))["float64_values"] == [0, 5, 0]
    assert decode(cls, found.encode()).byte_values == [b"\0", b"\0", b"\xff"]
    assert [type(found.bool_values), type(found.byte_values)] == [list, list]
    scan = rclpy_class("sensor_msgs/msg/LaserScan")
    data = bytearray(scan(ranges=range(20000)).encode())
    found = decode(scan, memoryview(data))
    data[:] = bytes(len(data))
    found.ranges.append(7)
    assert found.ranges[-2:] == array.array("f", [19999, 7])


@pytest.mark.parametrize(
    ("name", "values", "path"),
    [
        ("std_msgs/msg/Byte", {"data": 5}, ".data: expected bytes of length 1, found 5"),
        ("std_msgs/msg/Byte", {"data": b"ab"}, ".data: expected bytes of length 1, found b'ab'"),
        ("test_msgs/msg/Arrays", {"float64_values": [1, 2]}, ".float64_values: expected exactly 3 elements, found 2"),
        (
            "test_msgs/msg/Arrays",
            {"byte_values": [b"a", 2, b"c"]},
            ".byte_values[1]: expected bytes of length 1, found 2",
        ),
        ("test_msgs/msg/UnboundedSequences", {"byte_values": 5}, ".byte_values: expected a list of bytes of length 1"),
        ("test_msgs/msg/UnboundedSequences", {"string_values": "abc"}, ".string_values: expected a list of string"),
        ("test_msgs/msg/BoundedSequences", {"int8_values": [1] * 4}, ".int8_values: expected at most 3 elements"),
    ],
)
def test_wrong_value_is_reported_with_path_on_encode(name: str, values: dict[str, Any], path: str) -> None:
    wrong = rclpy_class(name)(**values)
    with pytest.raises(EncodeError) as caught:
        encode(wrong)
    assert str(caught.value).startswith(name + path)


def test_other_collections_are_encoded_as_lists() -> None:
    cls, basic = rclpy_class("test_msgs/msg/UnboundedSequences"), rclpy_class("test_msgs/msg/BasicTypes")
    names, parts = {"b": 1, "a": 2}, deque([basic(int8_value=1), basic(int8_value=2)])
    made = cls(string_values=names.keys(), basic_types_values=parts, byte_values=deque([b"x"]))
    found = decode(cls, made.encode())
    assert found.string_values == ["b", "a"] and [one.int8_value for one in found.basic_types_values] == [1, 2]
    assert found.byte_values == [b"x"]
    assert decode(cls, cls(string_values=np.array(["q", "r"])).encode()).string_values == ["q", "r"]


def test_numpy_numbers_are_encoded_as_numbers() -> None:
    cls = rclpy_class("test_msgs/msg/BasicTypes")
    made = cls(float32_value=np.float64(1.5), int8_value=np.int64(5), bool_value=np.True_)
    found = decode(cls, made.encode())
    assert (found.float32_value, found.int8_value, found.bool_value) == (1.5, 5, True)


# --- both APIs --------------------------------------------------------------------------------------------------------


def test_message_of_the_other_api_may_be_nested() -> None:
    for outer, inner in ((rclpy_class, get_message), (get_message, rclpy_class)):
        scan, header = outer("sensor_msgs/msg/LaserScan"), inner("std_msgs/msg/Header")
        made = scan(header=header(frame_id="map"))
        assert encode(made) == encode(scan(header=outer("std_msgs/msg/Header")(frame_id="map")))
        assert to_dict(made)["header"]["frame_id"] == "map"
        poses, pose = outer("geometry_msgs/msg/PoseArray"), inner("geometry_msgs/msg/Pose")
        made = poses(poses=[pose()])
        made.poses[0].position.x = 4.0
        assert decode(poses, encode(made)).poses[0].position.x == 4.0
        names, name = outer("sensor_msgs/msg/PointCloud2"), inner("sensor_msgs/msg/PointField")
        assert decode(names, encode(names(fields=[name(name="x")]))).fields[0].name == "x"
        wrong = scan(header=header())
        wrong.header.frame_id = 5
        with pytest.raises(EncodeError, match=r"^sensor_msgs/msg/LaserScan.header.frame_id: expected str, found 5"):
            encode(wrong)
        with pytest.raises(EncodeError, match=r"LaserScan.header: expected std_msgs/msg/Header"):
            encode(scan(header=inner("std_msgs/msg/String")()))


def test_numpy_conversions_accept_and_return_rclpy_style_messages() -> None:
    pixels = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    image = array_to_image(pixels, "rgb8", cls=rclpy_class("sensor_msgs/msg/Image"))
    assert type(image.data) is array.array
    assert image_to_array(decode(type(image), encode(image))).tolist() == pixels.tolist()
    points = np.arange(15, dtype=np.float32).reshape(5, 3)
    cloud = array_to_pointcloud(points, cls=rclpy_class("sensor_msgs/msg/PointCloud2"))
    assert pointcloud_to_array(decode(type(cloud), encode(cloud)))["y"].tolist() == points[:, 1].tolist()
    grid = array_to_occupancygrid(np.ones((2, 3), np.int8), 0.5, cls=rclpy_class("nav_msgs/msg/OccupancyGrid"))
    assert occupancygrid_to_array(decode(type(grid), encode(grid))).tolist() == [[1] * 3] * 2


def test_structured_arrays_may_replace_rclpy_style_messages() -> None:
    point, polygon = rclpy_class("geometry_msgs/msg/Point32"), rclpy_class("geometry_msgs/msg/Polygon")
    points = records([point(x=1.5), get_message("geometry_msgs/msg/Point32")(x=2.5)])
    assert points["x"].tolist() == [1.5, 2.5]
    found = decode(polygon, encode(polygon(points=points)))
    assert [one.x for one in found.points] == [1.5, 2.5] and type(found.points[0]) is point
    assert as_messages(point, points) == found.points
