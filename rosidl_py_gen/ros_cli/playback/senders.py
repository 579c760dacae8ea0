"""Publishers of recorded topics, and clients that send the requests in recorded service events.

The user may set the QoS of a publisher; otherwise the QoS is the strongest that was offered when the bag was recorded,
which connects to the same subscriptions. A topic with messages of two definitions has a publisher for each.

A request is sent once, although both client and server may have published an event: only events of one side are used.
Responses are awaited at the end only, so that requests keep their recorded timing.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition, get_service, type_hash
from rosidl_py_gen.bags import OfferedQoS
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.cdr import Service
from rosidl_py_gen.cdr.message import opaque_message_class
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import DecodeError, EncodeError, RosidlError
from rosidl_py_gen.ros_cli.bag.reading import guess_mismatch
from rosidl_py_gen.runtime import (
    Durability,
    QoSProfile,
    Reliability,
    ServiceEventType,
    WaitTimeoutError,
    validate_full_name,
)

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence

    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Client, Node, Publisher


_MIN_DEPTH = 10
_ACKNOWLEDGEMENT_TIMEOUT_S = 5.0


def cannot_play_reason(channel: BagTopic) -> str:
    """Return why messages of a recorded channel cannot be published; "" if they can."""
    if channel.message_encoding != "cdr":
        return f"messages are {channel.message_encoding}; expected cdr"
    try:
        validate_full_name(channel.name)
        RosName.parse(channel.type_name, "msg")
    except RosidlError as error:
        return str(error)
    return ""


class TopicPublishers:
    """Publishers of a player; QoS overrides are found by the recorded topic or by the name it is published under."""

    def __init__(self, node: Node, overrides: Mapping[str, QoSProfile], note: terminal_output.OnceNotes) -> None:
        self._node = node
        self._overrides = overrides
        self._note = note
        self._publishers: list[Publisher[Any]] = []

    def sender(self, reader: BagReader, channel: BagTopic, name: str) -> Callable[[bytes], bool]:
        """Create a publisher; return a function that publishes a message of a channel and returns True on success."""
        qos = self._overrides.get(channel.name) or self._overrides.get(name) or _offered_qos(channel)
        publisher = self._node.create_publisher(_class_of(reader, channel), name, qos)
        self._publishers.append(publisher)

        def send(data: bytes) -> bool:
            try:
                publisher.publish_raw(data)
            except EncodeError as reason:  # big endian, as recorded by other systems
                try:
                    publisher.publish(reader.definition(channel).message_class.decode(data))
                except (DecodeError, RosidlError):
                    self._note(f"{channel.name}: skipped a message: {reason}")
                    return False
            return True

        return send

    async def wait_for_subscribers(self, timeout_s: float) -> None:
        """Wait until every topic has a subscriber, or the timeout has passed."""
        await wait_each_until_timeout(publisher.wait_for_subscribers(timeout_s) for publisher in self._publishers)

    async def wait_acknowledged(self, timeout_ms: int | None) -> None:
        """Wait until subscribers have acknowledged all messages; a timeout of None is 5 s, of 0 no limit.

        Missing acknowledgements are noted unless `timeout_ms` is None.
        """
        timeout_s = _ACKNOWLEDGEMENT_TIMEOUT_S if timeout_ms is None else timeout_ms / 1000 or None
        waits = [publisher.wait_for_acknowledged(timeout_s) for publisher in self._publishers]
        notes: list[object] = [
            f"{publisher.topic} is best effort, without acknowledgements"
            for publisher in self._publishers
            if publisher.qos.reliability is Reliability.BEST_EFFORT
        ]
        notes += await wait_each_until_timeout(waits)
        for text in notes if timeout_ms is not None else ():
            terminal_output.note(f"--wait-for-all-acked: {text}")


async def wait_each_until_timeout(waits: Iterable[Awaitable[object]]) -> list[WaitTimeoutError]:
    """Wait for all awaitables; return the errors of the awaitables that timed out."""
    timed_out = []
    for outcome in await asyncio.gather(*waits, return_exceptions=True):
        if isinstance(outcome, WaitTimeoutError):
            timed_out.append(outcome)
        elif isinstance(outcome, BaseException):
            raise outcome
    return timed_out


def _class_of(reader: BagReader, channel: BagTopic) -> type[Message]:
    """Return the message class of a channel; a class without fields if the definition is missing or does not fit."""
    try:
        known = reader.definition(channel)
    except RosidlError:  # there is none
        return opaque_message_class(channel.type_name, channel.type_hash)
    if reason := guess_mismatch(reader, channel, known):
        terminal_output.note(reason)
        return opaque_message_class(channel.type_name, channel.type_hash)
    return known.message_class


def _offered_qos(topic: BagTopic) -> QoSProfile:
    """Return the strongest recorded QoS of a topic, with a depth of at least 10, as recorders often omit the depth."""
    offered = OfferedQoS.parse(topic.offered_qos)
    profile = QoSProfile(depth=max(_MIN_DEPTH, *(publisher.depth for publisher in offered)) if offered else _MIN_DEPTH)
    if offered and all(publisher.reliability is Reliability.BEST_EFFORT for publisher in offered):
        profile = profile.best_effort()
    if any(publisher.durability is Durability.TRANSIENT_LOCAL for publisher in offered):
        profile = profile.transient_local()
    return profile


_EVENT_TYPES = {
    "service_introspection": ServiceEventType.REQUEST_RECEIVED,
    "client_introspection": ServiceEventType.REQUEST_SENT,
}
_RESPONSE_TIMEOUT_S = 5.0
"""Maximum time to wait for responses at the end of playback, in seconds."""
_CALL_TIMEOUT_S = 300.0
_MAX_PENDING = 1000


class Requests:
    """Clients of a player, which send the requests in recorded service events.

    Args:
        source: side whose events are used, ``service_introspection`` or ``client_introspection``.
    """

    def __init__(self, node: Node, source: str, paths: Sequence[str], note: terminal_output.OnceNotes) -> None:
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
        """Create a client of a service, and return a function that sends the request in an event.

        It returns True if a request was sent.
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
                self._note(f"{channel.name}: skipped an event: {error}")
                return False
            return told.info.event_type == self._event_type and self._send(client, channel, told.request)

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
        """Wait at most 5 s for responses in flight, then note how many are missing and cancel the calls."""
        if self._pending:
            await asyncio.wait(self._pending, timeout=_RESPONSE_TIMEOUT_S)
        if self._pending:
            self._note(f"{pluralize(len(self._pending), 'request')} had no response in {_RESPONSE_TIMEOUT_S:.0f} s")
        for task in self._pending:
            task.cancel()
