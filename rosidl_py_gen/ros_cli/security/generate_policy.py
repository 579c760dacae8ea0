"""Command ``security generate_policy``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.ros_cli import options, terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.base.xml_reader import XmlElement
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.runtime import Node, NodeInfo


@click.command("generate_policy")
@click.argument("policy_file", metavar="POLICY_FILE_PATH", type=click.Path(dir_okay=False))
@options.as_json
@options.node_verb
async def generate_policy(command_node: CommandNode, policy_file: str, as_json: bool) -> None:
    """Write a policy that allows what the running nodes do.

    An existing policy is extended. Nodes whose names begin with _ are skipped.

    \b
    rosidl-py security generate_policy policy.xml
    """
    from rosidl_py_gen.base.xml_reader import XmlElement
    from rosidl_py_gen.ros_cli.name_lookup import is_hidden_node
    from rosidl_py_gen.ros_cli.security.key_files import write_file
    from rosidl_py_gen.ros_cli.security.policy import VERSION, policy_text, read_policy

    path = os.path.realpath(policy_file)
    if os.path.lexists(path):
        root = read_policy(policy_file).root
    else:
        root = XmlElement("policy", {"version": VERSION}, children=[XmlElement("enclaves")])
    await command_node.wait_for_node_names()
    nodes = [one for one in command_node.node.get_nodes() if not is_hidden_node(one.fully_qualified_name)]
    added = [one for one in nodes if _add_node(root, command_node.node, one)]
    if not added:
        domain_id = command_node.context.domain_id
        raise CommandError(f"no nodes were found in domain {domain_id}; {policy_file} was not written")
    write_file(Path(path), policy_text(root).encode())
    rows = [{"name": one.fully_qualified_name, "enclave": one.enclave} for one in added]
    enclaves = ", ".join(sorted({one.enclave for one in added}))
    text = f"wrote {policy_file}: {pluralize(len(added), 'node')}, enclaves {enclaves}"
    terminal_output.result([text], as_json, {"policy": policy_file, "nodes": rows})


def _add_node(root: XmlElement, node: Node, other: NodeInfo) -> bool:
    """Add a profile of another node to a policy; returns False, with a note, if ROS does not allow its names."""
    from rosidl_py_gen.errors import InvalidNameError
    from rosidl_py_gen.ros_cli.security.policy import check_enclave_name
    from rosidl_py_gen.runtime import validate_namespace, validate_node_name

    try:
        check_enclave_name(other.enclave)
        validate_namespace(other.namespace)
        validate_node_name(other.name)
    except InvalidNameError as error:
        terminal_output.note(f"skipped node {other.fully_qualified_name}: {str(error).partition(chr(10))[0]}")
        return False
    profile = _profile(root, other)
    identity = other.name, other.namespace
    for kind, attribute, found in (
        ("topics", "subscribe", node.get_subscriber_names_and_types_by_node(*identity)),
        ("topics", "publish", node.get_publisher_names_and_types_by_node(*identity)),
        ("services", "reply", node.get_service_names_and_types_by_node(*identity)),
        ("services", "request", node.get_client_names_and_types_by_node(*identity)),
    ):
        names = [name for name, _ in found if _is_valid(name)]
        if names:
            _add_rule(profile, kind, attribute, (_relative(name, other) for name in names))
    return True


def _is_valid(name: str) -> bool:
    from rosidl_py_gen.errors import InvalidNameError
    from rosidl_py_gen.runtime import validate_full_name

    try:
        validate_full_name(name)
    except InvalidNameError as error:
        terminal_output.note(f"skipped a topic: {str(error).partition(chr(10))[0]}")
        return False
    return True


def _relative(name: str, node: NodeInfo) -> str:
    """Return a name as programs write it: ``~/x`` below the node's name, ``x`` in its namespace, else in full."""
    if name.startswith(f"{node.fully_qualified_name}/"):
        return f"~{name[len(node.fully_qualified_name) :]}"
    if node.namespace == "/":
        return name[1:] if name.count("/") == 1 else name
    return name.removeprefix(f"{node.namespace}/")


def _profile(root: XmlElement, node: NodeInfo) -> XmlElement:
    """Return the profile of a node in a policy, which is created if it does not exist."""
    enclaves = _child(root, "enclaves", {})
    enclave = _child(enclaves, "enclave", {"path": node.enclave})
    return _child(_child(enclave, "profiles", None), "profile", {"ns": node.namespace, "node": node.name})


def _add_rule(profile: XmlElement, kind: str, attribute: str, names: Iterable[str]) -> None:
    from rosidl_py_gen.base.xml_reader import XmlElement
    from rosidl_py_gen.ros_cli.security.policy import ALLOW, RULES

    rule = _child(profile, kind, {attribute: ALLOW})
    tag, _ = RULES[kind]
    rule.children += (XmlElement(tag, text=name) for name in names)


def _child(parent: XmlElement, tag: str, attributes: dict[str, str] | None) -> XmlElement:
    """Return the child element with a tag and exactly these attributes (None: any), created if it does not exist.

    A rule with more attributes is not used: names added to such a rule would be allowed for more than a node does.
    """
    from rosidl_py_gen.base.xml_reader import XmlElement

    for child in parent.elements:
        names = {name: value for name, value in child.attributes.items() if not name.startswith("{")}
        if child.tag == tag and (attributes is None or names == attributes):
            return child
    child = XmlElement(tag, dict(attributes or {}))
    parent.children.append(child)
    return child
