"""Requests to services, from recorded service events.

A request is sent once, although both client and server may have published its event: only events of one side are used.
Responses are awaited at the end only, so that requests keep their recorded timing.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition, get_service, type_hash
from rosidl_py_gen.cdr import Service
from rosidl_py_gen.errors import DecodeError, RosidlError
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.playback.publishers import wait_each_until_timeout
from rosidl_py_gen.runtime import ServiceEventType

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.ros_cli.terminal_output import OnceNotes
    from rosidl_py_gen.runtime import Client, Node

_EVENT_TYPES = {
    "service_introspection": ServiceEventType.REQUEST_RECEIVED,
    "client_introspection": ServiceEventType.REQUEST_SENT,
}
_RESPONSE_TIMEOUT_S = 5.0
"""Maximum time to wait for responses after the last request."""
_CALL_TIMEOUT_S = 300.0
_MAX_PENDING = 1000


class Requests:
    """Clients of a player.

    Args:
        source: side whose events are used, ``service_introspection`` or ``client_introspection``.
        paths: folders with definitions, for bags without them.
    """

    def __init__(self, node: Node, source: str, paths: Sequence[str], note: OnceNotes) -> None:
        self._node = node
        self._source = source
        self._event_type = _EVENT_TYPES[source]
        self._paths = paths
        self._note = note
        self._clients: dict[tuple[str, str], Client[Any, Any]] = {}
        self._pending: set[asyncio.Task[None]] = set()
        self.count = 0
        """Number of requests sent."""

    def sender(self, reader: BagReader, channel: BagTopic, service: str) -> Callable[[bytes], bool]:
        """Return a function that sends the request in an event of a channel, and returns True if it did.

        Raises:
            CommandError: the definition of the service is unknown.
        """
        cls, event = self._classes(reader, channel)
        key = service, type_hash(event)
        if key not in self._clients:
            self._clients[key] = self._node.create_client(cls, service)
        client = self._clients[key]

        def send(data: bytes) -> bool:
            try:
                event_message: Any = event.decode(data)
            except DecodeError as error:
                self._note(f"{channel.name}: skipped an event: {error}")
                return False
            return event_message.info.event_type == self._event_type and self._send(
                client, channel, event_message.request
            )

        return send

    def _classes(self, reader: BagReader, channel: BagTopic) -> tuple[type[Any], type[Any]]:
        name = channel.type_name.removesuffix("_Event")
        advice = "pass the folder of its definition with --path"
        try:
            event = reader.definition(channel).message_class
        except RosidlError as error:
            raise CommandError(f"requests to {channel.name} cannot be sent: {error}; {advice}") from None
        for find in (lambda: compile_definition(name, channel.definition), lambda: get_service(name, path=self._paths)):
            try:
                cls: Any = find()
            except RosidlError:
                continue
            if issubclass(cls, Service) and type_hash(cls.Event) == type_hash(event):
                return cls, event
        raise CommandError(
            f"requests to {channel.name} cannot be sent: no definition of {name} matches the recording; {advice}"
        )

    def _send(self, client: Client[Any, Any], channel: BagTopic, requests: Sequence[Any]) -> bool:
        if not requests:
            self._note(
                f"{channel.name}: {self._source} events were recorded without request contents; no request is sent"
            )
        elif not client.service_is_available():
            self._note(f"{client.name}: no server exists; requests are skipped")
        elif len(self._pending) >= _MAX_PENDING:
            self._note(f"{client.name}: {_MAX_PENDING} requests have no response yet; further ones are skipped")
        else:
            task = asyncio.ensure_future(self._call(client, requests[0]))
            self._pending.add(task)
            task.add_done_callback(self._pending.discard)
            self.count += 1
            return True
        return False

    async def _call(self, client: Client[Any, Any], request: Any) -> None:
        try:
            await client.call(request, timeout_s=_CALL_TIMEOUT_S)
        except RosidlError as error:
            self._note(f"{client.name}: {error}")

    async def wait_for_servers(self, timeout_s: float) -> None:
        """Wait until every service has a server, or the timeout has passed."""
        await wait_each_until_timeout(client.wait_for_service(timeout_s) for client in self._clients.values())

    async def wait_for_responses(self) -> None:
        """Wait for responses, and note how many are missing."""
        if self._pending:
            await asyncio.wait(self._pending, timeout=_RESPONSE_TIMEOUT_S)
        if self._pending:
            self._note(f"{len(self._pending)} requests had no response in {_RESPONSE_TIMEOUT_S:.0f} s")
        for task in self._pending:
            task.cancel()
