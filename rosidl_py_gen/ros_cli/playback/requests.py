"""Requests to services, of what their introspection published when it was recorded.

Decides that a request is sent once, though client and server may both have told of it: what one of them told is taken.
Responses are waited for at the end only, so that requests come as far apart as then.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition, get_service, type_hash
from rosidl_py_gen.cdr import Service
from rosidl_py_gen.errors import DecodeError, RosidlError
from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.ros_cli.playback.senders import wait_each_until_timeout
from rosidl_py_gen.runtime import ServiceEventType

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.ros_cli.playback.senders import OnceNotes
    from rosidl_py_gen.runtime import Client, Node

_EVENT_TYPES = {
    "service_introspection": ServiceEventType.REQUEST_RECEIVED,
    "client_introspection": ServiceEventType.REQUEST_SENT,
}
_ANSWERED_S = 5.0
"""How long responses are waited for when everything was sent."""
_MAX_RESPONSE_WAIT_S = 300.0
_MAX_PENDING = 1000


class Requests:
    """The clients of a player.

    Args:
        source: whose events are taken, ``service_introspection`` or ``client_introspection``.
        paths: folders with definitions, for bags that do not have them.
    """

    def __init__(self, node: Node, source: str, paths: Sequence[str], note: OnceNotes) -> None:
        self._node = node
        self._source = source
        self._taken = _EVENT_TYPES[source]
        self._paths = paths
        self._note = note
        self._clients: dict[tuple[str, str], Client[Any, Any]] = {}
        self._pending: set[asyncio.Task[None]] = set()
        self.count = 0
        """Requests that were sent."""

    def sender(self, reader: BagReader, channel: BagTopic, service: str) -> Callable[[bytes], bool]:
        """What sends the request of an event of this channel to a service; it answers whether there was one to send.

        Raises:
            ToolError: the definition of the service is known nowhere.
        """
        cls, event = self._classes(reader, channel)
        key = service, type_hash(event)
        if key not in self._clients:
            self._clients[key] = self._node.create_client(cls, service)
        client = self._clients[key]

        def send(data: bytes) -> bool:
            try:
                told: Any = event.decode(data)
            except DecodeError as error:
                self._note(f"{channel.name}: left out an event: {error}")
                return False
            return told.info.event_type == self._taken and self._send(client, channel, told.request)

        return send

    def _classes(self, reader: BagReader, channel: BagTopic) -> tuple[type[Any], type[Any]]:
        """The service, and its event as it was recorded."""
        name = channel.type_name.removesuffix("_Event")
        advice = "--path gives the folder with its definition"
        try:
            event = reader.definition(channel).message_class
        except RosidlError as error:
            raise ToolError(f"requests to {channel.name} cannot be sent: {error}; {advice}") from None
        for find in (lambda: compile_definition(name, channel.definition), lambda: get_service(name, path=self._paths)):
            try:
                cls: Any = find()
            except RosidlError:
                continue
            if issubclass(cls, Service) and type_hash(cls.Event) == type_hash(event):
                return cls, event
        raise ToolError(f"requests to {channel.name} cannot be sent: {name} is not known as it was then; {advice}")

    def _send(self, client: Client[Any, Any], channel: BagTopic, requests: Sequence[Any]) -> bool:
        if not requests:
            self._note(f"{channel.name}: its {self._source} kept no contents, so that there is nothing to send")
        elif not client.service_is_available():
            self._note(f"{client.name}: no server is there, requests to it are left out")
        elif len(self._pending) >= _MAX_PENDING:
            self._note(f"{client.name}: {_MAX_PENDING} requests have no response yet, further ones are left out")
        else:
            task = asyncio.ensure_future(self._call(client, requests[0]))
            self._pending.add(task)
            task.add_done_callback(self._pending.discard)
            self.count += 1
            return True
        return False

    async def _call(self, client: Client[Any, Any], request: Any) -> None:
        try:
            await client.call(request, timeout_s=_MAX_RESPONSE_WAIT_S)
        except RosidlError as error:
            self._note(f"{client.name}: {error}")

    async def wait_for_servers(self, timeout_s: float) -> None:
        """Wait until every service is there, or the time has passed."""
        await wait_each_until_timeout(one.wait_for_service(timeout_s) for one in self._clients.values())

    async def wait_for_responses(self) -> None:
        """Wait for responses, five seconds at most, and say how many are missing."""
        if self._pending:
            await asyncio.wait(self._pending, timeout=_ANSWERED_S)
        if self._pending:
            self._note(f"{len(self._pending)} requests had no response in {_ANSWERED_S:.0f} s")
        for task in self._pending:
            task.cancel()
