"""Warnings about initial values that no parameter uses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from support.waiting import until
from support.worlds import World

from rosidl_py_gen.runtime import LifecycleNode, WrongParameterTypeError
from rosidl_py_gen.runtime.node.context import core_of

if TYPE_CHECKING:
    from pathlib import Path

    from rosidl_py_gen.runtime import Node


async def list_parameters_of(memory: World, node: Node) -> None:
    asker = memory.node("asker")
    await asker.create_parameter_client(node.fully_qualified_name).list(timeout_s=20)
    asker.close()


async def test_unused_initial_value_is_warned_about_when_parameters_are_listed(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("drive", args="--ros-args -p sped:=2 -p mode:=fast -p use_sim_time:=false")
    node.declare_parameter("speed", 1.5)
    node.declare_parameter("mode", "slow")
    for _ in range(2):
        await list_parameters_of(memory, node)
        await until(lambda: bool(caplog.messages))
    node.close()
    assert caplog.messages == [
        "-p sped:=2 sets the parameter sped = 2 of /drive, which declares no parameter of that name; "
        'did you mean "speed"?'
    ]


def test_unused_initial_value_is_warned_about_when_node_closes(memory: World, caplog: pytest.LogCaptureFixture) -> None:
    node = memory.node("drive", parameter_overrides={"sped": 2, "late": 1})
    node.declare_parameter("speed", 1.5)
    node.declare_parameter("late", 5)
    node.undeclare_parameter("late")
    node.close()
    assert caplog.messages == [
        "parameter_overrides= sets the parameter sped = 2 of /drive, which declares no parameter of that name; "
        'did you mean "speed"?'
    ]


def test_refused_initial_value_error_contains_its_origin(memory: World, caplog: pytest.LogCaptureFixture) -> None:
    node = memory.node("drive", args="--ros-args -p speed:=fast -p later:=2", parameter_overrides={"mode": 3})
    with pytest.raises(WrongParameterTypeError) as error:
        node.declare_parameter("speed", 1.5)
    assert str(error.value) == "parameter 'speed' is of type STRING, expected DOUBLE; the value is from -p speed:=fast"
    assert error.value.source == "-p speed:=fast"
    with pytest.raises(WrongParameterTypeError) as own:
        node.declare_parameter("mode", "slow")
    assert (str(own.value), own.value.source) == ("parameter 'mode' is of type INTEGER, expected STRING", "")
    node.close()
    assert caplog.messages == []


async def test_initial_value_for_several_nodes_must_be_declared_by_one(
    memory: World, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "all.yaml"
    file.write_text("/**:\n  ros__parameters: {speed: 1.0, turn: 2}\n/b:\n  ros__parameters: {own: 1}\n", "utf-8")
    context = memory.context(f"--ros-args --params-file {file}")
    one, other = memory.node("a", context=context), memory.node("b", context=context)
    one.declare_parameter("speed", 0.5)
    other.declare_parameter("turns", 1)
    await list_parameters_of(memory, other)
    await until(lambda: len(caplog.messages) == 2)
    context.close()
    assert caplog.messages == [
        f'{file} sets the parameter turn = 2 of /a, /b, which declare no parameter of that name; did you mean "turns"?',
        f"{file} sets the parameter own = 1 of /b, which declares no parameter of that name",
    ]


async def test_initial_values_for_a_missing_node_are_warned_about(
    memory: World, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shared, wrong = tmp_path / "shared.yaml", tmp_path / "wrong.yaml"
    shared.write_text("/drive:\n  ros__parameters: {speed: 1.0}\n/elsewhere:\n  ros__parameters: {x: 1}\n", "utf-8")
    wrong.write_text("/drvie:\n  ros__parameters: {speed: 1.0}\n", "utf-8")
    arguments = f"--ros-args --params-file {shared} --params-file {wrong} -p arm:speed:=1"
    memory.node("drive", args=arguments).declare_parameter("speed", 0.5)
    memory.close()
    assert caplog.messages == [
        f'{wrong} has parameters for /drvie, but this process has no such node; did you mean "/drive"?',
        "-p arm:speed:=1 has parameters for /arm, but this process has no such node",
    ]


async def test_lifecycle_node_is_not_warned_about_before_it_is_configured(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    class Managed(LifecycleNode):
        def on_configure(self, state: object) -> None:
            self.declare_parameter("speed", 1.0)

    managed = Managed("drive", context=memory.context("--ros-args -p speed:=2.0 -p nope:=1"))
    memory.node("other", context=managed.context, parameter_overrides={"first": 1})
    await list_parameters_of(memory, managed)
    assert not caplog.messages
    await managed.configure()
    await list_parameters_of(memory, managed)
    await until(lambda: bool(caplog.messages))
    assert "nope = 1 of /drive, /other" in caplog.messages[0] and managed.get_parameter("speed") == 2.0


async def test_ignored_initial_value_is_warned_about(memory: World, caplog: pytest.LogCaptureFixture) -> None:
    node = memory.node("drive", args="--ros-args -p speed:=2.0")
    node.declare_parameter("speed", 1.0, ignore_override=True)
    node.close()
    assert caplog.messages == [
        "-p speed:=2.0 sets the parameter speed = 2.0 of /drive, which ignores initial values for it"
    ]


def test_no_node_names_are_retained_without_initial_values(memory: World) -> None:
    context = memory.node("drive").context
    assert core_of(context).initial_values.node_names == []
