"""Command ``graph``: connections of nodes through topics, services and actions.

An action is one item, instead of its two topics and three services. Topics and services that every node has are
omitted. `graph/text.py` and `graph/svg.py` draw the graph.
"""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import product
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.terminal_text import json_text, pluralize
from rosidl_py_gen.ros_cli import options, terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.graph.text import Edge, Picture
    from rosidl_py_gen.runtime import NamesAndTypes, Node


_ACTION, _GOAL = "/_action/", "/_action/send_goal"
_EVERY_TOPIC = ("/rosout", "/parameter_events")
_EVERY_PACKAGE = ("rcl_interfaces/srv/", "type_description_interfaces/srv/")


@click.command("graph")
@options.output_format_options("svg")
@click.option(
    "--node",
    "nodes",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("nodes"),
    help="Show only these nodes and their connections; * matches any text. May be repeated.",
)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("topics"),
    help="Show only these topics, services or actions; as --node.",
)
@click.option("-a", "--all", "everything", is_flag=True, help="Also show hidden names, and what every node has.")
@options.node_verb
async def graph(
    command_node: CommandNode,
    kind: str | None,
    as_json: bool,
    output: str | None,
    nodes: tuple[str, ...],
    topics: tuple[str, ...],
    everything: bool,
) -> None:
    """Show which nodes are connected through which topics, services and actions.

    Parameter services, /rosout and /parameter_events, which every node has, are omitted.

    \b
    rosidl-py graph
    rosidl-py graph -o graph.svg
    rosidl-py graph --node '/camera*' --format mermaid
    """
    import asyncio

    kind = options.output_format("svg", kind, as_json, output)
    await command_node.wait_for_node_names()
    picture = _filtered(_picture(command_node, everything), nodes, topics)
    from rosidl_py_gen.ros_cli.graph.svg import svg_picture
    from rosidl_py_gen.ros_cli.graph.text import graph_document, mermaid_text, text_lines

    draw = {
        "svg": lambda: svg_picture(picture),
        "mermaid": lambda: mermaid_text(picture),
        "json": lambda: json_text(graph_document(picture), indent=2),
    }
    await asyncio.to_thread(terminal_output.drawing, kind, output, text_lines(picture), draw)
    if output is not None:
        terminal_output.note(f"wrote {output}: {pluralize(len(picture.nodes), 'node')}")


def _picture(command_node: CommandNode, everything: bool) -> Picture:
    from rosidl_py_gen.ros_cli.graph.text import Picture

    node = command_node.node
    edges: set[Edge] = set()
    names = []
    for info in node.get_nodes():
        full = info.fully_qualified_name
        if full != node.fully_qualified_name and (everything or not info.name.startswith("_")):
            names.append(full)
            edges.update(_edges_of(node, info.name, info.namespace, full, everything))
    edges.update(_edges_without_node(node, everything))
    unlisted = {edge.node for edge in edges} - set(names)
    return Picture(
        command_node.context.domain_id, sorted({*names, *unlisted}), sorted(edges), _unmatched_nodes(node, edges)
    )


def _unmatched_nodes(node: Node, edges: Iterable[Edge]) -> frozenset[tuple[str, str, str]]:
    """Return tuples (publisher's node, topic, subscriber's node) of nodes with endpoints on the same topic none of
    which match.
    """
    match: dict[tuple[str, str, str], bool] = {}
    for topic in {edge.name for edge in edges if edge.kind == "topic"}:
        incompatible = {
            (one.writer.endpoint_gid, one.reader.endpoint_gid) for one in node.incompatible_endpoints_of_topic(topic)
        }
        for writer, reader in product(
            node.get_publishers_info_by_topic(topic), node.get_subscriptions_info_by_topic(topic)
        ):
            pair = writer.node_text, topic, reader.node_text
            match[pair] = match.get(pair, False) or (writer.endpoint_gid, reader.endpoint_gid) not in incompatible
    return frozenset(pair for pair, are_connected in match.items() if not are_connected)


def _edges_of(node: Node, name: str, namespace: str, full: str, everything: bool) -> Iterator[Edge]:
    from rosidl_py_gen.ros_cli.graph.text import Edge

    topics: dict[str, Callable[[str, str], NamesAndTypes]] = {
        "publishes": node.get_publisher_names_and_types_by_node,
        "subscribes": node.get_subscriber_names_and_types_by_node,
    }
    services: dict[str, Callable[[str, str], NamesAndTypes]] = {
        "serves": node.get_service_names_and_types_by_node,
        "calls": node.get_client_names_and_types_by_node,
    }
    for role, names_of in topics.items():
        for topic, types in names_of(name, namespace):
            if _is_topic(topic, everything):
                yield Edge(full, role, "topic", topic, tuple(types))
    for role, names_of in services.items():
        for service, types in names_of(name, namespace):
            if service.endswith(_GOAL):
                actions = tuple(one.removesuffix("_SendGoal") for one in types)
                yield Edge(full, role, "action", service.removesuffix(_GOAL), actions)
            elif _ACTION not in service and (everything or _is_own(service, types)):
                yield Edge(full, role, "service", service, tuple(types))


def _edges_without_node(node: Node, everything: bool) -> Iterator[Edge]:
    """Yield an edge of the graph for each endpoint that belongs to no node, or whose node name has not arrived yet."""
    from rosidl_py_gen.ros_cli.graph.text import Edge

    for topic, _ in node.get_topic_names_and_types():
        if _is_topic(topic, everything):
            for role, infos in (
                ("publishes", node.get_publishers_info_by_topic(topic)),
                ("subscribes", node.get_subscriptions_info_by_topic(topic)),
            ):
                for info in infos:
                    if not info.has_node_name:
                        yield Edge(info.node_text, role, "topic", topic, (info.topic_type,))


def _is_topic(topic: str, everything: bool) -> bool:
    return _ACTION not in topic and (everything or not (topic in _EVERY_TOPIC or "/_" in topic))


def _is_own(service: str, types: Iterable[str]) -> bool:
    return "/_" not in service and not any(one.startswith(_EVERY_PACKAGE) for one in types)


def _filtered(picture: Picture, nodes: tuple[str, ...], topics: tuple[str, ...]) -> Picture:
    if not nodes and not topics:
        return picture
    selected_nodes = _matching(nodes, picture.nodes, "node")
    selected_names = _matching(topics, sorted({edge.name for edge in picture.edges}), "topic, service or action")
    names = {
        (edge.kind, edge.name)
        for edge in picture.edges
        if (not nodes or edge.node in selected_nodes) and (not topics or edge.name in selected_names)
    }
    edges = [edge for edge in picture.edges if (edge.kind, edge.name) in names]
    selected = selected_nodes if nodes else {edge.node for edge in edges}
    return replace(picture, nodes=sorted(selected), edges=edges)


def _matching(patterns: tuple[str, ...], names: list[str], subject: str) -> set[str]:
    edges: set[str] = set()
    for text in patterns:
        pattern = text if text.startswith(("/", "*", "(")) else f"/{text}"
        matches = [name for name in names if fnmatchcase(name, pattern)]
        if not matches:
            hint = did_you_mean(pattern, names) or f"; {len(names)} are known"
            raise CommandError(f"no {subject} {pattern}{hint}")
        edges.update(matches)
    return edges
