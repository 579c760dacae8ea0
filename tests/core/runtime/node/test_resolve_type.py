"""Resolution of types that are not installed: requests to nodes, refused descriptions, cache."""

from __future__ import annotations

import asyncio
import itertools
import re
from typing import TYPE_CHECKING, Any

import pytest
from support.announced_types import SERVICE_OFF, Told, fresh, humble_node, teller, told_by, without_hash
from support.inner_state import graph_of, type_fields
from support.raw_endpoints import reply_name, request_name, topic_name
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import compile_definition, get_message, get_service, type_description, type_hash, type_name
from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response
from rosidl_py_gen.runtime import CallTimeoutError, TypeDescriptionError, TypeNotFoundError, type_descriptions
from rosidl_py_gen.type_loading import class_lookup, from_description

if TYPE_CHECKING:
    from pathlib import Path

_numbers = itertools.count()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(folder))
    return folder


@pytest.mark.every_transport
async def test_type_known_only_to_another_node_is_resolved_to_a_class(world: World) -> None:
    told = fresh()
    told_by(world, told)
    cls: Any = await world.node("asker").resolve_type("t", timeout_s=10)
    assert (type_name(cls), type_hash(cls), cls.LABEL, cls().x) == (told.name, told.hash, "deep", 5)
    assert cls.decode(b"\0\1\0\0\7\0\0\0").x == 7
    assert compile_definition(told.name, told.text) is cls


async def test_type_is_resolved_from_description_without_source(world: World) -> None:
    told = fresh(
        'int32 x 5\nstring<=9 word "a\'b"\nfloat64[2] pair [1.5, -2.0]\nstring[<=3] words ["p", "q"]\nbool on true'
    )
    told_by(world, told, answer=lambda request: told.answer(sources=False))
    cls: Any = await world.node("asker").resolve_type("t", timeout_s=10)
    made = cls()
    assert (made.x, made.word, list(made.pair), made.words, made.on) == (5, "a'b", [1.5, -2.0], ["p", "q"], True)
    assert type_description(cls) == told.library.type_description(told.name)


async def test_source_that_contradicts_its_description_is_ignored(world: World) -> None:
    told, other = fresh(), "int64 x 5\nstring LABEL=other"
    answer = told.answer()
    answer.type_sources[0].raw_file_contents = other
    told_by(world, told, answer=lambda request: answer)
    cls: Any = await world.node("asker").resolve_type("t", timeout_s=10)
    assert type_hash(cls) == told.hash and not hasattr(cls, "LABEL") and cls().x == 5


async def test_local_class_with_announced_hash_is_used_without_request(world: World) -> None:
    string = get_message("std_msgs/msg/String")
    told = Told("std_msgs/msg/String", "string data")
    told_by(world, told, answer=lambda request: pytest.fail("asked"))
    assert await world.node("asker").resolve_type("t", timeout_s=10) is string


async def test_local_class_with_another_hash_stays_unchanged(world: World) -> None:
    string = get_message("std_msgs/msg/String")
    told = Told("std_msgs/msg/String", f"int32 not_a_string_{next(_numbers)}")
    told_by(world, told)
    cls = await world.node("asker").resolve_type("t", timeout_s=10)
    assert cls is not string and type_hash(cls) == told.hash
    assert get_message("std_msgs/msg/String") is string


async def test_nested_types_with_equal_hash_are_local_classes(world: World) -> None:
    point = f"int32 other_{next(_numbers)}"
    told = fresh("std_msgs/Header header\ngeometry_msgs/Point32 point", **{"geometry_msgs/msg/Point32": point})
    told_by(world, told)
    cls: Any = await world.node("asker").resolve_type("t", timeout_s=10)
    header, nested = (field.cls for field in type_fields(cls))
    assert header is get_message("std_msgs/msg/Header")
    assert nested is not get_message("geometry_msgs/msg/Point32") and [f.ros_name for f in type_fields(nested)] == [
        point.split()[1]
    ]


@pytest.mark.every_transport
async def test_description_with_wrong_hash_is_refused_with_node_and_both_hashes(world: World) -> None:
    told, lie = fresh(), fresh("int32 y")
    answer = lie.answer()
    answer.type_description.type_description.type_name = told.name
    told_by(world, told, answer=lambda request: answer)
    with pytest.raises(TypeDescriptionError, match="the description is refused") as caught:
        await world.node("asker").resolve_type("t", timeout_s=10)
    assert "/robot" in str(caught.value) and told.hash in str(caught.value)
    assert len(set(re.findall(r"RIHS01_[0-9a-f]{64}", str(caught.value)))) == 2


async def test_type_announced_only_by_a_node_with_own_name_is_not_requested(world: World) -> None:
    told = fresh()
    told_by(world, told, answer=lambda request: pytest.fail("asked"))
    with pytest.raises(
        TypeDescriptionError, match=f"{told.name} {told.hash} is announced, but only by nodes with the name of this one"
    ) as caught:
        await world.node("robot", parameter_overrides=SERVICE_OFF).resolve_type("t", timeout_s=10)
    assert ", /robot, which cannot ask itself; rename one of them" in str(caught.value)


async def test_resolve_type_waits_for_late_node_names_of_announcers(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = fresh()
    robot, asker = told_by(world, told), world.node("asker", parameter_overrides=SERVICE_OFF)
    told.announce(asker, topic_name("/t"))
    await until(lambda: asker.count_publishers("t") == 2)
    node_of, late = type_descriptions.node_name_of, ["/robot"]

    def known(graph: Any, endpoint: Any) -> str:
        name = node_of(graph, endpoint)
        return "" if name in late else name

    def announce_name() -> None:
        late.clear()
        told.announce(robot, topic_name("/other"))

    monkeypatch.setattr(type_descriptions, "node_name_of", known)
    asyncio.get_running_loop().call_later(0.5, announce_name)
    assert type_hash(await asker.resolve_type("t", timeout_s=10)) == told.hash
    assert not late


async def test_valid_description_is_accepted_despite_a_lying_and_a_silent_node(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    timeout_name = "rosidl_py_gen.runtime.type_resolver.ANSWER_TIMEOUT_S"
    monkeypatch.setattr(timeout_name, 0.5)
    told, lie = fresh(), fresh("int32 y")

    async def never(request: Any) -> Any:
        monkeypatch.setattr(timeout_name, 10.0)  # for the honest node, which is queried next
        await asyncio.sleep(60)

    for name, answer in (("a_liar", lambda request: lie.answer()), ("b_silent", never), ("c_honest", told)):
        told.announce(teller(world, name, answer), "rt/t")
    asker = world.node("asker")
    await until(lambda: asker.count_publishers("t") == 3)
    assert type_hash(await asker.resolve_type("t", timeout_s=20)) == told.hash


async def test_description_request_is_repeated_after_a_lost_reply(world: World) -> None:
    told, asked = fresh(), list[Any]()

    async def second_time(request: Any) -> Any:
        asked.append(request)
        if len(asked) == 1:
            await asyncio.sleep(60)
        return told.answer()

    told_by(world, told, answer=second_time)
    assert type_hash(await world.node("asker").resolve_type("t", timeout_s=20)) == told.hash
    assert len(asked) == 2


async def test_silent_node_raises_error_within_the_timeout(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.type_resolver.ANSWER_TIMEOUT_S", 30.0)

    async def never(request: Any) -> Any:
        await asyncio.sleep(60)

    told = fresh()
    told_by(world, told, answer=never)
    asker = world.node("asker")
    await until(lambda: [info.node_name for info in asker.get_publishers_info_by_topic("t")] == ["robot"])
    start = asyncio.get_running_loop().time()
    with pytest.raises(TypeDescriptionError, match="/robot/get_type_description"):
        await asker.resolve_type("t", timeout_s=0.8)
    assert asyncio.get_running_loop().time() - start < 15


async def test_node_without_description_service_raises_error_with_fix(world: World) -> None:
    told = fresh()
    told.announce(teller(world, "robot", None), "rt/t")
    with pytest.raises(TypeDescriptionError, match=r"/robot/get_type_description.*install its package"):
        await world.node("asker").resolve_type("t", timeout_s=10)


async def test_error_mentions_local_definition_with_another_hash(world: World) -> None:
    robot, service = teller(world, "robot", None), Told("std_srvs/srv/SetBool", "bool other\n---\nbool done")
    service.announce(robot, request_name("/s"), "_Request")
    service.announce(robot, reply_name("/s"), "_Response")
    here = type_hash(get_service("std_srvs/srv/SetBool"))
    with pytest.raises(TypeDescriptionError, match=f"describe a service only by.*another hash, {here}$"):
        await world.node("asker").resolve_service_type("s", timeout_s=2)


async def test_service_parts_of_two_definitions_are_not_combined(world: World) -> None:
    one = fresh("int32 a\n---\nint32 b", "srv")
    two = Told(one.name, "int32 a\n---\nint64 c")
    first, second = teller(world, "first", one), teller(world, "second", None)
    one.announce(first, request_name("/s"), "_Request")
    one.announce(first, reply_name("/s"), "_Response")
    asker = world.node("asker")
    two.announce(second, topic_name("/s/_service_event"), "_Event")
    await until(lambda: asker.count_publishers("/s/_service_event") == 1)
    with pytest.raises(TypeDescriptionError, match="several definitions"):
        await asker.resolve_service_type("s", timeout_s=5)


@pytest.mark.parametrize("distro", ["jazzy", "humble"])
async def test_type_without_hash_uses_local_definition_with_warning_unless_humble_is_selected(
    world: World, distro: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("ROS_DISTRO", distro)
    robot = teller(world, "robot", None)
    Told("std_msgs/msg/Bool", "bool data").announce(robot, "rt/known", announced="")
    fresh().announce(robot, "rt/unknown", announced="")
    asker = world.node("asker")
    assert await asker.resolve_type("known", timeout_s=5) is get_message("std_msgs/msg/Bool")
    warning = "announce no hash for std_msgs/msg/Bool, as nodes of ROS 2 Humble do"
    assert any(warning in one.message for one in caplog.records if one.levelname == "WARNING") is (distro == "jazzy")
    with pytest.raises(TypeNotFoundError, match=r"there is no local definition; install its package.*--path"):
        await asker.resolve_type("unknown", timeout_s=5)


@pytest.mark.every_transport
@pytest.mark.without_zenoh
@pytest.mark.parametrize("is_publisher", [True, False])
async def test_type_of_humble_node_is_resolved_to_its_humble_definition(
    world: World, is_publisher: bool, caplog: pytest.LogCaptureFixture
) -> None:
    of_humble: Any = get_message("sensor_msgs/msg/Range", distro="humble")
    robot = humble_node(world, "robot")
    (robot.create_publisher if is_publisher else robot.create_subscription)(without_hash(of_humble), "range")
    assert await world.node("asker").resolve_type("range", timeout_s=10) is of_humble
    assert "using the definition of Humble, which differs from the local one" in caplog.text


async def test_generated_class_uses_nested_humble_definitions_for_humble_node(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    sonar: Any = compile_definition(f"sonar_msgs/msg/Generated{next(_numbers)}", "sensor_msgs/Range[] all")
    monkeypatch.setattr(class_lookup.ClassSearch, "get", lambda _, name: sonar)
    monkeypatch.setattr(from_description, "find_installed_class", lambda name: sonar)
    teller(memory, "robot", None).create_publisher(without_hash(sonar), "t")
    cls = await memory.node("asker").resolve_type("t", timeout_s=10)
    assert type_fields(cls)[0].cls is get_message("sensor_msgs/msg/Range", distro="humble")


async def test_type_of_program_without_ros_is_resolved_to_local_definition(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, asker = memory.pair()
    robot.create_publisher(without_hash(get_message("sensor_msgs/msg/Range")), "range")
    monkeypatch.setattr(graph_of(asker), "is_ros", lambda guid: False)
    assert await asker.resolve_type("range", timeout_s=10) is get_message("sensor_msgs/msg/Range")


async def test_previously_loaded_definition_of_another_distribution_is_not_used_as_local(memory: World) -> None:
    get_message("lifecycle_msgs/msg/TransitionEvent", distro="lyrical")
    robot, asker = memory.pair()
    event = get_message("lifecycle_msgs/msg/TransitionEvent")
    robot.create_publisher(without_hash(event), "events")
    assert await asker.resolve_type("events", timeout_s=10) is event


@pytest.mark.every_transport
async def test_several_types_on_a_topic_raise_error_that_lists_them_with_nodes(world: World) -> None:
    one, two = fresh(), fresh("int32 y")
    told_by(world, one)
    two.announce(teller(world, "second", two), "rt/t")
    asker = world.node("asker")
    await until(lambda: asker.count_publishers("t") == 2)
    await until(lambda: {"robot", "second"} <= {info.node_name for info in asker.get_publishers_info_by_topic("t")})
    with pytest.raises(TypeDescriptionError, match="several types") as caught:
        await asker.resolve_type("t", timeout_s=5)
    for told, node in ((one, "/robot"), (two, "/second")):
        assert f"{told.name} {told.hash} ({node})" in str(caught.value)
    assert type_hash(await asker.resolve_type("t", two.name, timeout_s=20)) == two.hash


async def test_type_hash_selects_one_of_several_definitions(world: World) -> None:
    one = fresh()
    two = Told(one.name, "int32 y")
    told_by(world, one)
    two.announce(teller(world, "second", two), "rt/t")
    asker = world.node("asker")
    await until(lambda: asker.count_publishers("t") == 2)
    with pytest.raises(TypeDescriptionError, match=r"several definitions.*type_hash"):
        await asker.resolve_type("t", timeout_s=5)
    for told in (one, two):
        assert type_hash(await asker.resolve_type("t", type_hash=told.hash, timeout_s=5)) == told.hash


async def test_definition_of_publishers_takes_precedence_over_subscriptions(world: World) -> None:
    one = fresh()
    told_by(world, one)
    asker = world.node("asker")
    cls = compile_definition(one.name, "int32 y")
    asker.create_subscription(cls, "t")
    world.node("other").create_subscription(cls, "t")
    await until(lambda: (asker.count_publishers("t"), asker.count_subscribers("t")) == (1, 2))
    assert type_hash(await asker.resolve_type("t", timeout_s=5)) == one.hash


async def test_resolve_type_waits_for_an_announcement_or_times_out(world: World) -> None:
    asker = world.node("asker")
    with pytest.raises(CallTimeoutError, match=r"no node announced a type for the topic /t in 0\.2 s"):
        await asker.resolve_type("t", timeout_s=0.2)
    told = fresh()
    asking = asyncio.ensure_future(asker.resolve_type("t", timeout_s=10))
    await asyncio.sleep(0.1)
    told_by(world, told)
    assert type_hash(await asking) == told.hash


@pytest.mark.every_transport
async def test_service_type_is_resolved_from_a_node_of_this_package(world: World) -> None:
    told = fresh("int32 a 3\nstring MORE=x\n---\nstring b", "srv")
    robot = teller(world, "robot", told)
    told.announce(robot, request_name("/s"), "_Request")
    told.announce(robot, reply_name("/s"), "_Response")
    cls: Any = await world.node("asker").resolve_service_type("s", timeout_s=10)
    assert type_hash(cls) == told.hash and cls.Request().a == 3 and cls.Request.MORE == "x"


@pytest.mark.every_transport
async def test_resolve_service_type_waits_for_late_event_announcement(world: World) -> None:
    told = fresh("int32 a 3\n---\nstring b", "srv")
    refused: list[str] = []

    def as_rclpy(request: Any) -> Any:
        """Return the answer of rclpy, which describes the published types, but not requests and responses."""
        if request.type_name.endswith("_Event"):
            return told(request)
        if not refused:
            asyncio.get_running_loop().call_later(0.2, told.announce, robot, "rt/s/_service_event", "_Event")
        refused.append(request.type_name)
        return GetTypeDescription_Response(failure_reason="Type not currently in use by this node")

    robot = teller(world, "robot", as_rclpy)
    told.announce(robot, request_name("/s"), "_Request")
    told.announce(robot, reply_name("/s"), "_Response")
    cls: Any = await world.node("asker").resolve_service_type("s", timeout_s=10)
    assert type_hash(cls) == told.hash and refused[0].endswith("_Request")


@pytest.mark.every_transport
async def test_action_type_is_resolved_from_a_node_of_this_package(world: World) -> None:
    told = fresh("int32 order\n---\nint32[] result\n---\nfloat32 left", "action")
    robot = teller(world, "robot", told)
    for verb, word in (("send_goal", "SendGoal"), ("get_result", "GetResult")):
        told.announce(robot, request_name(f"/a/_action/{verb}"), f"_{word}_Request")
        told.announce(robot, reply_name(f"/a/_action/{verb}"), f"_{word}_Response")
    told.announce(robot, "rt/a/_action/feedback", "_FeedbackMessage")
    cls: Any = await world.node("asker").resolve_action_type("a", timeout_s=10)
    assert type_hash(cls) == told.hash and cls.Goal(order=3).order == 3


async def test_local_service_class_is_used_if_request_and_response_hashes_match(world: World) -> None:
    node, asker = world.node("robot"), world.node("asker")
    ask = get_service("std_srvs/srv/SetBool")
    node.create_service(ask, "s", lambda request: None)
    assert await asker.resolve_service_type("s", timeout_s=5) is ask


async def test_cached_description_is_used_without_request(world: World, cache: Path) -> None:
    told = fresh()
    cache.mkdir()
    data = told.answer().encode()
    (cache / f"{told.hash}.cdr").write_bytes(data)
    told_by(world, told, answer=lambda request: pytest.fail("asked"))
    assert type_hash(await world.node("asker").resolve_type("t", timeout_s=5)) == told.hash


@pytest.mark.parametrize("what", ["cut", "noise", "other"])
async def test_damaged_cache_file_is_ignored_and_replaced(
    world: World, cache: Path, what: str, caplog: pytest.LogCaptureFixture
) -> None:
    told = fresh()
    good = told.answer().encode()
    bad = {"cut": good[:40], "noise": b"\xff" * 100, "other": fresh("int32 z").answer().encode()}[what]
    cache.mkdir()
    file = cache / f"{told.hash}.cdr"
    file.write_bytes(bad)
    told_by(world, told)
    assert type_hash(await world.node("asker").resolve_type("t", timeout_s=5)) == told.hash
    assert "requesting it again" in caplog.text and file.read_bytes() == good


async def test_unusable_cache_folder_is_ignored(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "file" / "below"))
    told = fresh()
    told_by(world, told)
    assert type_hash(await world.node("asker").resolve_type("t", timeout_s=5)) == told.hash
