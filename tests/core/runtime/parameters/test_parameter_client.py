"""Client of remote parameters, and names and values of wrong types."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from support.worlds import World

from rosidl_py_gen.runtime import CallTimeoutError, SetResult
from rosidl_py_gen.runtime.parameters import store
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterNameError,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    parameter_value,
)

pytestmark = pytest.mark.on_zenoh

T = ParameterType
OK = SetResult(True)


@dataclass
class Motor:
    pwm: int = 10


@dataclass
class Lists:
    flags: list[bool] = field(default_factory=lambda: [True])
    numbers: list[int] = field(default_factory=lambda: [1])
    reals: list[float] = field(default_factory=lambda: [1.0])
    tags: list[str] = field(default_factory=lambda: ["a"])
    unset: list[str] | None = None
    blob: bytes = b"x"
    left: Motor = field(default_factory=Motor)


EMPTY = {"flags": [], "numbers": [], "reals": [], "tags": [], "unset": [], "blob": b""}


@pytest.mark.every_transport
async def test_empty_lists_are_set_with_type_of_the_remote_parameter(world: World) -> None:
    node = world.node("n")
    lists = node.declare_parameters(Lists)
    remote = world.node("other").create_parameter_client("/n")
    assert await remote.set(EMPTY, timeout_s=20) == [OK] * 6
    assert lists == Lists([], [], [], [], [], b"")
    lists.tags = ["b"]
    assert await remote.set_atomically({"tags": [], "numbers": [2]}, timeout_s=20) == OK
    assert (lists.tags, lists.numbers) == ([], [2])
    assert await remote.set([Parameter("tags", parameter_value([]))], 20) == [OK]
    undeclared = SetResult(False, "Invalid access to undeclared parameter(s): ['nope']")
    assert await remote.set({"nope": [], "tags": []}, 20) == [undeclared, OK]
    refused = "Wrong parameter type, expected 'Type.INTEGER' got 'Type.BYTE_ARRAY'"
    assert await remote.set({"left.pwm": []}, 5) == [SetResult(False, refused)]


async def test_setting_several_empty_lists_uses_one_timeout(world: World) -> None:
    remote = world.node("other").create_parameter_client("/gone")
    start = asyncio.get_running_loop().time()
    with pytest.raises(CallTimeoutError):
        await remote.set({"a": [], "b": [], "c": []}, timeout_s=0.1)
    assert asyncio.get_running_loop().time() - start < 10


async def test_dumped_yaml_with_empty_lists_can_be_loaded(
    world: World, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("yaml") / "p.yaml"
    node = world.node("n")
    lists = node.declare_parameters(Lists, initial=Lists([], [], [], [], [], b""))
    remote = world.node("other").create_parameter_client("/n")
    await asyncio.to_thread(path.write_text, await remote.dump_yaml(timeout_s=5), encoding="utf-8")
    lists.flags, lists.numbers, lists.reals, lists.tags, lists.blob = [True], [1], [1.0], ["a"], b"x"
    results = await remote.load_yaml(path, timeout_s=5)
    assert results.pop("start_type_description_service") == SetResult(True, "it is read-only and has this value")
    assert set(results.values()) == {OK} and lists == Lists([], [], [], [], [], b"")


async def test_all_yaml_documents_are_loaded_and_empty_map_deletes_no_parameter(memory: World, tmp_path: Path) -> None:
    node, path = memory.node("n", allow_undeclared_parameters=True), tmp_path / "p.yaml"
    node.set_parameters({"a": 1, "b": 1, "c": 1})
    path.write_text("/:\n  n: {ros__parameters: {a: 2}}\n---\nn: {ros__parameters: {b: 3, c: {}}}\n", encoding="utf-8")
    remote = memory.node("other").create_parameter_client("/n")
    assert set((await remote.load_yaml(path, timeout_s=5)).values()) == {OK}
    assert node.get_parameters(["a", "b", "c"]) == [2, 3, 1]


READ_ONLY = {"real": math.nan, "tags": (), "whole": 2.0}


@pytest.mark.parametrize(
    ("line", "successful", "reason"),
    [
        ("real: .nan", True, "it is read-only and has this value"),
        ("tags: []", True, "it is read-only and has this value"),
        ("whole: 2", True, "it is read-only and has this value"),
        ("whole: 3.0", False, "it is read-only with 2.0; the file has 3.0"),
        ("whole: true", False, "it is read-only with 2.0; the file has True"),
        ("nope: 1", False, "Invalid access to undeclared parameter(s): ['nope']"),
    ],
)
async def test_file_may_repeat_but_not_change_read_only_values(
    memory: World, tmp_path: Path, line: str, successful: bool, reason: str
) -> None:
    node, path = memory.node("n"), tmp_path / "p.yaml"
    for name, value in READ_ONLY.items():
        kind = ParameterType.STRING_ARRAY if name == "tags" else ParameterType.DOUBLE
        node.declare_parameter(name, value, ParameterDescriptor(read_only=True, type=kind))
    path.write_text(f"/n:\n  ros__parameters: {{{line}}}\n", encoding="utf-8")
    results = await memory.node("other").create_parameter_client("/n").load_yaml(path, timeout_s=5)
    assert list(results.values()) == [SetResult(successful, reason)]


async def test_integers_are_sent_as_doubles_to_nodes_that_refuse_integers(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "widened", lambda value, kind: value)  # as rclcpp and rclpy do
    node = memory.node("n")
    node.declare_parameters(Lists)
    node.declare_parameter("speed", 1.5)
    assert not node.set_parameters({"speed": 2})[0].successful
    remote = memory.node("other").create_parameter_client("/n")
    results = await remote.set({"speed": 2, "numbers": [3], "reals": [4, 5], "left.pwm": 6, "tags": [1]}, timeout_s=5)
    assert [one.successful for one in results] == [True] * 4 + [False]
    assert repr(node.get_parameters(["speed", "numbers", "reals", "left.pwm"])) == "[2.0, (3,), (4.0, 5.0), 6]"
    assert await remote.set_atomically({"speed": 3, "numbers": [4]}, timeout_s=5) == OK
    assert (await remote.set_atomically({"speed": 2**53 + 1}, timeout_s=5)).successful is False
    assert repr(node.get_parameters(["speed", "numbers"])) == "[3.0, (4,)]"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "/other:\n  ros__parameters: {a: 1}\n/ns/*:\n  ros__parameters: {a: 2}\n",
            "has parameters of /other, /ns/\\*",
        ),
        ("", "has parameters of no node"),
    ],
)
async def test_file_without_parameters_for_the_node_raises_error(
    world: World, tmp_path: Path, text: str, reason: str
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    world.node("n")
    remote = world.node("other").create_parameter_client("/n")
    with pytest.raises(ParameterFileError, match=f"no parameters for /n; the file {reason}"):
        await remote.load_yaml(path, timeout_s=5)


async def test_file_with_empty_section_for_the_node_is_accepted(world: World, tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/n:\n  ros__parameters: {}\n", encoding="utf-8")
    world.node("n")
    assert await world.node("other").create_parameter_client("/n").load_yaml(path, timeout_s=5) == {}


# ------------------------------------------------------------------------------------------------------------ names


async def test_single_name_returns_single_result(world: World) -> None:
    node = world.node("n")
    node.declare_parameters(Lists)
    remote = world.node("other").create_parameter_client("/n")
    assert await remote.get("left.pwm", 5) == 10 and await remote.get(["left.pwm"], 5) == [10]
    assert await remote.get_types("tags", 5) is T.STRING_ARRAY and await remote.get_types(("tags",), 5) == [
        T.STRING_ARRAY
    ]
    assert (await remote.describe("tags", 5)).name == "tags"
    assert [item.name for item in await remote.describe(["tags", "blob"], 5)] == ["tags", "blob"]
    assert (await remote.list("left", timeout_s=5)).names == ("left.pwm",)
    assert (await remote.list(["left"], timeout_s=5)).names == ("left.pwm",)
    values = await remote.get_all(timeout_s=5)
    assert (values["left.pwm"], values["reals"], "unset" in values) == (10, (1.0,), False)
    for method in (remote.get, remote.get_types, remote.describe):
        with pytest.raises(ParameterNotDeclaredError, match=r"\['nope'\]"):
            await method("nope", 5)
    assert node.list_parameters("left") == node.list_parameters(["left"])
    assert node.list_parameters("left").names == ("left.pwm",)


async def test_remote_parameter_names_must_be_strings(world: World) -> None:
    world.node("n")
    remote: Any = world.node("other").create_parameter_client("/n")
    for method in (remote.get, remote.get_types, remote.describe):
        with pytest.raises(TypeError, match="the name of a parameter must be a str, got 5 of type int"):
            await method([5], 5)
        with pytest.raises(TypeError, match="must be a list of str, got 5"):
            await method(5, 5)
    with pytest.raises(TypeError, match="prefixes must be a list of str, got 5"):
        await remote.list(5, timeout_s=5)
    with pytest.raises(TypeError, match="the name of a parameter must be a str, got 5"):
        await remote.set({5: 1}, 5)
    with pytest.raises(TypeError, match="expected a dict of names and values"):
        await remote.set("a", 5)


BAD_CALLS: list[tuple[Callable[[Any], object], type[Exception], str]] = [
    (lambda n: n.get_parameters("tags"), TypeError, "must be a list of str, got 'tags'"),
    (lambda n: n.get_parameters([5]), TypeError, "parameter must be a str, got 5"),
    (lambda n: n.get_parameter(5), TypeError, "parameter must be a str, got 5"),
    (lambda n: n.get_parameter(["a"]), TypeError, r"parameter must be a str, got \['a'\]"),
    (lambda n: n.get_parameter("tags", ["x"]), TypeError, "is not a parameter type"),
    (lambda n: n.has_parameter(["a"]), TypeError, "parameter must be a str"),
    (lambda n: n.describe_parameter(5), TypeError, "parameter must be a str, got 5"),
    (lambda n: n.undeclare_parameter([]), TypeError, "parameter must be a str"),
    (lambda n: n.list_parameters(5), TypeError, "prefixes must be a list of str, got 5"),
    (lambda n: n.set_parameters(5), TypeError, "expected a dict of names and values"),
    (
        lambda n: n.declare_parameter(["a"], 1),
        InvalidParameterNameError,
        r"must be a str that is not empty, got \['a'\]",
    ),
    (lambda n: n.declare_parameter(5, 1), InvalidParameterNameError, "must be a str that is not empty, got 5"),
    (lambda n: n.declare_parameter("x", object()), InvalidParameterValueError, "not a parameter value"),
    (lambda n: n.declare_parameter("x", 1, "text"), TypeError, "'x': the descriptor must be a ParameterDescriptor"),
    (lambda n: n.create_parameter_client(5), TypeError, "the name of a node must be a str, got 5"),
    (lambda n: n.parameter_events(5), TypeError, "the name of a node must be a str, got 5"),
]


@pytest.mark.parametrize(("call", "error", "reason"), BAD_CALLS)
def test_parameter_methods_refuse_arguments_of_wrong_type(
    world: World, call: Callable[[Any], object], error: type[Exception], reason: str
) -> None:
    node = world.node("n")
    node.declare_parameters(Lists)
    with pytest.raises(error, match=reason):
        call(node)
    assert node.get_parameter("tags") == ("a",) and not node.has_parameter("x")


def test_invalid_parameter_overrides_are_refused(world: World) -> None:
    with pytest.raises(InvalidParameterValueError, match="parameter 'a': <object"):
        world.node("n", parameter_overrides={"a": object()})
    with pytest.raises(TypeError, match="parameter must be a str, got 5"):
        world.node("n", parameter_overrides={5: 1})
