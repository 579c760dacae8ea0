"""``rosidl-py foxglove`` between nodes of the test and viewers with the protocol, and with a page in a browser."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import signal
import socket
import time
from contextlib import asynccontextmanager, closing
from time import monotonic
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import pytest
from support import raw_endpoints
from support.announced_types import humble_node, without_hash
from support.browser import Browser, browser
from support.docs_pictures import update_picture
from support.folders import ROOT
from support.foxglove_viewer import viewer
from support.inner_state import scope_of
from support.waiting import until
from websockets.asyncio.client import connect

from rosidl_py_gen import compile_definition, get_message, get_service
from rosidl_py_gen.foxglove import limits
from rosidl_py_gen.foxglove.protocol import OPERATIONS
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from support.foxglove_viewer import Viewer
    from support.worlds import World

    from rosidl_py_gen.runtime import Node


String: Any = get_message("std_msgs/msg/String")
Image: Any = get_message("sensor_msgs/msg/Image")
Event: Any = get_message("rcl_interfaces/msg/ParameterEvent")
AnyParameter: Any = get_message("rcl_interfaces/msg/Parameter")
Clock: Any = get_message("rosgraph_msgs/msg/Clock")
AddTwoInts: Any = get_service("example_interfaces/srv/AddTwoInts")
Trigger: Any = get_service("std_srvs/srv/Trigger")
ODD = "string name\nother/Inner inner\n" + "=" * 80 + "\nMSG: other/Inner\nint32[] numbers\n"
LATCHED = QoSProfile(depth=1).transient_local()


pytestmark = pytest.mark.real_time("viewers are connected by sockets")


@pytest.fixture
def node(memory: World) -> Node:
    return memory.node("robot")


@pytest.fixture
def serving(tool: Any) -> Callable[..., Any]:
    """Return a context manager that runs the command until Ctrl-C, yields its address, and requires exit code 0."""

    @asynccontextmanager
    async def serve(*options: str) -> AsyncIterator[str]:
        process = await tool.start("foxglove", "--port", "0", "--json", "--spin-time", "0", *options)
        line = await asyncio.wait_for(process.stdout.readline(), 25)
        try:
            yield json.loads(line or "null")["address"]
        finally:
            if process.returncode is None:
                process.send_signal(signal.SIGINT)
            _, errors = await asyncio.wait_for(process.communicate(), 10)
        assert process.returncode == 0 and b"Traceback" not in errors, errors.decode()

    return serve


@pytest.fixture
def watching(serving: Callable[..., Any]) -> Callable[..., Any]:
    """Return a context manager that runs the command and yields a connected viewer."""

    @asynccontextmanager
    async def watch(*options: str) -> AsyncIterator[Viewer]:
        async with serving(*options) as address, viewer(address) as made:
            yield made

    return watch


# ------------------------------------------------------------------------------------------------------------- topics


async def test_topic_is_forwarded_unchanged_only_while_subscribed(network: World, watching: Any) -> None:
    node = network.node("robot")
    words = node.create_publisher(String, "words")
    async with watching() as seen:
        channel = await seen.until(lambda: seen.channels.get("/words"))
        assert (channel["encoding"], channel["schemaName"]) == ("cdr", "std_msgs/msg/String")
        assert channel["schemaEncoding"] == "ros2msg" and "string data" in channel["schema"]
        assert words.subscription_count == 0
        await seen.subscribe("/words", 7)
        assert await words.wait_for_subscribers(20)
        before = time.time_ns()
        words.publish(String(data="hello"))
        await seen.until(lambda: seen.frames)
        subscription, time_ns, data = seen.frames[0]
        assert (subscription, String.decode(data).data) == (7, "hello")
        assert before <= time_ns <= time.time_ns()
        await seen.send("unsubscribe", subscriptionIds=[7])
        await until(lambda: words.subscription_count == 0, 20)


async def test_unknown_type_is_requested_from_its_node(dds: World, watching: Any) -> None:
    odd: Any = compile_definition("other/msg/Odd", ODD)
    dds.node("robot").create_publisher(odd, "odd", LATCHED).publish(odd(name="strange"))
    async with watching() as seen:
        channel = await seen.subscribe("/odd")
        assert (channel["schemaName"], channel["schema"]) == ("other/msg/Odd", ODD)
        await seen.until(lambda: seen.frames)
        assert odd.decode(seen.frames[0][2]).name == "strange"


async def test_channel_of_humble_topic_has_its_definition_and_drops_newer_messages(dds: World, watching: Any) -> None:
    current: Any = get_message("sensor_msgs/msg/Range")
    of_humble: Any = get_message("sensor_msgs/msg/Range", distro="humble")
    humble = humble_node(dds, "robot").create_publisher(without_hash(of_humble), "range")
    async with watching() as seen:
        channel = await seen.subscribe("/range")
        assert "variance" not in channel["schema"]
        assert await humble.wait_for_subscribers(20)
        humble.publish_raw(of_humble(range=1.0).encode())
        await seen.until(lambda: seen.frames)
        later = dds.node("later").create_publisher(current, "range")
        assert await later.wait_for_subscribers(20)
        later.publish(current(range=2.0, variance=3.0))  # dropped, because the channel has one definition
        assert await later.wait_for_acknowledged(20)
        humble.publish_raw(of_humble(range=3.0).encode())
        await seen.until(lambda: len(seen.frames) == 2)
        assert [frame[2] for frame in seen.frames] == [of_humble(range=1.0).encode(), of_humble(range=3.0).encode()]


async def test_idl_definition_is_sent_as_msg_schema(node: Node, watching: Any, tmp_path: Any) -> None:
    package = tmp_path / "share" / "angular"
    (package / "msg").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>angular</name></package>")
    (package / "msg" / "Turn.idl").write_text("module angular { module msg { struct Turn { double by[3]; }; }; };\n")
    node.create_publisher(get_message("angular/msg/Turn", path=str(package)), "turn")
    async with watching("--path", str(package)) as seen:
        channel = await seen.until(lambda: seen.channels.get("/turn"))
        assert channel["schema"] == "float64[3] by\n"


async def test_channels_follow_appearing_and_disappearing_topics(node: Node, memory: World, watching: Any) -> None:
    node.create_publisher(String, "_hidden")
    node.create_subscription(String, "always", print)
    async with watching() as seen:
        await seen.until(lambda: "/always" in seen.channels)  # it can be published
        late = memory.node("late")
        made = late.create_publisher(String, "late")
        await seen.subscribe("/late")
        assert await made.wait_for_subscribers(20)
        late.close()
        await seen.until(lambda: "/late" not in seen.channels)
        again = node.create_publisher(String, "late", LATCHED)
        again.publish(String(data="again"))
        await seen.subscribe("/late", 2)
        await seen.until(lambda: seen.frames)
        assert seen.frames[-1][0] == 2 and "/_hidden" not in seen.channels


async def test_every_viewer_receives_latched_messages(node: Node, serving: Any) -> None:
    node.create_publisher(String, "map", LATCHED).publish(String(data="map"))
    async with serving() as address, viewer(address) as first, viewer(address) as second:
        await first.subscribe("/map")
        await first.until(lambda: first.frames)
        await second.subscribe("/map")
        await second.until(lambda: second.frames)
        assert String.decode(second.frames[0][2]).data == "map"


async def test_best_effort_publisher_is_received_after_reliable_one(node: Node, watching: Any) -> None:
    strong = node.create_publisher(String, "words")
    async with watching() as seen:
        await seen.subscribe("/words")
        assert await strong.wait_for_subscribers(20)
        weak = node.create_publisher(String, "words", QoSProfile().best_effort())
        assert await weak.wait_for_subscribers(20)
        weak.publish(String(data="weak"))
        await seen.until(lambda: seen.frames)


async def test_simulated_time_is_sent_to_viewers(node: Node, watching: Any) -> None:
    clock = node.create_publisher(Clock, "/clock")
    words = node.create_publisher(String, "words")
    message = Clock()
    message.clock.sec = 1234
    async with watching() as seen:
        info = await seen.until(lambda: seen.of("serverInfo"))
        assert "time" in info[0]["capabilities"]
        assert await clock.wait_for_subscribers(20)
        clock.publish(message)
        await seen.until(lambda: seen.of("time"))
        assert seen.of("time")[0]["time"] == 1234 * 10**9
        await seen.subscribe("/words")
        assert await words.wait_for_subscribers(20)
        words.publish(String(data="then"))
        await seen.until(lambda: seen.frames)
        assert seen.frames[0][1] == 1234 * 10**9


# --------------------------------------------------------------------------------------------------------- publishing


async def test_viewers_publish_as_cdr_and_as_json(node: Node, watching: Any) -> None:
    receiver = node.create_subscription(String, "commands")
    async with watching() as seen:
        await seen.until(lambda: "/commands" in seen.channels)
        await seen.offer(1, "/commands", "std_msgs/msg/String")
        await seen.publish(1, String(data="go").encode())
        assert (await receiver.receive(20)).data == "go"
        await seen.offer(2, "/commands", "std_msgs/String", "json")
        await seen.publish(2, b'{"data": "stop"}')
        assert (await receiver.receive(20)).data == "stop"
        await seen.send("unadvertise", channelIds=[1, 2])
        await until(lambda: receiver.publisher_count == 0, 20)


async def test_viewer_publishes_own_type_or_type_announced_by_node(node: Node, watching: Any) -> None:
    receiver = node.create_subscription(compile_definition("viewers/msg/Own", "int8 x\n"), "own")
    async with watching() as seen:
        await seen.offer(1, "/mine", "viewers/msg/Mine", schemaEncoding="ros2msg", schema="int8 x\n")
        await seen.publish(1, b"\0\1\0\0\5")
        await seen.until(lambda: "/own" in seen.channels)
        await seen.offer(2, "/own", "viewers/msg/Own")  # announced by the node
        await seen.publish(2, b"\0\1\0\0\6")
        received: Any = await receiver.receive(20)
        assert received.x == 6
        await seen.offer(3, "/late", "viewers/msg/Late")  # known as soon as a node announces it
        await seen.publish(3, b"\0\1\0\0\7")
        receiver = node.create_subscription(compile_definition("viewers/msg/Late", "int8 x\n"), "late")
        received = await receiver.receive(20)
        assert received.x == 7 and seen.warnings() == ""


CDR, STRING = "cdr", "std_msgs/msg/String"


async def test_unpublishable_messages_are_reported_to_viewer(node: Node, watching: Any) -> None:
    wrong = [
        (STRING, CDR, b"\0\1\0\0\xff\0\0\0a", "std_msgs/msg/String.data: at byte 8"),
        (STRING, CDR, b"", "was not published"),
        (STRING, "json", b'{"dat": "x"}', 'unknown field "dat"; did you mean "data"?'),
        (STRING, "json", b"[" * 100_000, "expected JSON"),
        ("std_msgs/msg/Bool", CDR, b"\0\1\0\0\1", "its type is std_msgs/msg/String; expected std_msgs/msg/Bool"),
        (STRING, "protobuf", b"x", 'its encoding is "protobuf"; expected cdr or json'),
        ("../../etc/passwd", CDR, b"x", "../../etc/passwd"),
    ]
    receiver = [node.create_subscription(String, f"topic{number}") for number in range(len(wrong))]
    async with watching() as seen:
        await seen.until(lambda: len([topic for topic in seen.channels if "/topic" in topic]) == len(wrong))
        for number, (type_name, encoding, data, problem) in enumerate(wrong):
            await seen.offer(number, f"/topic{number}", type_name, encoding)
            await seen.publish(number, data)
            await seen.until(lambda text=problem: text in seen.warnings())
        await seen.offer(100, "/in valid", STRING)
        await seen.until(lambda: "/in valid cannot be published" in seen.warnings())
        await seen.offer(101, "/new", "nobody/msg/Knows")
        await seen.until(lambda: "/new cannot be published" in seen.warnings())
    assert all(one.latest() is None for one in receiver)


# ------------------------------------------------------------------------------------------- services and parameters


async def test_viewer_calls_services(node: Node, watching: Any) -> None:
    service = node.create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    node.create_service(Trigger, "trigger", lambda request: Trigger.Response(message="done"))
    async with watching() as seen:
        assert (
            await seen.call("/add", AddTwoInts.Request(a=40, b=2).encode(), 1) == AddTwoInts.Response(sum=42).encode()
        )
        told = seen.services["/add"]
        assert told["request"]["schema"].endswith("int64 b  # The other summand\n")
        assert told["response"]["schema"].endswith("int64 sum\n")
        for number, empty in enumerate((b"", b"\0\1\0\0", Trigger.Request().encode()), 10):
            assert await seen.call("/trigger", empty, number) == Trigger.Response(message="done").encode()
        wrong = await seen.call("/add", b"\0\1\0\0short", 2)
        assert "AddTwoInts_Request.a: at byte 4: expected 8 bytes of int64, found 5" in wrong
        service.close()
        await seen.until(lambda: "/add" not in seen.services)


async def test_viewer_reads_sets_and_subscribes_to_parameters(node: Node, memory: World, watching: Any) -> None:
    node.declare_parameter("gain", 1.0)
    node.declare_parameter("names", ["a"])
    node.declare_parameter("raw", b"\1\2")
    async with node, watching() as seen:
        known = await known_with(seen, "/robot.gain")
        assert (known["/robot.gain"], known["/robot.names"], known["/robot.raw"]) == (1.0, ["a"], "AQI=")
        assert await seen.parameters(parameterNames=["/robot.gain", "/robot.none"]) == {"/robot.gain": 1.0}
        await seen.send("subscribeParameterUpdates", parameterNames=["/robot.gain"])
        requested = [{"name": "/robot.gain", "value": 3}, {"name": "/robot.names", "value": []}]
        assert await seen.parameters("setParameters", parameters=requested) == {"/robot.gain": 3.0, "/robot.names": []}
        assert (node.get_parameter("gain"), node.get_parameter("names")) == (3.0, ())
        node.set_parameters({"gain": 4.5})

        def told() -> bool:
            values = [one["parameters"] for one in seen.of("parameterValues") if "id" not in one]
            return [{"name": "/robot.gain", "type": "float64", "value": 4.5}] in values

        await seen.until(told)
        refused = [{"name": "/robot.gain", "value": "text"}, {"name": "/nobody.x", "value": 1}]
        assert await seen.parameters("setParameters", parameters=refused) == {"/robot.gain": 4.5}
        await seen.until(lambda: "/robot rejected gain: Wrong parameter type" in seen.warnings())
        await seen.until(lambda: "parameters of /nobody are not set" in seen.warnings())
        memory.node("late").declare_parameter("x", 1)
        await known_with(seen, "/late.x")


async def known_with(seen: Viewer, name: str) -> dict[str, Any]:
    """Wait until the parameters include a name, and return all of them."""
    while name not in (known := await seen.parameters(parameterNames=[])):
        await asyncio.sleep(0.05)
    return known


async def test_read_only_option_refuses_changes_by_viewers(node: Node, watching: Any) -> None:
    node.declare_parameter("gain", 1.0)
    node.create_service(Trigger, "trigger", lambda request: Trigger.Response())
    node.create_publisher(String, "_hidden")
    async with watching("--read-only", "--include-hidden-topics") as seen:
        info = (await seen.until(lambda: seen.of("serverInfo")))[0]
        assert info["capabilities"] == ["parameters", "parametersSubscribe", "connectionGraph"]
        await seen.until(lambda: "/_hidden" in seen.channels)
        await known_with(seen, "/robot.gain")
        requested = [{"name": "/robot.gain", "value": 3.0}]
        assert await seen.parameters("setParameters", parameters=requested) == {"/robot.gain": 1.0}
        await seen.until(lambda: "--read-only" in seen.warnings())
        await seen.offer(1, "/commands", STRING)
        await seen.until(lambda: "does not support clientPublish" in seen.warnings())
        assert seen.services == {} and node.count_publishers("commands") == 0


async def test_connection_graph_is_sent_and_updated(node: Node, memory: World, watching: Any) -> None:
    node.create_publisher(String, "words")
    async with watching() as seen:

        def has(kind: str, **requested: Any) -> bool:
            return any(requested in reply[kind] for reply in seen.of("connectionGraphUpdate"))

        await seen.send("subscribeConnectionGraph")
        await seen.until(lambda: has("publishedTopics", name="/words", publisherIds=["/robot"]))
        await seen.until(lambda: has("advertisedServices", name="/robot/list_parameters", providerIds=["/robot"]))
        other = memory.node("other")
        other.create_subscription(String, "words")
        await seen.until(lambda: has("subscribedTopics", name="/words", subscriberIds=["/other"]))
        for _ in range(5):  # each time it is told the whole
            await seen.send("unsubscribeConnectionGraph")
            await seen.send("subscribeConnectionGraph")
        await seen.handled()
        other.close()
        gone = "/other/list_parameters"
        await seen.until(lambda: any(gone in reply["removedServices"] for reply in seen.of("connectionGraphUpdate")))


# -------------------------------------------------------------------------------------------------------- bad viewers


async def test_invalid_messages_of_one_viewer_do_not_affect_others(node: Node, serving: Any) -> None:
    words = node.create_publisher(String, "words")
    node.create_service(Trigger, "trigger", lambda request: Trigger.Response())
    odd: list[Any] = [None, -1, 1 << 32, 1.5, True, "\ud800", [], {}, [[]], {"id": 1}, {"name": ""}]
    entries = odd + [{"id": 1, "channelId": one} for one in odd] + [{"name": ".", "value": one} for one in odd]
    entries += [{"name": "/robot.use_sim_time", "value": [1, "a"]}]
    entries += [{"name": "/robot.use_sim_time", "type": "byte_array", "value": one} for one in ("!", None, 1)]
    entries += [{"id": 1, "topic": "/words", "encoding": "cdr", "schemaName": "x/msg/Y"}]
    values = [*odd, *([one] for one in entries)]
    texts = ["", "{", "[]", "null", '{"op": 1}', '{"op": "nothing"}', "[" * 100_000, "\0"]
    texts += [json.dumps({"op": op, key: value}) for op, (key, _) in OPERATIONS.items() for value in values]
    async with serving("--max-rate", "1000000") as address, viewer(address) as good:
        await good.subscribe("/words")
        async with viewer(address) as bad:
            for text in texts:
                await bad.connection.send(text)
            assert "Invalid message" in await bad.handled()
        assert await words.wait_for_subscribers(20)
        words.publish(String(data="still here"))
        await good.until(lambda: good.frames)


async def test_topics_with_invalid_names_are_reported_once_and_others_work(
    node: Node, memory: World, watching: Any
) -> None:
    for topic in ("rt/2d_scan", "rt/a//b", "rt/"):
        raw_endpoints.announce(node, topic, "std_msgs::msg::dds_::String_", "x")
    raw_endpoints.announce(node, "rt/plain", "Plain", "x")
    for service in ("2d", "a//b", "odd//node/list_parameters", "list_parameters"):
        raw_endpoints.announce(node, f"rr/{service}Reply", "std_srvs::srv::dds_::Trigger_Response_", "x")
    scope_of(node).discovery.add_node("odd", "/2d//space")
    node.create_service(Trigger, "trigger", lambda request: Trigger.Response())
    node.declare_parameter("gain", 1.0)
    words = node.create_publisher(String, "words")
    async with node, watching() as seen:
        requested = ["/2d_scan", "/a//b", "/plain", "/words"]
        for number, topic in enumerate(requested):
            await seen.subscribe(topic, number)
        assert await words.wait_for_subscribers(20)
        for topic in requested[:3]:
            await seen.until(lambda topic=topic: f"{topic} cannot be read: " in seen.warnings())
        memory.node("later")  # a change, after which they are not told again
        await known_with(seen, "/later.use_sim_time")
        assert all(seen.warnings().count(f"{topic} cannot be read: ") == 1 for topic in requested[:3])
        await seen.until(lambda: "/trigger" in seen.services)
        assert not {"/2d", "/a//b"} & {*seen.services}
        assert (await known_with(seen, "/robot.gain"))["/robot.gain"] == 1.0
        await seen.send("subscribeConnectionGraph")
        graph = (await seen.until(lambda: seen.of("connectionGraphUpdate")))[0]
        nodes = {one for reply in graph["publishedTopics"] for one in reply["publisherIds"]}
        assert "/robot" in nodes and not any("space" in one for one in nodes)


async def test_parameter_events_of_unknown_nodes_are_ignored(node: Node, watching: Any) -> None:
    node.declare_parameter("gain", 1.0)
    async with node, watching() as seen:
        await known_with(seen, "/robot.gain")
        events = node.create_publisher(Event, "/parameter_events")
        assert await events.wait_for_subscribers(20)
        for name in ("/nobody", "/robot"):
            event = Event(node=name, new_parameters=[AnyParameter(name="x")])
            event.new_parameters[0].value.type, event.new_parameters[0].value.integer_value = 2, 1
            events.publish(event)
        assert "/nobody.x" not in await known_with(seen, "/robot.x")


@pytest.mark.parametrize(
    ("limit", "most", "reply"),
    [
        ("MAX_SCHEMAS", 2, "too many definitions: 3 (21 bytes); expected at most 2 ("),
        ("MAX_SCHEMAS_BYTES", 15, "too many definitions: 3 (21 bytes); expected at most 256 (15 bytes)"),
    ],
)
async def test_number_and_size_of_viewer_definitions_are_limited(
    node: Node, watching: Any, monkeypatch: pytest.MonkeyPatch, limit: str, most: int, reply: str
) -> None:
    monkeypatch.setattr(limits, limit, most)
    async with watching() as seen:

        async def refusal(number: int, name: str, schema: str) -> str:
            topic = f"/many{number}"
            await seen.offer(number, topic, f"viewers/msg/{name}", schemaEncoding="ros2msg", schema=schema)
            await until(lambda: node.count_publishers(topic) > 0 or topic in seen.warnings())
            return "".join(text for text in seen.warnings().splitlines() if topic in text)

        assert await refusal(0, "Wrong", "no field\n")
        assert [await refusal(number, f"Many{number}", "int8 x\n") for number in (1, 2)] == ["", ""]
        assert await refusal(3, "Many2", "int8 x\n") == ""  # it is counted once
        assert reply in await refusal(4, "Many4", "int8 x\n")


async def test_queue_of_messages_with_unknown_type_is_limited_across_topics(node: Node, watching: Any) -> None:
    async with watching() as seen:
        for number in range(4):
            await seen.offer(number, f"/q{number}", "nobody/msg/Knows")
            await seen.publish(number, bytes(400_000))
        reply = await seen.handled()
    assert [f"messages for /q{number} are dropped" in reply for number in range(4)] == [False, False, True, True]


def _small(address: str) -> socket.socket:
    """A connection on which little can wait; the kernel would keep more than the test sends."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
    made.connect(("127.0.0.1", int(address.rsplit(":", 1)[1])))
    return made


async def test_slow_viewer_loses_oldest_messages_without_affecting_others(
    node: Node, memory: World, serving: Any
) -> None:
    count = 60
    images = node.create_publisher(Image, "images", QoSProfile(depth=count))
    other = memory.node("other").create_subscription(Image, "images", qos=QoSProfile(depth=count))
    protocols: Any = ["foxglove.sdk.v1"]
    async with (
        serving("--queue", "16") as address,
        connect(address, subprotocols=protocols, sock=_small(address), max_size=None, max_queue=1) as slow,
        viewer(address) as looking,
    ):
        channel = await looking.subscribe("/images")
        await slow.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel["id"]}]}))
        await slow.send(json.dumps({"op": "fetchAsset", "uri": "", "requestId": 0}))  # refused, but in its turn
        while "assets" not in str(await asyncio.wait_for(slow.recv(), 20)):
            pass
        assert await images.wait_for_subscribers(20, count=2)
        for number in range(count):
            images.publish(Image(height=number, data=bytes(1 << 20)))
            assert (await other.receive(20)).height == number
        await looking.until(lambda: looking.frames and Image.decode(looking.frames[-1][2]).height == count - 1)
        received = []  # only now, when the server has passed on every message
        while not received or received[-1] != count - 1:
            frame = await asyncio.wait_for(slow.recv(), 20)
            if isinstance(frame, bytes):
                received.append(Image.decode(frame[13:]).height)
        assert received == sorted(received) and len(received) < count


# -------------------------------------------------------------------------------------------------- beginning and end


async def test_server_stops_immediately_during_a_pending_call(node: Node, tool: Any) -> None:
    never = asyncio.Event()

    async def wait(request: Any) -> Any:
        await never.wait()

    node.create_service(Trigger, "trigger", wait)
    process = await tool.start("foxglove", "--port", "0", "--json")
    address = json.loads(await asyncio.wait_for(process.stdout.readline(), 25))["address"]
    async with viewer(address) as seen:
        calling = asyncio.ensure_future(seen.call("/trigger", b""))
        await until(lambda: node.count_clients("trigger") > 0, 20)
        process.send_signal(signal.SIGINT)
        _, errors = await asyncio.wait_for(process.communicate(), 9)  # the call has 10 s
        assert (process.returncode, errors) == (0, b"")
        calling.cancel()


async def test_unusable_listen_address_is_reported(memory: World, tool: Any) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        ended = await tool("foxglove", "--port", str(port))
    assert (ended.code, ended.out) == (1, "")
    assert f"cannot listen on 127.0.0.1:{port}: " in ended.err and "pass another --port" in ended.err
    ended = await tool("foxglove", "--host", "no.such.host.invalid")
    assert ended.code == 1 and "cannot listen on no.such.host.invalid:8765" in ended.err


async def test_server_listens_on_ipv6_and_prints_address(node: Node, tool: Any) -> None:
    process = await tool.start("foxglove", "--port", "0", "--host", "::1")
    address, _, rest = (await asyncio.wait_for(process.stdout.readline(), 25)).decode().partition(" ")
    assert (address[:11], rest) == ("ws://[::1]:", "for Foxglove and Lichtblick; Ctrl-C ends the server\n")
    assert b"ds=foxglove-websocket" in await process.stdout.readline()
    async with viewer(address) as seen:
        await seen.until(lambda: seen.of("serverInfo"))
    assert (await tool.interrupt(process, signal.SIGTERM)).code == 0


__all__ = ["browser"]

Pressure: Any = get_message("std_msgs/msg/Float64")
Battery: Any = get_message("sensor_msgs/msg/BatteryState")
PAGE = ROOT / "examples" / "live_view.html"


async def test_live_view_example_page_plots_fields(memory: World, serving: Any, browser: Browser) -> None:
    node = memory.node("robot")
    wave, batteries = node.create_publisher(Pressure, "wave"), node.create_publisher(Battery, "battery")
    began, frames = monotonic(), itertools.cycle(["", "left", "right one"])

    def publish() -> None:
        wave.publish(Pressure(data=math.sin(3 * (monotonic() - began))))
        battery = Battery(voltage=12.5, percentage=0.75)
        battery.header.frame_id = next(frames)
        batteries.publish(battery)

    async with serving("--allow-origin", "null") as address:
        timer = node.create_timer(0.02, publish)

        def look(topic: str, field: str, condition: str) -> None:
            browser.open(f"{PAGE.as_uri()}?{urlencode({'topic': topic, 'field': field, 'address': address})}")
            browser.wait_for(condition)

        def look_at_wave() -> None:
            look("/wave", "data", "return values.length > 250")
            assert browser.run("return document.querySelector('#type').textContent") == "std_msgs/msg/Float64"
            low, high = browser.run("return [Math.min(...values), Math.max(...values)]")
            assert -1 <= low < high <= 1
            assert browser.run("return plot.points.length") > 50
            picture = browser.screenshot()
            assert picture.startswith(b"\x89PNG")
            update_picture("live_view.png", picture)

        for field, condition in (
            ("voltage", "return values.length > 5 && values.every(one => one === 12.5)"),
            ("percentage", "return values.length > 5 && values.every(one => one === 0.75)"),
            ("location", "return state.textContent.startsWith('no number location')"),
        ):
            await asyncio.to_thread(look, "/battery", field, condition)
        await asyncio.to_thread(look_at_wave)
        timer.close()
    await asyncio.to_thread(browser.wait_for, "return state.textContent === 'the server is gone'")
