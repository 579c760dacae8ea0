"""Descriptions of types without file, failures, and the bytes of a response: docs/internals/protocol.md 3, 5.1, 9.8."""

from __future__ import annotations

import asyncio
import logging
import re
import sys
from typing import Any

import pytest
from support import raw_endpoints
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import compile_definition, get_message, type_description, type_hash, type_name
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.message import TypeInfo, opaque_message_class
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log, ParameterEvent
from rosidl_py_gen.msgs.rcl_interfaces.srv import GetParameters, SetLoggerLevels
from rosidl_py_gen.msgs.rosgraph_msgs.msg import Clock
from rosidl_py_gen.runtime import CallTimeoutError, type_descriptions
from rosidl_py_gen.runtime.type_descriptions import TypeDescriptionError

pytestmark = pytest.mark.on_zenoh

Foo: Any = compile_definition("my_pkg/msg/Foo", "int32 x")
Ask: Any = compile_definition("my_pkg/srv/Ask", "string question\n---\nint8 answer")
Walk: Any = compile_definition("my_pkg/action/Walk", "float32 metres\n---\nfloat32 walked\n---\nfloat32 left")
OddString: Any = compile_definition("std_msgs/msg/String", "int32 not_a_string")
NOT_IN_USE = "Type not currently in use by this node"


async def names_and_encodings(asker: Any, cls: Any) -> list[tuple[str, str, str]]:
    got = await asker.get_type_description("/n", "", type_hash(cls), timeout_s=20)
    assert got.successful
    return [(source.type_name, source.encoding, source.raw_file_contents) for source in got.type_sources]


@pytest.mark.every_transport
async def test_type_compiled_from_text_is_described(world: World) -> None:
    node, asker = world.node("n"), world.node("asker")
    node.create_publisher(Foo, "foo")
    node.create_subscription(get_message("std_msgs/msg/Bool"), "after", lambda message: None)
    got = await asker.get_type_description("/n", "my_pkg/msg/Foo", type_hash(Foo), timeout_s=20)
    (field,) = got.type_description.type_description.fields
    assert (field.name, field.type.type_id) == ("x", 6)
    assert await names_and_encodings(asker, Foo) == [("my_pkg/msg/Foo", "msg", "")]
    ((_, encoding, text),) = await names_and_encodings(asker, get_message("std_msgs/msg/Bool"))
    assert encoding == "msg" and "bool data" in text
    with pytest.raises(TypeDescriptionError, match=NOT_IN_USE):
        await asker.get_type_description("/n", "", "RIHS01_" + "0" * 64, timeout_s=5)


async def test_type_description_includes_referenced_types(world: World) -> None:
    pose = get_message("geometry_msgs/msg/PoseStamped")
    world.node("n").create_publisher(pose, "pose")
    got = await world.node("asker").get_type_description("/n", "x/msg/Ignored", type_hash(pose), timeout_s=5)
    names = [item["type_name"] for item in type_description(pose)["referenced_type_descriptions"]]
    assert [item.type_name for item in got.type_description.referenced_type_descriptions] == names
    assert [source.type_name for source in got.type_sources] == ["geometry_msgs/msg/PoseStamped", *sorted(names)]
    assert all(source.encoding == "msg" and source.raw_file_contents for source in got.type_sources)


async def test_services_and_actions_compiled_from_text_are_described(world: World) -> None:
    node, asker = world.node("n"), world.node("asker")
    node.create_client(Ask, "ask")
    node.create_action_server(Walk, "walk", lambda goal: None)
    for cls in (Ask, Ask.Request, Walk, Walk.SendGoal, Walk.GetResult, Walk.FeedbackMessage):
        sources = await names_and_encodings(asker, cls)
        assert sources[0][0] == type_name(cls)
    sources = await names_and_encodings(asker, Walk)
    implicit = {name for name, encoding, _ in sources if encoding == "implicit"}
    assert {"my_pkg/action/Walk_Goal", "my_pkg/action/Walk_SendGoal"} <= implicit
    with pytest.raises(TypeDescriptionError, match=NOT_IN_USE):
        await asker.get_type_description("/n", "", type_hash(Walk.Goal), timeout_s=5)


@pytest.mark.every_transport
async def test_types_of_built_in_entities_are_described(world: World) -> None:
    world.node("n", args="--ros-args -p use_sim_time:=true", logger_services=True)
    asker = world.node("asker")
    for cls in (Log, ParameterEvent, Clock, GetParameters, GetParameters.Response):
        assert (await names_and_encodings(asker, cls))[0][0] == type_name(cls)
    encodings = {name: encoding for name, encoding, _ in await names_and_encodings(asker, SetLoggerLevels)}
    assert encodings["rcl_interfaces/srv/SetLoggerLevels"] == "srv"
    assert encodings["rcl_interfaces/srv/SetLoggerLevels_Request"] == "implicit"


async def test_types_of_equal_name_are_distinguished_by_hash(world: World) -> None:
    node, asker, string = world.node("n"), world.node("asker"), get_message("std_msgs/msg/String")
    world.node("neighbour").create_publisher(string, "elsewhere")
    node.create_publisher(OddString, "odd")
    # The bundled file of that name defines another type, so its text is not returned.
    assert await names_and_encodings(asker, OddString) == [("std_msgs/msg/String", "msg", "")]
    with pytest.raises(TypeDescriptionError, match=NOT_IN_USE):
        await asker.get_type_description("/n", "", type_hash(string), timeout_s=5)


def fields_of(got: Any) -> list[tuple[str, int]]:
    return [(field.name, field.type.type_id) for field in got.type_description.type_description.fields]


@pytest.mark.every_transport
@pytest.mark.without_zenoh("there services announce their own hash, not those of their messages")
async def test_missing_hash_is_taken_from_announcements_of_the_node(world: World) -> None:
    node, asker, string = world.node("n", "/ns"), world.node("asker", "/ns"), get_message("std_msgs/msg/String")
    asker.create_publisher(string, "elsewhere")  # types of the same name on other nodes must be ignored
    world.node("neighbour", "/ns").create_publisher(string, "elsewhere")
    node.create_subscription(OddString, "odd", lambda message: None)
    got = await asker.get_type_description("n", "std_msgs/msg/String", timeout_s=20)
    assert fields_of(got) == [("not_a_string", 6)]
    node.create_client(Ask, "ask")
    got = await asker.get_type_description("/ns/n", "my_pkg/srv/Ask_Request", include_type_sources=False)
    assert (fields_of(got), got.type_sources) == ([("question", 17)], [])
    node.create_action_server(Walk, "walk", lambda goal: None)
    got = await asker.get_type_description("/ns/n", "my_pkg/action/Walk_FeedbackMessage", None, timeout_s=20)
    assert [name for name, _ in fields_of(got)] == ["goal_id", "feedback"]


async def test_class_without_fields_is_not_described(world: World) -> None:
    class Opaque(Message):
        """Type of subscriptions that never decode."""

        __slots__ = ()
        _TYPE = TypeInfo("my_pkg/msg/Closed", "RIHS01_" + "7" * 64, ())

    world.node("n").create_subscription(Opaque, "closed", raw=True)
    with pytest.raises(TypeDescriptionError, match=NOT_IN_USE):
        await world.node("asker").get_type_description("/n", "my_pkg/msg/Closed", timeout_s=5)


async def test_opaque_class_in_same_process_does_not_hide_described_type(world: World) -> None:
    world.node("n").create_publisher(Foo, "foo")
    asker = world.node("asker")
    recorded = {cls: opaque_message_class(type_name(cls), type_hash(cls)) for cls in (Log, Foo)}
    for cls, opaque in recorded.items():
        asker.create_subscription(opaque, f"recorded/{cls.__name__}", raw=True)
        assert (await names_and_encodings(asker, cls))[0][0] == type_name(cls)


async def test_node_name_of_type_description_request_is_not_remapped(world: World) -> None:
    world.node("n", "/ns").create_publisher(Foo, "foo")
    asker = world.node("asker", "/ns", args="--ros-args -r rostopic:///ns/n:=/elsewhere")
    await until(lambda: asker.count_publishers("foo") == 1)
    assert fields_of(await asker.get_type_description("n", "my_pkg/msg/Foo", timeout_s=5)) == [("x", 6)]
    with pytest.raises(InvalidNameError, match="invalid namespace"):
        await asker.get_type_description("~/n", "my_pkg/msg/Foo", timeout_s=5)


@pytest.mark.every_transport
async def test_get_type_description_waits_for_a_node_created_later(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type_descriptions, "ENDPOINTS_TIMEOUT_S", 10.0)  # the endpoint is announced after the node
    asker = world.node("asker")
    asking = asyncio.ensure_future(asker.get_type_description("/n", "my_pkg/msg/Foo", timeout_s=10))
    await asyncio.sleep(0)  # the request is waiting now
    world.node("n").create_publisher(Foo, "foo")
    assert fields_of(await asking) == [("x", 6)]
    with pytest.raises(CallTimeoutError, match=r"no node /nobody appeared in 0\.1 s"):
        await asker.get_type_description("/nobody", "my_pkg/msg/Foo", timeout_s=0.1)


@pytest.mark.every_transport
async def test_several_announced_hashes_raise_error_that_lists_them(world: World) -> None:
    node, string = world.node("n"), get_message("std_msgs/msg/String")
    node.create_publisher(string, "plain")
    announce_writer(node, "std_msgs::msg::dds_::String_", "odd", type_hash(OddString))
    asker = world.node("asker")
    await until(lambda: asker.count_publishers("odd") == asker.count_publishers("plain") == 1)
    listed = sorted([f"{type_hash(string)} (/plain)", f"{type_hash(OddString)} (/odd)"])
    words = f"/n announces 2 type hashes for std_msgs/msg/String: {', '.join(listed)}; pass type_hash"
    await until(lambda: len(asker.get_publisher_names_and_types_by_node("n")) == 4)
    with pytest.raises(TypeDescriptionError, match=f"^{re.escape(words)}$"):
        await asker.get_type_description("/n", "std_msgs/msg/String", timeout_s=5)
    got = await asker.get_type_description("/n", "std_msgs/msg/String", type_hash(string), timeout_s=20)
    assert fields_of(got) == [("data", 17)]


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ("my_pkg/msg/Bar", "/n announces no endpoint of my_pkg/msg/Bar"),
        ("my_pkg/srv/Ask", "/n announces no endpoint of my_pkg/srv/Ask; a service is announced as its messages: .*_Re"),
        ("my_pkg/action/Walk", "/n announces no endpoint of my_pkg/action/Walk; an action is .* _SendGoal_Request"),
        ("my_pkg/msg/Old", r"/n announces no type hash for my_pkg/msg/Old \(/old\), as nodes of ROS 2 Humble do; pass"),
        ("my_pkg/msg/Bad", r"/n announces no type hash for my_pkg/msg/Bad \(/bad\)"),
    ],
)
async def test_missing_announced_hash_raises_error_with_advice(world: World, wanted: str, words: str) -> None:
    if world.kind in ("memory", "zenoh") and wanted == "my_pkg/srv/Ask":
        pytest.skip("there a service announces its own hash")
    node = world.node("n")
    node.create_client(Ask, "ask")
    announce_writer(node, "my_pkg::msg::dds_::Old_", "old", "")
    announce_writer(node, "my_pkg::msg::dds_::Bad_", "bad", "RIHS01_nonsense")
    asker = world.node("asker")
    await until(lambda: len(asker.get_publisher_names_and_types_by_node("n")) == 4)
    with pytest.raises(TypeDescriptionError, match=f"^{words}"):
        await asker.get_type_description("/n", wanted, timeout_s=5)


async def test_invalid_type_name_without_hash_is_refused(world: World) -> None:
    world.node("n")
    with pytest.raises(InvalidNameError, match='"String" is not an interface name'):
        await world.node("asker").get_type_description("/n", "String", timeout_s=5)


def announce_writer(node: Any, dds_type: str, topic: str, announced: str) -> None:
    """Create a writer of the node that announces any hash, or none."""
    raw_endpoints.announce(node, f"rt/{topic}", dds_type, announced)


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        ("type_description", "Failed to populate TypeDescription to response."),
        ("type_source", "Failed to populate TypeSource_Sequence to response."),
    ],
)
async def test_type_description_failure_is_replied_and_logged(
    world: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, broken: str, reason: str
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("disk on fire")

    world.node("n").create_publisher(Foo, "foo")
    monkeypatch.setattr(type_descriptions, broken, fail)
    with caplog.at_level(logging.ERROR), pytest.raises(TypeDescriptionError, match=reason):
        await world.node("asker").get_type_description("/n", "", type_hash(Foo), timeout_s=5)
    assert "disk on fire" in caplog.text


async def test_description_that_cannot_be_encoded_is_replied_as_failure(world: World) -> None:
    long = f"my_pkg/Long{'g' * 250}"  # type_name and nested_type_name are string<=255
    outer: Any = compile_definition("my_pkg/msg/Outer", f"{long} inner\n{'=' * 80}\nMSG: {long}\nint32 x")
    world.node("n").create_publisher(outer, "outer")
    with pytest.raises(TypeDescriptionError, match="Failed to populate TypeDescription to response"):
        await world.node("asker").get_type_description("/n", "", type_hash(outer), timeout_s=5)


async def test_first_type_description_request_does_not_import_the_compiler(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.node("n").create_publisher(Foo, "foo")
    asker = world.node("asker")
    for name in ("rosidl_py_gen.type_loading", "rosidl_py_gen.type_loading.class_lookup"):
        monkeypatch.setitem(sys.modules, name, None)  # importing it fails from here on
    for cls in (Foo, Log, GetParameters):
        await asker.get_type_description("/n", "", type_hash(cls), timeout_s=5)


async def test_type_description_response_bytes_match_ros(dds: World) -> None:
    kind = "type_description_interfaces::srv::dds_::GetTypeDescription_Response_"
    replies = raw_endpoints.reader(dds.node("watcher"), "rr/n/get_type_descriptionReply", kind)
    dds.node("n").create_publisher(Foo, "foo")
    asker = dds.node("asker")
    await asker.get_type_description("/n", "my_pkg/msg/Foo", type_hash(Foo), timeout_s=20)
    await until(lambda: len(replies.queue.items) == 1)
    with pytest.raises(TypeDescriptionError):
        await asker.get_type_description("/n", "my_pkg/msg/Foo", "RIHS01_", timeout_s=5)
    await until(lambda: len(replies.queue.items) == 2)
    name = "0f 00 00 00  6d 79 5f 70 6b 67 2f 6d 73 67 2f 46 6f 6f 00"  # "my_pkg/msg/Foo" and its NUL
    empty = "01 00 00 00  00"
    success = (
        "00 01 00 00",  # CDR, little endian
        "01  00 00 00",  # successful; pad to 4
        empty + "00 00 00",  # failure_reason; pad to 12
        name + "00",  # type_description.type_description.type_name ends at 31; pad to 32
        "01 00 00 00",  # one field
        "02 00 00 00  78 00",  # name "x" ends at 42
        "06  00 00 00 00 00",  # type_id int32; pad to 48
        "00" * 16,  # capacity, string_capacity
        empty + "00 00 00",  # nested_type_name ends at 69; pad to 72
        empty + "00 00 00",  # default_value ends at 77; pad to 80
        "00 00 00 00",  # no referenced types
        "01 00 00 00",  # one source
        name + "00",  # type_name ends at 107; pad to 108
        "04 00 00 00  6d 73 67 00",  # encoding "msg"
        empty + "00 00 00",  # raw_file_contents: no file defines it; ends at 121; pad to 124
        "00 00 00 00",  # no extra_information
    )
    reason = b"Failed to parse type hash\0"  # 26 bytes
    failure = (
        "00 01 00 00",
        "00  00 00 00",
        "1a 00 00 00" + reason.hex() + "00 00",  # ends at 34; pad to 36
        empty + "00 00 00",  # type_name ends at 41; pad to 44
        "00 00 00 00" * 4,  # no fields, references, sources, extra information
    )
    for expected, item in zip((success, failure), replies.queue.items, strict=True):
        reply = bytes(item[0])
        assert (reply[:4] + reply[20:]).hex() == "".join(expected).replace(" ", "")
