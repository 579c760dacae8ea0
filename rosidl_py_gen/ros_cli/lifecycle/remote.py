"""Lifecycle nodes as the commands of ``lifecycle`` see them: by their services, which are called here.

A node is one when it serves ``~/get_state`` of the type that lifecycle_msgs defines.
"""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
from rosidl_py_gen.ros_cli.name_lookup import find_node, nodes_serving
from rosidl_py_gen.runtime import CallTimeoutError, ServerLostError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.msgs.lifecycle_msgs.msg import State, Transition, TransitionDescription
    from rosidl_py_gen.runtime import Node

_MARK, _TYPE = "/get_state", "lifecycle_msgs/srv/GetState"


def lifecycle_nodes(node: Node, *, hidden: bool) -> list[str]:
    """Full names, sorted."""
    return nodes_serving(node, _MARK, _TYPE, hidden=hidden)


class RemoteLifecycle:
    """One lifecycle node. Everything that asks raises `CallTimeoutError` or `ServerLostError`."""

    def __init__(self, node: Node, name: str, timeout_s: float) -> None:
        self.name = name
        self._node = node
        self._timeout_s = timeout_s

    async def state(self) -> State:
        """The state it has."""
        state: State = (await self._ask(GetState, "get_state")).current_state
        return state

    async def transitions(self, *, every: bool = False) -> list[TransitionDescription]:
        """The transitions that are possible now; `every`: those that exist."""
        service = "get_transition_graph" if every else "get_available_transitions"
        found: list[TransitionDescription] = (await self._ask(GetAvailableTransitions, service)).available_transitions
        return found

    async def change(self, transition: Transition) -> bool:
        """Whether it worked."""
        return bool((await self._ask(ChangeState, "change_state", ChangeState.Request(transition=transition))).success)

    async def _ask(self, cls: Any, service: str, request: Message | None = None) -> Any:
        client = self._node.create_client(cls, f"{self.name}/{service}")
        try:
            return await client.call(request or cls.Request(), self._timeout_s)
        finally:
            client.close()


@asynccontextmanager
async def lifecycle_of(network: NetworkOptions, node: str, timeout_s: float) -> AsyncIterator[RemoteLifecycle]:
    """A lifecycle node that is there.

    Raises:
        ToolError: there is no such node, it is no lifecycle node, or it does not answer in time.
    """
    async with CommandNode(network) as session:
        name = await find_node(session, node, timeout_s)
        if not await session.wait_for(lambda: name in lifecycle_nodes(session.node, hidden=True), timeout_s):
            raise ToolError(f"{name} is no lifecycle node: it serves no {name}{_MARK}")
        try:
            yield RemoteLifecycle(session.node, name, timeout_s)
        except (CallTimeoutError, ServerLostError) as error:
            raise ToolError(f"node {name} does not answer: {error}") from None
