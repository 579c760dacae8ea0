"""Peers in C on Cyclone DDS 0.10 and in C++ on Fast DDS 2.9, which send each sample back."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from example_interfaces.msg import WString
from example_interfaces.srv import AddTwoInts
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from sensor_msgs.msg import Image
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout, String
from support.waiting import until

from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.runtime import CallTimeoutError, Node, QoSProfile
from rosidl_py_gen.runtime.transport.qos import SENSOR_DATA

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_PIXELS = np.arange(1_048_576, dtype=np.uint32).astype(np.uint8)
MESSAGES: dict[str, list[Any]] = {
    "string": [String(data="hello"), String(data=""), String(data="grüße 😀"), String(data="x" * 70_000)],
    "sensor": [String(data="best effort")],
    "pose": [
        PoseStamped(
            header=Header(stamp=Time(sec=-1, nanosec=999_999_999), frame_id="map"),
            pose=Pose(position=Point(x=1.5, y=-2.0, z=1e300), orientation=Quaternion(x=0.0, y=0.0, z=0.6, w=0.8)),
        )
    ],
    "array": [
        Float64MultiArray(),
        Float64MultiArray(
            layout=MultiArrayLayout(
                dim=[MultiArrayDimension(label="rows", size=2, stride=6), MultiArrayDimension(label="c", size=3)],
                data_offset=7,
            ),
            data=[1.0, -0.5, 1e-300, 4.0, 5.0, 6.0],
        ),
        Float64MultiArray(data=np.arange(131_072, dtype=np.float64)),
    ],
    "wstring": [WString(data="wide ✓"), WString(data=""), WString(data="ハローワールド")],
    "image": [Image(height=1, width=1_048_576, encoding="mono8", step=1_048_576, data=_PIXELS)],
}


async def echo_through(node: Node, kind: str, messages: list[Any]) -> None:
    """Publish each message and expect the same one back."""
    qos = SENSOR_DATA if kind == "sensor" else QoSProfile()
    publisher: Any = node.create_publisher(type(messages[0]), f"/ask_{kind}", qos)
    answers: Any = node.create_subscription(type(messages[0]), f"/answer_{kind}", qos=qos)
    assert await publisher.wait_for_subscribers(timeout_s=10)
    assert await answers.wait_for_publishers(timeout_s=10)
    first, *later = messages
    receiving = asyncio.ensure_future(answers.receive(timeout_s=10))
    while not receiving.done():  # until the peer knows our reader, too
        publisher.publish(first)
        await asyncio.wait([receiving], timeout=0.3)
    assert receiving.result() == first
    for message in later:
        publisher.publish(message)
        while (answer := await answers.receive(timeout_s=10)) == first:
            pass
        assert answer == message
    publisher.close()
    answers.close()


async def connected(client: Any) -> None:
    """Call until there is a response: the server must know our reader, too."""
    assert await client.wait_for_service(timeout_s=10)
    for _ in range(20):
        with suppress(CallTimeoutError):
            await client.call(AddTwoInts.Request(), timeout_s=1)
            return
    pytest.fail("never answered")


@pytest.mark.parametrize("kind", MESSAGES)
async def test_cyclone_dds_peer_echoes_messages(
    dds: Any, cyclone_peer: Path, run_peer: Callable[..., Any], kind: str
) -> None:
    with run_peer(cyclone_peer):
        await echo_through(dds.node("tester"), kind, MESSAGES[kind])


async def test_fast_dds_reader_with_content_filter_receives_selected_messages(
    dds: Any, fastdds_peer: Path, run_peer: Callable[..., Any]
) -> None:
    """Feedback subscriptions of Lyrical have one; a writer without filters sends everything, and the reader filters."""
    context = dds.context()
    with run_peer(fastdds_peer, "echo", str(context.domain_id)):
        node = dds.node("tester", context=context)
        publisher, answers = (
            node.create_publisher(String, "/ask_filtered"),
            node.create_subscription(String, "/answer_filtered"),
        )
        assert await publisher.wait_for_subscribers(10) and await answers.wait_for_publishers(10)
        while answers.take() is None:  # until the peer knows our reader, too
            publisher.publish(String(data="k"))
            await asyncio.sleep(0.1)
        for text in ("out", "kept 1", "out again", "kept 2"):
            publisher.publish(String(data=text))
        texts = ["k"]
        while texts[-1] != "kept 2":
            texts.append((await answers.receive(10)).data)
        assert [text for text in texts if text != "k"] == ["kept 1", "kept 2"]


async def test_client_calls_cyclone_dds_server(dds: Any, cyclone_peer: Path, run_peer: Callable[..., Any]) -> None:
    client = dds.node("tester").create_client(AddTwoInts, "/c_add")
    with run_peer(cyclone_peer):
        await connected(client)
        calls = [client.call(AddTwoInts.Request(a=i, b=-100), timeout_s=10) for i in range(100)]
        assert [response.sum for response in await asyncio.gather(*calls)] == [i - 100 for i in range(100)]


async def test_server_replies_to_cyclone_dds_client(dds: Any, cyclone_peer: Path, run_peer: Callable[..., Any]) -> None:
    def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
        return AddTwoInts.Response(sum=request.a + request.b)

    dds.node("tester").create_service(AddTwoInts, "/py_add", add)
    with run_peer(cyclone_peer, "call", "5") as process:
        lines = [await asyncio.to_thread(process.stdout.readline) for _ in range(5)]
    assert lines == [f"SUM {number + 100}\n" for number in range(1, 6)]


async def test_client_calls_fast_dds_server_of_humble(
    dds: Any, fastdds_service_peer: Path, run_peer: Callable[..., Any]
) -> None:
    context = dds.context()
    with run_peer(fastdds_service_peer, "serve", str(context.domain_id), "fast_add"):
        client = dds.node("tester", context=context).create_client(AddTwoInts, "/fast_add")
        for number in range(20):
            assert (await client.call(AddTwoInts.Request(a=number, b=2), timeout_s=10)).sum == number + 2


async def test_server_replies_to_fast_dds_client_of_humble(
    dds: Any, fastdds_service_peer: Path, run_peer: Callable[..., Any]
) -> None:
    context = dds.context()
    node = dds.node("tester", context=context)
    node.create_service(AddTwoInts, "/our_add", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    numbers = ("1", "2", "-5", "3", str(2**62), "1")
    with run_peer(fastdds_service_peer, "call", str(context.domain_id), "our_add", *numbers) as client:
        sums = (await asyncio.to_thread(client.stdout.read)).split()
    assert sums == ["SUM", "3", "SUM", "-2", "SUM", str(2**62 + 1)]


async def test_killed_peer_disappears_and_may_return(
    dds: Any, cyclone_peer: Path, run_peer: Callable[..., Any]
) -> None:
    client = dds.node("tester").create_client(AddTwoInts, "/c_add")
    for _ in range(2):
        with run_peer(cyclone_peer, lease_s=3):
            await connected(client)
            assert (await client.call(AddTwoInts.Request(a=1, b=2), timeout_s=10)).sum == 3
        await until(lambda: not client.service_is_available(), 60)  # after the lease
