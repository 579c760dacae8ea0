"""Notes of commands if no messages arrive: another type, incompatible QoS, another definition."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING, Any

import pytest
from support.node_fixtures import until

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from support.node_fixtures import World

String: Any = get_message("std_msgs/msg/String")
Bool: Any = get_message("std_msgs/msg/Bool")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["std_msgs/msg/Bool"], "types differ, std_msgs/msg/String and std_msgs/msg/Bool"),
        (["--qos-durability", "transient_local"], "their quality of service is incompatible"),
    ],
)
async def test_echo_says_why_nothing_comes(dds: World, tool: Any, arguments: list[str], reason: str) -> None:
    publisher = dds.node("talker").create_publisher(String, "/words")
    done = await tool("topic", "echo", "/words", *arguments, "--timeout", "8")
    assert f"warning: no messages on /words from node /talker to this command: {reason}" in done.err
    assert done.code == 1 and publisher.subscription_count == 0


async def test_pub_says_why_nobody_listens(dds: World, tool: Any) -> None:
    dds.node("listener").create_subscription(String, "/words")
    done = await tool("topic", "pub", "/words", "std_msgs/msg/Bool", "data: true", "-w", "1", "--timeout", "8")
    reason = "types differ, std_msgs/msg/Bool and std_msgs/msg/String"
    assert f"warning: no messages on /words from this command to node /listener: {reason}" in done.err


async def test_info_shows_what_does_not_fit_together(dds: World, tool: Any) -> None:
    old, new = (compile_definition("silent_msgs/msg/Changed", text) for text in ("int32 x", "int64 x"))
    alice, bob = dds.pair()
    alice.create_publisher(old, "/changed", QoSProfile())
    bob.create_subscription(new, "/changed")
    bob.create_subscription(Bool, "/changed")
    await until(lambda: alice.count_subscribers("/changed") == 2)
    shown, plain = await asyncio.gather(
        tool("topic", "info", "-v", "/changed"), tool("topic", "info", "/changed", "--json")
    )
    said = (
        "no messages from /alice to /bob: their definitions of silent_msgs/msg/Changed differ: "
        f"{type_hash(old)} and {type_hash(new)}"
    )
    assert f"warning: {said}" in shown.out
    assert "warning: no messages from /alice to /bob: types differ, silent_msgs/msg/Changed and std_msgs" in shown.out
    assert said in json.loads(plain.out)["mismatches"]


async def test_lists_of_an_empty_domain_come_with_a_note(memory: World, tool: Any) -> None:
    commands = [(group, "list") for group in ("topic", "node", "service", "action", "param")] + [("lifecycle", "nodes")]
    note = "no nodes were found in domain"
    for words in commands:
        for options in ((), ("--json",)):
            ended = await tool(*words, *(option for option in options if words[0] != "param"))
            assert (ended.code, ended.err.count("\n"), ended.err.startswith(note)) == (0, 1, True), words
    memory.node("talker", enable_rosout=False)
    for words in commands:
        assert (await tool(*words)).err == "", words
