"""Commands of ``rosidl-py service``; ``call`` prints messages by rclpy's `repr`, as ``ros2 service call`` does."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.graph_verbs import find_verb, list_verb, type_verb

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import Node, TopicEndpointInfo

_ENDPOINTS_TIMEOUT_S = 1.0
"""Maximum time, in seconds, to wait for the second topic of a service, by which its endpoints are counted."""
_PUBLISHER_TIMEOUT_S = 1.0
"""Maximum time to wait for a publisher of service events, in seconds, before a note that introspection is off."""
_hidden = click.option(
    "-a",
    "--include-hidden-services",
    "hidden",
    is_flag=True,
    help="Include hidden services: the services of actions, and others with a part that begins with _.",
)


def _services(node: Node) -> list[dict[str, Any]]:
    return [
        {"name": name, "types": types, "servers": node.count_services(name), "clients": node.count_clients(name)}
        for name, types in node.get_service_names_and_types()
    ]


list_ = list_verb(
    "service", "rosidl-py service list -t\nrosidl-py service list --json | jq '.[].name'", _services, _hidden
)
find = find_verb("service", "srv", "std_srvs/srv/Trigger", _services, _hidden)
type_ = type_verb("service", "rosidl-py service type /add_two_ints")


@click.command("info")
@options.service_argument()
@click.option("-v", "--verbose", is_flag=True, help="Include the GID and QoS of each client and server.")
@options.as_json
@options.node_verb
async def info(command_node: CommandNode, service: str, verbose: bool, as_json: bool) -> None:
    """Print the type of a service, and its numbers of clients and servers.

    \b
    rosidl-py service info /add_two_ints -v
    """
    node = command_node.node
    name = await command_node.find("service", service)
    await (command_node.wait_for_node_names() if verbose else command_node.wait_for_discovery())
    await command_node.wait_for(lambda: node.count_services(name) or node.count_clients(name), _ENDPOINTS_TIMEOUT_S)
    row: dict[str, Any] = {
        "name": name,
        "types": dict(node.get_service_names_and_types()).get(name, []),
        "clients": node.count_clients(name),
        "servers": node.count_services(name),
    }
    lines = [f"Type: {', '.join(row['types'])}", f"Clients count: {row['clients']}"]
    lines.append(f"Services count: {row['servers']}")
    if verbose:
        row["endpoints"] = [
            *(_endpoint(one, "SERVER") for one in node.get_servers_info_by_service(name)),
            *(_endpoint(one, "CLIENT") for one in node.get_clients_info_by_service(name)),
        ]
        for one in row["endpoints"]:
            lines += "", f"Node: {one['node']}", f"Endpoint type: {one['endpoint']}", f"GID: {one['gid']}"
            lines += "QoS profile:", f"  Reliability: {one['reliability']}", f"  History (Depth): {one['history']}"
            lines.append(f"  Durability: {one['durability']}")
    terminal_output.result(lines, as_json, row)


def _endpoint(endpoint: TopicEndpointInfo, kind: str) -> dict[str, Any]:
    qos = endpoint.qos_profile
    return {
        "node": endpoint.node_text,
        "endpoint": kind,
        "gid": endpoint.endpoint_gid.hex("."),
        "reliability": qos.reliability.name,
        "durability": qos.durability.name,
        "history": f"{qos.history.name} ({qos.depth})" if qos.depth else qos.history.name,
    }


@click.command("call")
@options.service_argument()
@click.argument("words", nargs=-1, metavar="[TYPE] [VALUES]", shell_complete=options.call_completion("service"))
@click.option("--stdin", is_flag=True, help="Read the values from standard input.")
@options.rate("-r", "--rate", help="Calls per second; repeat until Ctrl-C.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@options.timeout("Maximum time to wait for the server, and for each response.", default_s=10)
@options.paths
@options.as_json
@options.endless_node_verb(lambda arguments: arguments["rate"] is not None)
async def call(
    command_node: CommandNode,
    service: str,
    words: tuple[str, ...],
    stdin: bool,
    rate: float | None,
    full_length: bool,
    timeout_s: float,
    paths: tuple[str, ...],
    as_json: bool,
) -> None:
    """Call a service. VALUES are YAML or JSON; omitted fields have their defaults.

    TYPE may be omitted. --json prints only the response.

    \b
    rosidl-py service call /add_two_ints '{a: 1, b: 2}'
    rosidl-py service call /add_two_ints example_interfaces/srv/AddTwoInts '{a: 1, b: 2}'
    rosidl-py service call /status std_srvs/srv/Trigger --rate 2 --json
    """
    import asyncio

    from rosidl_py_gen import to_dict
    from rosidl_py_gen.command_support import interface_class, preload_while_waiting
    from rosidl_py_gen.ros_cli import message_text

    type_name, text = message_text.type_and_values(words, stdin=stdin)
    name = await preload_while_waiting(command_node.find("service", service, timeout_s))
    cls: Any = await interface_class(command_node, "service", name, type_name, paths)
    request = message_text.message_from(cls.Request, text)
    client = command_node.node.create_client(cls, name)
    truncate = None if full_length else message_text.TRUNCATE
    loop = asyncio.get_running_loop()
    while True:
        start_s = loop.time()
        if not as_json:
            terminal_output.lines([f"requester: making request: {message_text.rclpy_repr(request, truncate)}", ""])
        response = await client.call(request, timeout_s)
        if as_json:
            terminal_output.document(to_dict(response), in_stream=rate is not None)
        else:
            terminal_output.lines(["response:", message_text.rclpy_repr(response, truncate), ""])
        if rate is None:
            return
        await asyncio.sleep(start_s + 1 / rate - loop.time())


@click.command("echo")
@options.service_argument()
@click.argument("type_name", metavar="[TYPE]", required=False, shell_complete=options.call_completion("service"))
@click.option("--once", is_flag=True, help="Print one event and end.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@click.option("--flow-style", is_flag=True, help="Print each event on one line.")
@options.paths
@options.as_json
@options.endless_node_verb(lambda arguments: True)
async def echo(
    command_node: CommandNode,
    service: str,
    type_name: str | None,
    once: bool,
    full_length: bool,
    flow_style: bool,
    paths: tuple[str, ...],
    as_json: bool,
) -> None:
    """Print requests and responses as they pass. Servers or clients must have introspection enabled.

    \b
    rosidl-py service echo /add_two_ints
    """
    from rosidl_py_gen.command_support import interface_class, preload_while_waiting
    from rosidl_py_gen.ros_cli import message_text
    from rosidl_py_gen.runtime import WaitTimeoutError, qos

    name = await preload_while_waiting(command_node.find("service", service))
    cls: Any = await interface_class(command_node, "service", name, type_name, paths)
    events = command_node.node.create_subscription(cls.Event, f"{name}/_service_event", qos=qos.SERVICES_DEFAULT)
    try:
        await events.wait_for_publishers(_PUBLISHER_TIMEOUT_S)
    except WaitTimeoutError:
        terminal_output.note(
            f"no node publishes {name}/_service_event: introspection is off at all servers and clients of "
            f"{name}; waiting until it is enabled (configure_introspection)"
        )
    async for event in events:
        row = _event_row(event, None if full_length else message_text.TRUNCATE)
        if as_json:
            terminal_output.document(row, in_stream=not once)
        else:
            terminal_output.block(message_text.to_yaml(row, flow=flow_style) + "---")
        if once:
            break


def _event_row(event: Message, truncate: int | None) -> dict[str, Any]:
    from rosidl_py_gen.ros_cli import message_text
    from rosidl_py_gen.runtime import ServiceEventType

    row: dict[str, Any] = message_text.to_plain(event, truncate=truncate)
    with suppress(ValueError):  # a peer may send any number
        row["info"]["event_type"] = ServiceEventType(row["info"]["event_type"]).name
    return row
