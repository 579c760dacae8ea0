"""Access of commands to the lifecycle services of a node.

A node is a lifecycle node if it serves ``~/get_state`` of the type in lifecycle_msgs.
"""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.command_node import CommandNode
from rosidl_py_gen.ros_cli.name_lookup import find_node, nodes_serving
from rosidl_py_gen.runtime import CallTimeoutError, ServerLostError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.msgs.lifecycle_msgs.msg import State, Transition, TransitionDescription
    from rosidl_py_gen.ros_cli.options import NetworkOptions
    from rosidl_py_gen.runtime import Node

_IDENTIFYING_SERVICE = "/get_state"


def lifecycle_nodes(node: Node, *, hidden: bool) -> list[str]:
    """Return the sorted full names of the lifecycle nodes in the graph."""
    return nodes_serving(node, _IDENTIFYING_SERVICE, "lifecycle_msgs/srv/GetState", hidden=hidden)


class LifecycleAccess:
    """Lifecycle services of one node. Requests raise `CallTimeoutError` or `ServerLostError`."""

    def __init__(self, node: Node, name: str, timeout_s: float) -> None:
        self.name = name
        self._node = node
        self._timeout_s = timeout_s

    async def state(self) -> State:
        """Request the current state."""
        state: State = (await self._call(GetState, "get_state")).current_state
        return state

    async def transitions(self, *, every: bool = False) -> list[TransitionDescription]:
        """Request the transitions of the current state, or of every state."""
        service = "get_transition_graph" if every else "get_available_transitions"
        response = await self._call(GetAvailableTransitions, service)
        transitions: list[TransitionDescription] = response.available_transitions
        return transitions

    async def change(self, transition: Transition) -> bool:
        """Request a transition; returns True if it succeeded."""
        response = await self._call(ChangeState, "change_state", ChangeState.Request(transition=transition))
        return bool(response.success)

    async def _call(self, cls: Any, service: str, request: Message | None = None) -> Any:
        client = self._node.create_client(cls, f"{self.name}/{service}")
        try:
            return await client.call(request or cls.Request(), self._timeout_s)
        finally:
            client.close()


@asynccontextmanager
async def lifecycle_of(network: NetworkOptions, node: str, timeout_s: float) -> AsyncIterator[LifecycleAccess]:
    """Wait for a lifecycle node and yield the access to its services.

    Raises:
        CommandError: the node does not exist, is not a lifecycle node, or does not reply in time.
    """
    async with CommandNode(network) as command_node:
        name = await find_node(command_node, node, timeout_s)
        if not await command_node.wait_for(lambda: name in lifecycle_nodes(command_node.node, hidden=True), timeout_s):
            raise CommandError(f"{name} is not a lifecycle node: it does not serve {name}{_IDENTIFYING_SERVICE}")
        try:
            yield LifecycleAccess(command_node.node, name, timeout_s)
        except (CallTimeoutError, ServerLostError) as error:
            raise CommandError(f"node {name} does not reply: {error}") from None
