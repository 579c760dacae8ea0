"""Names, hashes and descriptions of all types, and one class for each type."""

from __future__ import annotations

import hashlib
import importlib
import json
import subprocess
import sys
import threading
from typing import Any

import pytest
from each_case import each_case
from hypothesis import given, settings
from support.bundled_interfaces import INTERFACES, TESTS
from support.definition_strategies import World, worlds
from support.example_counts import examples

from rosidl_py_gen import (
    InvalidNameError,
    TypeNotFoundError,
    compile_definition,
    decode,
    encode,
    from_dict,
    get_action,
    get_message,
    get_service,
    to_dict,
    type_description,
    type_hash,
    type_name,
)
from rosidl_py_gen.cdr.type_queries import constants

HASHES: dict[str, str] = json.loads((TESTS / "vectors" / "type_hashes.json").read_text(encoding="utf-8"))
DERIVED = ("_Request", "_Response", "_Event", "_Goal", "_Result", "_Feedback", "_FeedbackMessage")
GROUPS = ("_SendGoal", "_GetResult")


def subject(name: str) -> Any:
    """Return the class of any type in the list of hashes."""
    kind = name.split("/")[1]
    if kind == "msg" or name.endswith(DERIVED):
        return get_message(name, path=[INTERFACES])
    if name.endswith(GROUPS):
        stem, _, part = name.rpartition("_")
        return getattr(get_action(stem, path=[INTERFACES]), part)
    return (get_service if kind == "srv" else get_action)(name, path=[INTERFACES])


def independent_hash(description: dict[str, Any]) -> str:
    """Return RIHS01 of a description without default values (docs/internals/protocol.md 3.1)."""
    plain = json.loads(json.dumps(description))
    for one in [plain["type_description"], *plain["referenced_type_descriptions"]]:
        for field in one["fields"]:
            del field["default_value"]
    return "RIHS01_" + hashlib.sha256(json.dumps(plain).encode()).hexdigest()


@each_case("name", sorted(HASHES))
def test_hash_name_and_description_of_every_type_match_the_recorded_ones(name: str) -> None:
    cls = subject(name)
    assert type_name(cls) == name
    assert type_hash(cls) == HASHES[name]
    description = type_description(cls)
    assert independent_hash(description) == HASHES[name]
    assert description["type_description"]["type_name"] == name
    referenced = [one["type_name"] for one in description["referenced_type_descriptions"]]
    assert referenced == sorted(set(referenced) - {name})
    if (isinstance(cls, type) and name.endswith((*DERIVED,))) or "/msg/" in name:
        assert (type_name(cls()), type_hash(cls())) == (name, HASHES[name])
        assert type_description(cls()) == description


def test_type_descriptions_round_trip_as_messages() -> None:
    """A description is a type_description_interfaces/msg/TypeDescription in dict form."""
    cls = get_message("type_description_interfaces/msg/TypeDescription")
    for name in ("sensor_msgs/msg/PointCloud2", "example_interfaces/action/Fibonacci", "std_srvs/srv/Trigger"):
        description = type_description(subject(name))
        assert to_dict(decode(cls, encode(from_dict(cls, description)))) == description


def test_known_wrong_type_description_of_rosidl_is_reproduced() -> None:
    cls = compile_definition("spelled/msg/Wide", "wstring<=5[] a\nstring<=5[] b\nstring<=3[<=4] c\nwstring<=3[2] d\n")
    found = [tuple(field["type"].values()) for field in type_description(cls)["type_description"]["fields"]]
    assert found == [(118, 5, 5, ""), (165, 0, 5, ""), (117, 4, 3, ""), (70, 2, 3, "")]


@settings(max_examples=examples(100))
@given(worlds())
def test_hash_of_a_random_type_matches_its_description(world: World) -> None:
    cls = world.compile()
    assert independent_hash(type_description(cls)) == type_hash(cls)
    assert type_name(cls) == world.top


@pytest.mark.parametrize("thing", [None, 5, "std_msgs/msg/String", int, object()])
def test_type_queries_refuse_objects_that_are_not_generated_types(thing: object) -> None:
    for query in (type_name, type_hash, type_description):
        with pytest.raises(TypeNotFoundError, match="expected a generated message, service or action"):
            query(thing)


# --- one class per type -----------------------------------------------------------------------------------------------


def test_every_lookup_of_a_type_returns_the_same_class() -> None:
    time = get_message("builtin_interfaces/msg/Time")
    assert importlib.import_module("rosidl_py_gen.msgs.builtin_interfaces.msg").Time is time
    assert get_message("builtin_interfaces/Time") is time
    assert get_message("builtin_interfaces/msg/Time", path=[INTERFACES]) is time
    assert compile_definition("builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec\n") is time
    header = get_message("std_msgs/msg/Header")
    assert type(header().stamp) is time
    text = (
        "builtin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    assert compile_definition("std_msgs/msg/Header", text) is header
    assert compile_definition("std_msgs/Header", text) is header
    assert compile_definition("std_msgs/msg/Header", "builtin_interfaces/Time stamp\nstring frame_id\n") is header
    stamped = get_message("geometry_msgs/msg/PoseStamped")
    assert type(stamped().header) is header
    assert type(get_message("nav_msgs/msg/Path")().header) is header
    outer = compile_definition("one_class/msg/Outer", "std_msgs/Header header\n")
    assert type(outer().header) is header


def test_different_definitions_of_a_type_name_are_different_classes() -> None:
    header = get_message("std_msgs/msg/Header")
    ros1 = compile_definition("std_msgs/msg/Header", "uint32 seq\nbuiltin_interfaces/Time stamp\nstring frame_id\n")
    assert ros1 is not header
    assert type_hash(ros1) != type_hash(header)
    assert get_message("std_msgs/msg/Header") is header
    assert (
        compile_definition("std_msgs/msg/Header", "uint32 seq\nbuiltin_interfaces/Time stamp\nstring frame_id\n")
        is ros1
    )


def test_messages_of_services_and_actions_are_attributes_of_their_classes() -> None:
    service = get_service("example_interfaces/srv/AddTwoInts")
    assert get_message("example_interfaces/srv/AddTwoInts_Request") is service.Request
    assert get_message("example_interfaces/srv/AddTwoInts_Response") is service.Response
    assert get_message("example_interfaces/srv/AddTwoInts_Event") is service.Event
    action = get_action("example_interfaces/action/Fibonacci")
    assert get_message("example_interfaces/action/Fibonacci_Goal") is action.Goal
    assert get_message("example_interfaces/action/Fibonacci_FeedbackMessage") is action.FeedbackMessage
    assert get_message("example_interfaces/action/Fibonacci_SendGoal_Request") is action.SendGoal.Request
    assert get_message("example_interfaces/action/Fibonacci_GetResult_Response") is action.GetResult.Response
    assert type(action.SendGoal.Request().goal) is action.Goal
    assert type(action.FeedbackMessage().feedback) is action.Feedback
    info = get_message("service_msgs/msg/ServiceEventInfo")
    assert type(service.Event().info) is info
    assert encode(service.Event(request=[service.Request(1, 2)]))
    with pytest.raises(ValueError, match="expected at most 1 elements, found 2"):
        encode(service.Event(request=[service.Request()] * 2))


def test_concurrent_compilation_in_threads_returns_one_class() -> None:
    text = "uint8 a\nstd_msgs/Header header\nThreaded2 inner\n" + "=" * 80 + "\nMSG: one_class/Threaded2\nuint8 b\n"
    found: list[object] = []
    threads = [
        threading.Thread(target=lambda: found.append(compile_definition("one_class/msg/Threaded", text)))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert len(set(map(id, found))) == 1


def test_lookup_of_a_wrong_kind_or_name_is_a_clear_error() -> None:
    with pytest.raises(
        TypeNotFoundError, match=r"no interface std_msgs/msg/Strin.*did you mean \"std_msgs/msg/String\""
    ):
        get_message("std_msgs/msg/Strin")
    with pytest.raises(TypeNotFoundError, match=r'no package "std_msg" .*did you mean "std_msgs"'):
        get_message("std_msg/msg/String")
    with pytest.raises(TypeNotFoundError, match="is a service, not a message"):
        get_message("std_srvs/srv/SetBool")
    with pytest.raises(TypeNotFoundError, match="is a message, not a service"):
        get_service("std_msgs/msg/String")
    paths = ("../msg/X", "std_msgs/msg/../X", "Std/msg/X", "std_msgs/msg/x", "a\0/msg/B")
    for name in ("", "x", "std_msgs", "a/b/c/d", *paths):
        for query in (get_message, get_service, get_action):
            with pytest.raises(InvalidNameError):
                query(name)
        with pytest.raises(InvalidNameError):
            compile_definition(name, "uint8 x\n")


@pytest.mark.slow
def test_a_foreign_package_of_the_same_name_is_not_imported(tmp_path: Any) -> None:
    folder = tmp_path / "std_msgs"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise SystemExit('imported')\n")
    code = "from rosidl_py_gen import get_message; print(get_message('std_msgs/msg/String')(data='x').encode().hex())"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=TESTS.parent,
        env={"PYTHONPATH": f"{tmp_path}:{TESTS.parent}"},
    )  # fmt: skip
    assert done.stdout.strip() == "00010000020000007800", done.stderr


def test_field_whose_type_is_named_class_var_is_not_a_constant() -> None:
    """If the field were a constant, a second class of the type would be made, and the first would refuse its values."""
    cls = compile_definition(
        "b_msgs/msg/Outer",
        f"Inner inner\n{'=' * 80}\nMSG: b_msgs/Inner\nClassVar a\nint8 N=1\n{'=' * 80}\nMSG: b_msgs/ClassVar\n",
    )
    inner = type(cls().inner)
    assert constants(inner) == {"N": 1}
    assert decode(cls, encode(cls(inner=inner()))) == cls()
