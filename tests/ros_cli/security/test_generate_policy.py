"""``rosidl-py security generate_policy`` beside nodes, compared with the policy that SROS2 made of them."""

from __future__ import annotations

import json
from datetime import datetime
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import String
from std_srvs.srv import Trigger

from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.ros_cli.security.permissions import permissions_xml
from rosidl_py_gen.ros_cli.security.policy import ALLOW, PolicyEnclave, PolicyRule, read_policy
from rosidl_py_gen.runtime import Context
from rosidl_py_gen.runtime.transport.api import NodeEntities

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool
    from support.node_fixtures import World


QUIET: Any = {
    "start_services": False,
    "enable_rosout": False,
    "parameter_events": False,
    "parameter_overrides": {"start_type_description_service": False},
}


@pytest.fixture
def graph(memory: World, golden: Path) -> None:
    """The nodes of graph.json."""
    contexts: dict[str, Context] = {}
    for one in json.loads((golden / "graph.json").read_text()):
        enclave = one["enclave"]
        if enclave not in contexts:
            contexts[enclave] = memory.context(f"--ros-args --enclave {enclave}")
        node = memory.node(one["name"], one["namespace"], context=contexts[enclave], **QUIET)
        for name in one["publishers"]:
            node.create_publisher(String, name)
        for name in one["subscribers"]:
            node.create_subscription(String, name)
        for name in one["services"]:
            node.create_service(Trigger, name)
        for name in one["clients"]:
            node.create_client(Trigger, name)


async def test_the_policy_of_running_nodes_is_that_of_sros2(
    graph: None, tool: Tool, golden: Path, tmp_path: Path
) -> None:
    path = tmp_path / "policy.xml"
    ended = await tool("security", "generate_policy", str(path))
    assert (ended.code, ended.err) == (0, "")
    assert ended.out == f"wrote {path}: 3 nodes, enclaves /demo/listener, /demo/talker\n"
    assert path.read_text() == (golden / "policy.xml").read_text()


async def test_an_existing_policy_is_extended(graph: None, tool: Tool, golden: Path, tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    path.write_text((golden / "policies/two_grants.xml").read_text())
    ended = await tool("security", "generate_policy", str(path), "--json")
    assert [one["name"] for one in json.loads(ended.out)["nodes"]] == ["/talker", "/left/listener", "/left/second"]
    assert path.read_text() == (golden / "extended.xml").read_text()
    before = path.read_text()
    await tool("security", "generate_policy", str(path))
    assert path.read_text() == before


async def test_names_are_not_added_to_rules_that_allow_more(graph: None, tool: Tool, tmp_path: Path) -> None:
    """SROS2 adds topics to the first rule that allows subscriptions, though it may allow publishing, too."""
    path = tmp_path / "policy.xml"
    path.write_text(
        '<policy version="0.2.0"><enclaves><!-- a note --><enclave path="/demo/talker"><profiles>'
        '<profile ns="/" node="talker"><topics publish="ALLOW" subscribe="ALLOW"><topic>both</topic></topics></profile>'
        '<metadata x="1"><b xmlns="urn:b" y="&lt;"/>text</metadata></profiles></enclave></enclaves></policy>'
    )
    await tool("security", "generate_policy", str(path))
    rules = read_policy(str(path)).enclaves["/demo/talker"].grants[0]
    found = {tuple(sorted(rule.access)): set(rule.names) for rule in rules if rule.kind == "topics"}
    assert found == {
        ("publish", "subscribe"): {"/both"},
        ("subscribe",): {"/clock"},
        ("publish",): {"/chatter", "/deep/topic", "/talker/status"},
    }
    text = path.read_text()
    assert "<!-- a note -->" in text and '<b xmlns="urn:b" y="&lt;"/>' in text and '<metadata x="1">text' in text


async def test_without_nodes_no_file_is_written(memory: World, tool: Tool, tmp_path: Path) -> None:
    memory.node("_hidden")
    ended = await tool("security", "generate_policy", str(tmp_path / "policy.xml"))
    assert (ended.code, ended.out) == (1, "")
    assert "no nodes were found in domain 0; " in ended.err and "was not written" in ended.err
    assert not [*tmp_path.iterdir()]


async def test_a_file_that_is_no_policy_stays(graph: None, tool: Tool, tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    path.write_text("<other/>")
    ended = await tool("security", "generate_policy", str(path))
    assert ended.code == 1 and "the root element is <other>; expected <policy" in ended.err
    assert path.read_text() == "<other/>"


async def test_a_link_stays_and_its_file_is_written(graph: None, tool: Tool, tmp_path: Path) -> None:
    (tmp_path / "link.xml").symlink_to("policy.xml")
    await tool("security", "generate_policy", str(tmp_path / "link.xml"))
    assert (tmp_path / "link.xml").is_symlink()
    assert set(read_policy(str(tmp_path / "policy.xml")).enclaves) == {"/demo/talker", "/demo/listener"}


async def test_names_of_peers_are_not_trusted(memory: World, tool: Tool, tmp_path: Path) -> None:
    scope = memory.node("good", **QUIET)._scope
    for number, (namespace, name) in enumerate((("/a\"><enclave path='/x", "n"), ("/n", 'b"/>\n<x'), ("/", "")), 1000):
        scope.discovery._nodes[number] = NodeEntities(namespace, name, frozenset(), frozenset())
    scope.discovery.publish()
    path = tmp_path / "policy.xml"
    ended = await tool("security", "generate_policy", str(path))
    assert ended.code == 0
    assert ended.err.count("skipped node ") == ended.err.count("\n") > 0
    assert [*read_policy(str(path)).enclaves] == ["/"]
    assert path.read_text().count("<profile ") == 1


async def test_actions_are_allowed_as_their_topics_and_services(memory: World, tool: Tool, tmp_path: Path) -> None:
    """The permissions are those of an ``<actions>`` element."""
    server, client = memory.node("server", **QUIET), memory.node("client", **QUIET)
    server.create_action_server(Fibonacci, "count", lambda goal: None)
    client.create_action_client(Fibonacci, "count")
    path = tmp_path / "policy.xml"
    assert (await tool("security", "generate_policy", str(path))).code == 0
    (rules,) = read_policy(str(path)).enclaves["/"].grants
    for node, attribute in (("server", "execute"), ("client", "call")):
        made = tuple(
            rule for rule in rules if ("reply" in rule.access or "publish" in rule.access) == (node == "server")
        )
        expected = (PolicyRule("actions", {attribute: ALLOW}, ("/count",)),)
        assert allowed(made) == allowed(expected)


def allowed(rules: tuple[PolicyRule, ...]) -> list[str]:
    enclave = PolicyEnclave("/", (rules,), XmlElement("enclave"))
    return sorted(permissions_xml(enclave, 0, datetime(2020, 1, 1), datetime(2030, 1, 1)).splitlines())
