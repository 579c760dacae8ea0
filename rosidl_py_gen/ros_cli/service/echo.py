"""``service echo``: events that clients and servers with introspection publish on ``<service>/_service_event``."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message

_PUBLISHER_TIMEOUT_S = 1.0
"""Time to wait for a publisher of events, which is discovered together with the service."""


@click.command("echo")
@options.service_argument()
@click.argument("type_name", metavar="[TYPE]", required=False, shell_complete=options.call_completion("service"))
@click.option("--once", is_flag=True, help="Print one event and end.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@click.option("--flow-style", is_flag=True, help="Print each event on one line.")
@options.paths
@options.as_json
@options.node_options
@verb
def echo(
    network: options.NetworkOptions,
    service: str,
    type_name: str | None,
    once: bool,
    full_length: bool,
    flow_style: bool,
    paths: tuple[str, ...],
    as_json: bool,
) -> AsyncCommand:
    """Print requests and responses as they pass. Servers or clients must have introspection enabled.

    \b
    rosidl-py service echo /add_two_ints
    """
    from rosidl_py_gen.ros_cli import message_text, type_resolution
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.service.info import find_service
    from rosidl_py_gen.runtime import WaitTimeoutError
    from rosidl_py_gen.runtime.qos import SERVICES_DEFAULT

    async def main() -> int:
        async with CommandNode(network) as command_node:
            name = await type_resolution.preload_while_waiting(find_service(command_node, service))
            cls: Any = await type_resolution.service_class(command_node, name, type_name, paths)
            events = command_node.node.create_subscription(cls.Event, f"{name}/_service_event", qos=SERVICES_DEFAULT)
            try:
                await events.wait_for_publishers(_PUBLISHER_TIMEOUT_S)
            except WaitTimeoutError:
                terminal_output.note(
                    f"no node publishes {name}/_service_event: introspection is off at all servers and clients of "
                    f"{name}; waiting until it is enabled (configure_introspection)"
                )
            async for event in events:
                row = _row(event, None if full_length else message_text.TRUNCATE)
                if as_json:
                    terminal_output.document(row, in_stream=not once)
                else:
                    terminal_output.block(message_text.to_yaml(row, flow=flow_style) + "---")
                if once:
                    break
        return 0

    return AsyncCommand(main(), endless=True)


def _row(event: Message, truncate: int | None) -> dict[str, Any]:
    from rosidl_py_gen.ros_cli import message_text
    from rosidl_py_gen.runtime import ServiceEventType

    row: dict[str, Any] = message_text.to_plain(event, truncate=truncate)
    with suppress(ValueError):  # a peer may send any number
        row["info"]["event_type"] = ServiceEventType(row["info"]["event_type"]).name
    return row
