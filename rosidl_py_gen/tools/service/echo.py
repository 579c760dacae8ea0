"""``service echo``: the events of ``<service>/_service_event``.

Decides that an event shows its kind by name. Clients and servers publish these when their introspection is on.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.tools import Job, options, printing, verb

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.tools.session import Network


_PATIENCE_S = 1.0
"""Whoever publishes events is discovered together with the service."""


@click.command("echo")
@options.service_argument()
@click.argument("type_name", metavar="[TYPE]", required=False, shell_complete=options.call_completion("service"))
@click.option("--once", is_flag=True, help="End after the first event.")
@click.option("-f", "--full-length", is_flag=True, help="Show long arrays and texts in full.")
@click.option("--flow-style", is_flag=True, help="Print each event on one line.")
@options.paths
@options.as_json
@options.node_options
@verb
def echo(
    network: Network,
    service: str,
    type_name: str | None,
    once: bool,
    full_length: bool,
    flow_style: bool,
    paths: tuple[str, ...],
    as_json: bool,
) -> Job:
    """Print requests and responses as they pass, of servers and clients whose introspection is on.

    \b
    rosidl-py service echo /add_two_ints
    """
    from rosidl_py_gen.runtime import WaitTimeoutError
    from rosidl_py_gen.runtime.qos import SERVICES_DEFAULT
    from rosidl_py_gen.tools import messages, types
    from rosidl_py_gen.tools.service.info import find_service
    from rosidl_py_gen.tools.session import Session

    async def main() -> int:
        async with Session(network) as session:
            name = await types.meanwhile(find_service(session, service))
            cls: Any = await types.service_class(session, name, type_name, paths)
            events = session.node.create_subscription(cls.Event, f"{name}/_service_event", qos=SERVICES_DEFAULT)
            try:
                await events.wait_for_publishers(_PATIENCE_S)
            except WaitTimeoutError:
                printing.note(
                    f"nobody publishes {name}/_service_event: introspection is off at all servers and clients of "
                    f"{name}; waiting until somebody turns it on (configure_introspection)"
                )
            async for event in events:
                shown = _plain(event, None if full_length else messages.TRUNCATE)
                if as_json:
                    (printing.document if once else printing.json_line)(shown)
                else:
                    printing.block(messages.to_yaml(shown, flow=flow_style) + "---")
                if once:
                    break
        return 0

    return Job(main(), endless=True)


def _plain(event: Message, truncate: int | None) -> dict[str, Any]:
    from rosidl_py_gen.runtime import ServiceEventType
    from rosidl_py_gen.tools import messages

    shown = messages.plain(event, truncate=truncate)
    with suppress(ValueError):  # a peer may send any number
        shown["info"]["event_type"] = ServiceEventType(shown["info"]["event_type"]).name
    return shown
