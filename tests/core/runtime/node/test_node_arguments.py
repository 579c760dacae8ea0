"""Arguments of a node, in addition to the arguments of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import String

from rosidl_py_gen.runtime import Node, RosArgumentError

if TYPE_CHECKING:
    from pathlib import Path

    from support.worlds import World


def test_remap_rules_of_a_node_take_precedence_over_context_rules(memory: World) -> None:
    context = memory.context("--ros-args -r a:=global_a -r b:=global_b -r __ns:=/everybody -r __node:=renamed")
    node = memory.node("n", context=context, cli_args=["--ros-args", "-r", "a:=own_a", "-r", "__node:=mine"])
    assert node.fully_qualified_name == "/everybody/mine"
    assert node.resolve_topic_name("a") == "/everybody/own_a"
    assert node.resolve_topic_name("b") == "/everybody/global_b"
    assert node.create_publisher(String, "a").topic == "/everybody/own_a"
    assert memory.node("n", context=context).fully_qualified_name == "/everybody/renamed"


def test_parameter_precedence_is_constructor_then_node_arguments_then_context(memory: World, tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text("n:\n  ros__parameters:\n    a: 10\n    b: 20\nother:\n  ros__parameters:\n    c: 30\n")
    context = memory.context("--ros-args -p a:=1 -p b:=2 -p c:=3 -p d:=4")
    arguments = ["--ros-args", "--params-file", str(file), "-p", "b:=21"]
    node = memory.node("n", context=context, cli_args=arguments, parameter_overrides={"d": 40})
    assert [node.declare_parameter(name, 0) for name in "abcd"] == [10, 21, 3, 40]
    assert memory.node("n2", context=context).declare_parameter("a", 0) == 1


def test_node_can_ignore_the_arguments_of_its_context(memory: World) -> None:
    context = memory.context("--ros-args -r a:=global_a -r __node:=renamed -r __ns:=/ns -p a:=1")
    node = memory.node("n", context=context, use_global_arguments=False, cli_args=("--ros-args", "-r", "b:=own"))
    assert node.fully_qualified_name == "/n"
    assert (node.resolve_topic_name("a"), node.resolve_topic_name("b")) == ("/a", "/own")
    assert node.declare_parameter("a", 7) == 7


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ros-args", "--log-level", "debug"], r"cli_args of a node .* Context\(args=\[\.\.\.\]\)"),
        (["--ros-args", "--disable-rosout-logs"], "cli_args of a node"),
        (["--ros-args", "-e", "/enclave"], "cli_args of a node"),
        (["--ros-args", "--no-such-flag"], "unknown ROS arguments: '--no-such-flag'"),
        (["--ros-args", "-r", "a"], "there is no ':='"),
    ],
)
def test_invalid_node_arguments_are_refused_and_create_no_node(memory: World, arguments: list[str], words: str) -> None:
    context = memory.context()
    with pytest.raises(RosArgumentError, match=words):
        Node("n", context=context, cli_args=arguments)
    with pytest.raises(TypeError, match="args must be a list of arguments"):
        Node("n", context=context, cli_args="--ros-args")
    assert memory.node("other", context=context).get_node_names() == ["/other"]


def test_bare_remap_rule_in_node_arguments_is_applied_with_warning(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("n", cli_args=["program", "--fast", "a:=b"])
    assert node.resolve_topic_name("a") == "/b"
    assert "remap rule 'a:=b' outside of --ros-args is deprecated" in caplog.text


def test_unused_parameter_argument_is_warned_about_for_its_node(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    context = memory.context("--ros-args -p globl:=1")
    node = memory.node("n", context=context, use_global_arguments=False, cli_args=["--ros-args", "-p", "owm:=2"])
    other = memory.node("other", context=context)
    node.declare_parameter("own", 0)
    other.declare_parameter("global", 0)
    node.close()
    assert "-p owm:=2 sets the parameter owm = 2 of /n, which declares no parameter of that name" in caplog.text
    assert "globl" not in caplog.text
    other.close()
    assert "-p globl:=1 sets the parameter globl = 1 of /other" in caplog.text
