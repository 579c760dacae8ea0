"""``service echo``: the events of ``<service>/_service_event``.

Decides that an event shows its kind by name. Clients and servers publish these when their introspection is on.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime import ServiceEventType, WaitTimeoutError
from rosidl_py_gen.runtime.qos import SERVICES_DEFAULT
from rosidl_py_gen.tools import Job, messages, printing, types
from rosidl_py_gen.tools.commands.service import EchoOptions
from rosidl_py_gen.tools.service.info import find_service
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message

_PATIENCE_S = 1.0
"""Whoever publishes events is discovered together with the service."""


def run(network: Network, options: EchoOptions) -> Job:
    """What the command does."""
    return Job(_echo(network, options), endless=True)


async def _echo(network: Network, options: EchoOptions) -> int:
    async with Session(network) as session:
        name = await types.meanwhile(find_service(session, options.service))
        cls: Any = await types.service_class(session, name, options.type_name, options.paths)
        events = session.node.create_subscription(cls.Event, f"{name}/_service_event", qos=SERVICES_DEFAULT)
        try:
            await events.wait_for_publishers(_PATIENCE_S)
        except WaitTimeoutError:
            printing.note(
                f"nobody publishes {name}/_service_event: introspection is off at all servers and clients of {name}; "
                "waiting until somebody turns it on (configure_introspection)"
            )
        async for event in events:
            shown = _plain(event, None if options.full_length else messages.TRUNCATE)
            if options.as_json:
                (printing.document if options.once else printing.json_line)(shown)
            else:
                printing.block(messages.to_yaml(shown, flow=options.flow_style) + "---")
            if options.once:
                break
    return 0


def _plain(event: Message, truncate: int | None) -> dict[str, Any]:
    shown = messages.plain(event, truncate=truncate)
    with suppress(ValueError):  # a peer may send any number
        shown["info"]["event_type"] = ServiceEventType(shown["info"]["event_type"]).name
    return shown
