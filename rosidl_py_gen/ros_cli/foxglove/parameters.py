"""The parameters of all nodes, as viewers see them: ``/node.parameter``.

Decides that nodes are asked when a viewer first wants to know, and listened to from then on: viewers ask for everything
again and again. A value that a viewer sets takes the type that the parameter has: JSON has one kind of number, and
empty lists of no kind.
"""

from __future__ import annotations

import asyncio
from contextlib import closing
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli.name_lookup import LIST_PARAMETERS, is_hidden_node, nodes_serving
from rosidl_py_gen.runtime import Parameter, ParameterNotDeclaredError, parameter_value

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.runtime import ParameterClient

_ASK_S, _SET_S = 5.0, 5.0
_FIRST_S = 1.5
"""How long the first viewer waits for the nodes; what comes later is in the next answer."""
_AT_A_TIME = 4
_SEPARATOR = "."
"""Names of nodes have none."""


class ParameterBridge:
    """Knows values: `refresh` after changes of the graph; `get` and `set_` for viewers.

    Args:
        changed: called when there is something for `refreshed` to give.
    """

    def __init__(
        self, session: CommandNode, server: Server, changed: Callable[[], object], *, is_read_only: bool
    ) -> None:
        self._session = session
        self._node = session.node
        self._server = server
        self._changed = changed
        self._is_read_only = is_read_only
        self._values: dict[str, dict[str, Any]] = {}
        """Node -> parameter -> value."""
        self._fresh: set[str] = set()
        self._asking: dict[str, asyncio.Task[None]] = {}
        self._turns = asyncio.Semaphore(_AT_A_TIME)
        self._listening: asyncio.Task[None] | None = None
        self._first: asyncio.Task[None] | None = None

    # -------------------------------------------------------------------------------------------------- what they are

    def refresh(self) -> None:
        """Follow the graph: ask nodes that have come, forget those that have gone."""
        if self._listening is None:
            return
        there = set(nodes_serving(self._node, *LIST_PARAMETERS, hidden=True))
        for gone in self._asking.keys() - there:
            self._asking.pop(gone).cancel()
        self._values = {node: values for node, values in self._values.items() if node in there}
        for node in there - self._asking.keys():
            if not is_hidden_node(node):
                self._asking[node] = asyncio.ensure_future(self._ask(node))

    async def _ask(self, node: str) -> None:
        async with self._turns:
            try:
                with closing(self._node.create_parameter_client(node)) as client:
                    names = (await client.list(timeout_s=_ASK_S)).names
                    values = await _values_of(client, names)
            except RosidlError:  # it has just gone, or hangs; whoever wants to know makes us ask again
                self._asking.pop(node, None)
                return
        known = self._values.setdefault(node, {})
        known.update({name: value for name, value in values.items() if name not in known})  # events are newer
        self._tell(node, values)

    async def _listen(self) -> None:
        async for node, _, event in self._node.parameter_events():
            if node not in self._asking:  # it tells all when it is asked; others may say anything
                continue
            known = self._values.setdefault(node, {})
            for parameter in (*event.new, *event.changed):
                known[parameter.name] = parameter.value.value
            for parameter in event.deleted:
                known.pop(parameter.name, None)
            self._tell(node, [one.name for one in (*event.new, *event.changed)])

    def _tell(self, node: str, names: Any) -> None:
        is_first = not self._fresh
        self._fresh.update(f"{node}{_SEPARATOR}{name}" for name in names)
        if is_first and self._fresh:
            self._changed()

    def refreshed(self) -> dict[str, Any]:
        """What has changed since the last time."""
        fresh, self._fresh = self._fresh, set()
        return self._some(fresh)

    def _some(self, names: Any) -> dict[str, Any]:
        found = {}
        for name in names:
            node, _, parameter = name.partition(_SEPARATOR)
            value = self._values.get(node, {}).get(parameter)
            if value is not None:
                found[name] = value
        return found

    # ------------------------------------------------------------------------------------------------- what is wanted

    async def get(self, names: list[str]) -> dict[str, Any]:
        """Values by name, of all parameters when there are no names; what is unset or unknown is left out."""
        if self._first is None:
            self._first = asyncio.ensure_future(self._begin())
        self.refresh()
        await asyncio.shield(self._first)
        every = [f"{node}{_SEPARATOR}{name}" for node, values in self._values.items() for name in values]
        return self._some(names or every)

    async def _begin(self) -> None:
        self._listening = asyncio.ensure_future(self._listen())
        self.refresh()
        if self._asking:
            await asyncio.wait(self._asking.values(), timeout=_FIRST_S)

    async def set_(self, wanted: dict[str, Any]) -> dict[str, Any]:
        """Set parameters; the values they have then, wanted or not."""
        by_node: dict[str, dict[str, Any]] = {}
        for name, value in wanted.items():
            node, _, parameter = name.partition(_SEPARATOR)
            by_node.setdefault(node, {})[parameter] = value
        await self.get([])
        for node, values in by_node.items():
            try:
                await self._set(node, values)
            except RosidlError as error:
                self._server.send_control(node, f"parameters of {node} cannot be set: {error}")
        return self._some(wanted)

    async def _set(self, node: str, values: dict[str, Any]) -> None:
        known = self._values.get(node)
        if known is None or self._is_read_only:
            why = "the server was started with --read-only" if self._is_read_only else "no such node was heard of"
            self._server.send_control(node, f"parameters of {node or '?'} are not set: {why}")
            return
        parameters = [
            Parameter(name, parameter_value(_fitted(value, known.get(name)))) for name, value in values.items()
        ]
        client = self._node.create_parameter_client(node)
        try:
            results = await client.set(parameters, _SET_S)
            known.update(await _values_of(client, [*values]))
        finally:
            client.close()
        for name, result in zip(values, results, strict=False):
            if not result.successful:
                self._server.send_control(f"{node} {name}", f"{node} refuses {name}: {result.reason}")

    async def close(self) -> None:
        """Let go of everything."""
        tasks = [task for task in (self._first, self._listening, *self._asking.values()) if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _values_of(client: ParameterClient, names: Any) -> dict[str, Any]:
    """All values; one by one when a parameter without a value empties the common answer."""
    try:
        return dict(zip(names, await client.get(list(names), _ASK_S), strict=True))
    except ParameterNotDeclaredError:
        values = {}
        for name in names:
            try:
                values[name] = await client.get(name, _ASK_S)
            except ParameterNotDeclaredError:
                continue
        return values


def _fitted(value: Any, before: Any) -> Any:
    """The wanted value with the kind of number, and of an empty list, that there was before."""
    if isinstance(value, bool):
        return value
    if isinstance(before, float) and isinstance(value, int):
        return float(value)
    if isinstance(before, int) and isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(before, tuple) and before and isinstance(value, list):
        return [_fitted(item, before[0]) for item in value]
    return value
