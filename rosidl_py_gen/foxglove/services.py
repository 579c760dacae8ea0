"""Services that viewers call, and parameters of all nodes, which viewers see as ``/node.parameter``.

Requests and responses are decoded: an invalid request never reaches a server, and the viewer is sent the name of the
wrong field.

Nodes are queried for parameters at the first request of a viewer. From then on their parameter events are received,
because viewers repeat requests for everything. A value that a viewer sets takes the type of the parameter: JSON has one
type of number, and untyped empty lists.
"""

from __future__ import annotations

import asyncio
import re
from contextlib import closing
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.command_support import CommandError, interface_class, terminal_output
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.foxglove.tasks import Decoder, KeyedTasks, Worker
from rosidl_py_gen.runtime import Parameter, ParameterNotDeclaredError, parameter_value
from rosidl_py_gen.type_loading import definition_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.foxglove.server import Server
    from rosidl_py_gen.runtime import Client, ParameterClient

_CALL_TIMEOUT_S = 10.0
_LINE = "=" * 80 + "\n"
_SECTION = re.compile(rf"^{_LINE}", re.MULTILINE)
_RESPONSE = re.compile(r"^---[ \t\r]*\n", re.MULTILINE)


class ServiceBridge:
    """Bridge that advertises the services of the graph to viewers; call `refresh` after each change of the graph."""

    def __init__(self, command_node: CommandNode, server: Server, *, paths: Sequence[str], hidden: bool) -> None:
        self._command_node = command_node
        self._server = server
        self._paths = paths
        self._hidden = hidden
        self._clients: dict[int, Client[Any, Any] | None] = {}
        """Clients of the advertised services, by the number that viewers use; None before the first call of a service.
        """
        self._tasks = KeyedTasks(self._show)
        self._decoding = Worker()

    def refresh(self) -> None:
        """Advertise new services of the graph to viewers, and withdraw services that have disappeared."""
        self._tasks.update(
            {
                (name, kinds[0])
                for name, kinds in self._command_node.node.get_service_names_and_types()
                if (self._hidden or not self._command_node.is_hidden(name)) and self._command_node.has_server(name)
            }
        )

    async def _show(self, name_and_type: tuple[str, str]) -> None:
        name, type_name = name_and_type
        try:
            RosName.parse(type_name, "srv")
            async with self._tasks.limiter:
                cls: Any = await interface_class(self._command_node, "service", name, type_name, self._paths)
                texts = await asyncio.to_thread(_definitions, cls)
        except InvalidNameError:
            return  # belongs to an action
        except RosidlError as error:
            terminal_output.note(
                f"{name}: viewers cannot call it, because the definition of {type_name} is unknown: {error}"
            )
            return
        decoder = Decoder(cls.Request)

        async def call(data: bytes) -> bytes:
            request = await decoder.run(data, self._decoding, lambda one: one)
            if number not in self._clients:  # a client that is created now would never be closed
                raise CommandError(f"service {name} has disappeared")
            client = self._clients[number] = self._clients[number] or self._command_node.node.create_client(cls, name)
            response = await client.call(request, _CALL_TIMEOUT_S)
            encoded: bytes = response.encode()
            return encoded

        number = self._server.add_service(name, type_name, texts, call)
        self._clients[number] = None
        try:
            await asyncio.Event().wait()  # until the service has disappeared
        finally:
            self._server.remove_service(number)
            if client := self._clients.pop(number):
                client.close()

    async def close(self) -> None:
        """Withdraw all services, and close their clients."""
        self._decoding.close()
        await self._tasks.close()


def _definitions(cls: Any) -> tuple[str, str]:
    parts = _SECTION.split(definition_text(cls))
    texts = [*_RESPONSE.split(parts[0], maxsplit=1), ""]
    for index, half in enumerate((cls.Request, cls.Response)):
        used = {name.replace("/msg/", "/") for name in referenced_classes(half)}
        texts[index] += "".join(_LINE + part for part in parts[1:] if part.split("\n", 1)[0].split()[-1] in used)
    return texts[0], texts[1].lstrip("\n")


_TIMEOUT_S = 5.0
"""Timeout of parameter requests to a node, in seconds."""
_FIRST_REPLY_S = 1.5
"""Maximum time in seconds that the first request of a viewer waits for nodes; values that arrive later are sent as
updates."""
_SEPARATOR = "."
"""Separator between the names of node and parameter in ``/node.parameter``; names of nodes do not contain it."""


class ParameterBridge:
    """Copy of the parameters of all nodes, which viewers read by `get` and change by `set_`.

    Call `refresh` after each change of the graph. The bridge calls `changed` when `refreshed` would return new values.
    """

    def __init__(
        self, command_node: CommandNode, server: Server, changed: Callable[[], object], *, is_read_only: bool
    ) -> None:
        self._command_node = command_node
        self._node = command_node.node
        self._server = server
        self._changed = changed
        self._is_read_only = is_read_only
        self._values: dict[str, dict[str, Any]] = {}
        """Known values of parameters: a dict by full node name, which contains a dict by parameter name."""
        self._changed_names: set[str] = set()
        self._queries = KeyedTasks(self._query, max_concurrent=4)
        self._listening: asyncio.Task[None] | None = None
        self._first: asyncio.Task[None] | None = None

    def refresh(self) -> None:
        """Request the parameters of new nodes, and remove nodes that have disappeared.

        Has no effect before the first `get`.
        """
        if self._listening is None:
            return
        current = set(self._command_node.nodes_with_parameters(hidden=True))
        self._values = {node: values for node, values in self._values.items() if node in current}
        self._queries.update([node for node in current if not self._command_node.is_hidden_node(node)])

    async def _query(self, node: str) -> None:
        async with self._queries.limiter:
            try:
                with closing(self._node.create_parameter_client(node)) as client:
                    names = (await client.list(timeout_s=_TIMEOUT_S)).names
                    values = await _values_of(client, names)
            except RosidlError:  # it has disappeared, or hangs; the next request retries
                self._queries.forget(node)
                return
        known = self._values.setdefault(node, {})
        known.update({name: value for name, value in values.items() if name not in known})  # events are newer
        self._mark_changed(node, values)

    async def _listen(self) -> None:
        async for node, _, event in self._node.parameter_events():
            if node not in self._queries:  # its reply will contain all values
                continue
            known = self._values.setdefault(node, {})
            for parameter in (*event.new, *event.changed):
                known[parameter.name] = parameter.value.value
            for parameter in event.deleted:
                known.pop(parameter.name, None)
            self._mark_changed(node, [one.name for one in (*event.new, *event.changed)])

    def _mark_changed(self, node: str, names: Any) -> None:
        is_first = not self._changed_names
        self._changed_names.update(f"{node}{_SEPARATOR}{name}" for name in names)
        if is_first and self._changed_names:
            self._changed()

    def refreshed(self) -> dict[str, Any]:
        """Return the values of parameters, by ``/node.parameter``, that changed since the last call."""
        names, self._changed_names = self._changed_names, set()
        return self._values_of_names(names)

    def _values_of_names(self, names: Any) -> dict[str, Any]:
        values = {}
        for name in names:
            node, _, parameter = name.partition(_SEPARATOR)
            value = self._values.get(node, {}).get(parameter)
            if value is not None:
                values[name] = value
        return values

    async def get(self, names: list[str]) -> dict[str, Any]:
        """Return values by ``/node.parameter`` (all if `names` is empty), without unset and unknown parameters."""
        if self._first is None:
            self._first = asyncio.ensure_future(self._begin())
        self.refresh()
        await asyncio.shield(self._first)
        every = [f"{node}{_SEPARATOR}{name}" for node, values in self._values.items() for name in values]
        return self._values_of_names(names or every)

    async def _begin(self) -> None:
        self._listening = asyncio.ensure_future(self._listen())
        self.refresh()
        await self._queries.wait(_FIRST_REPLY_S)

    async def set_(self, requested: dict[str, Any]) -> dict[str, Any]:
        """Set parameters by ``/node.parameter``, and return their values afterwards.

        Failures are sent to the viewers.
        """
        by_node: dict[str, dict[str, Any]] = {}
        for name, value in requested.items():
            node, _, parameter = name.partition(_SEPARATOR)
            by_node.setdefault(node, {})[parameter] = value
        await self.get([])
        for node, values in by_node.items():
            try:
                await self._set(node, values)
            except RosidlError as error:
                self._server.send_control(node, f"parameters of {node} cannot be set: {error}")
        return self._values_of_names(requested)

    async def _set(self, node: str, values: dict[str, Any]) -> None:
        known = self._values.get(node)
        if known is None or self._is_read_only:
            why = "the server was started with --read-only" if self._is_read_only else "the node is unknown"
            self._server.send_control(node, f"parameters of {node or '?'} are not set: {why}")
            return
        parameters = [
            Parameter(name, parameter_value(_with_type_of(value, known.get(name)))) for name, value in values.items()
        ]
        client = self._node.create_parameter_client(node)
        try:
            results = await client.set(parameters, _TIMEOUT_S)
            known.update(await _values_of(client, [*values]))
        finally:
            client.close()
        for name, result in zip(values, results, strict=False):
            if not result.successful:
                self._server.send_control(f"{node} {name}", f"{node} rejected {name}: {result.reason}")

    async def close(self) -> None:
        """Cancel all requests to nodes, and stop receiving parameter events."""
        await self._queries.close()
        tasks = [task for task in (self._first, self._listening) if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _values_of(client: ParameterClient, names: Any) -> dict[str, Any]:
    """Return the values of parameters of a node by name, without unset ones.

    If one of them is unset, the parameters are requested one by one.
    """
    try:
        return dict(zip(names, await client.get(list(names), _TIMEOUT_S), strict=True))
    except ParameterNotDeclaredError:
        values = {}
        for name in names:
            try:
                values[name] = await client.get(name, _TIMEOUT_S)
            except ParameterNotDeclaredError:
                continue
        return values


def _with_type_of(value: Any, previous: Any) -> Any:
    """Convert numbers in a JSON value to int or float, according to the previous value of the parameter."""
    if isinstance(value, bool):
        return value
    if isinstance(previous, float) and isinstance(value, int):
        return float(value)
    if isinstance(previous, int) and isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(previous, tuple) and previous and isinstance(value, list):
        return [_with_type_of(item, previous[0]) for item in value]
    return value
