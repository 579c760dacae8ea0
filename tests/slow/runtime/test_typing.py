"""Types that a type checker infers: message classes instead of Any."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.folders import ROOT
from support.generated_packages import GENERATED

PROGRAM = """
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from example_interfaces.srv import AddTwoInts
from geometry_msgs.msg import Point, Point32, Polygon
from std_msgs.msg import String
from typing_extensions import assert_type

from rosidl_py_gen import decode, dtype, messages, records
from rosidl_py_gen.bags import BagMessage, BagReader
from rosidl_py_gen.runtime import (
    SENSOR_DATA,
    Client,
    Node,
    Publisher,
    QoSProfile,
    Range,
    ServiceServer,
    Subscription,
)


@dataclass
class Drive:
    max_speed: Annotated[float, Range(0.0, 2.5)] = 0.8


def more(node: Node) -> None:
    assert_type(node.declare_parameters(Drive), Drive)
    assert_type(node.declare_parameter("x", 1.0), float)
    assert_type(node.declare_parameter("x", 1), int)
    assert_type(node.declare_parameter("x", True), bool)
    assert_type(node.declare_parameter("x", ["a", "b"]), tuple[str, ...])
    assert_type(SENSOR_DATA, QoSProfile)
    node.get_logger().info("typed")
    assert_type(node.destroy_publisher(node.create_publisher(String, "a")), bool)
    assert_type(node.get_parameter("x", int), int | None)
    assert_type(node.get_parameter("x", str, "none"), str)


async def main(node: Node) -> None:
    assert_type(node.create_publisher(String, "a"), Publisher[String])
    subscription = node.create_subscription(String, "a")
    assert_type(subscription, Subscription[String])
    assert_type(await subscription.receive(), String)
    assert_type((await subscription.receive_with_info())[0], String)
    assert_type(subscription.latest(), String | None)
    async for message in subscription:
        assert_type(message, String)
    assert_type(node.create_subscription(String, "a", raw=True), Subscription[bytes])
    assert_type(node.create_subscription("std_msgs/msg/String", "a"), Subscription[dict[str, Any]])
    assert_type(node.create_subscription(String, "a", arrays=True), Subscription[String])
    assert_type(
        node.create_client(AddTwoInts, "b", arrays=True), Client[AddTwoInts.Request, AddTwoInts.Response]
    )
    node.create_subscription(String, "a", lambda message: print(message.data.upper()))
    client = node.create_client(AddTwoInts, "b")
    assert_type(client, Client[AddTwoInts.Request, AddTwoInts.Response])
    assert_type(await client.call(AddTwoInts.Request(a=1), timeout_s=1), AddTwoInts.Response)
    assert_type(client.call_sync(AddTwoInts.Request(a=1)).sum, int)
    server = node.create_service(AddTwoInts, "b", lambda request: AddTwoInts.Response(sum=request.a))
    assert_type(server, ServiceServer[AddTwoInts.Request, AddTwoInts.Response])


def arrays(polygon: Polygon) -> None:
    assert_type(dtype(Point32), np.dtype[np.void])
    found = records(polygon.points)
    assert_type(found, np.ndarray[tuple[Any, ...], np.dtype[np.void]])
    assert_type(messages(Point32, found), list[Point32])
    assert_type(messages(Point32, polygon.points), list[Point32])
    assert_type(polygon.points[0].x, float)
    assert_type(Polygon(points=found[found["x"] > 0]), Polygon)
    assert_type(Polygon(points=[Point32()]), Polygon)
    assert_type(Polygon.decode(polygon.encode(), arrays=True), Polygon)
    assert_type(decode(Polygon, b"", arrays=True, copy=True), Polygon)


def bags(reader: BagReader, item: BagMessage) -> None:
    for typed in reader.messages("/a", String, start_ns=1):
        assert_type(typed, BagMessage[String])
        assert_type(typed.message, String)
        topic, message, log_time, _ = typed
        assert_type(message, String)
    for serialized in reader.messages(raw=True):
        assert_type(serialized.message, bytes)
    for decoded in reader.messages(["/a", "/b"], arrays=True):
        assert_type(decoded.message, Any)
    assert_type(item.log_time, int)
"""
WRONG = """

def wrong(node: Node) -> None:
    node.create_publisher(String, "a").publish(AddTwoInts.Request())
    Polygon(points=[Point()])


def wrong_bag(reader: BagReader) -> None:
    for item in reader.messages("/a", Polygon):
        print(item.message.data)
"""


@pytest.mark.needs("mypy")
def test_strict_mypy_infers_message_types_and_reports_wrong_types(tmp_path: Path) -> None:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM + WRONG)
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--follow-imports=silent", str(path)]
    environment = {**os.environ, "MYPYPATH": f"{GENERATED.name}{os.pathsep}{ROOT}"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert [line.split()[-1] for line in errors] == ["[arg-type]", "[list-item]", "[attr-defined]"], done.stdout
