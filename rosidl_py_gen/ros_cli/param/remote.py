"""The parameters of another node, as the commands of ``param`` ask for them; and the words for types.

Decides that the node is asked as soon as it can be, and that what went wrong is found out afterwards.
"""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
from rosidl_py_gen.ros_cli.name_lookup import find_node
from rosidl_py_gen.runtime import (
    CallTimeoutError,
    ParameterNotDeclaredError,
    ParameterType,
    ServerLostError,
    WaitTimeoutError,
)

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rosidl_py_gen.runtime import ParameterClient

_WORDS = {"BOOL": "boolean", "BOOL_ARRAY": "boolean array"}


@asynccontextmanager
async def parameters_of(network: NetworkOptions, node: str, timeout_s: float) -> AsyncIterator[ParameterClient]:
    """A client for the parameters of a node that is there.

    Raises:
        ToolError: there is no such node, it serves no parameters, does not answer in time, or does not have what it was
            asked for, where another one looks alike.
    """
    async with CommandNode(network) as session:
        client = session.node.create_parameter_client(node if node.startswith("/") else f"/{node}")
        try:
            await client.wait_for_services(timeout_s)
        except WaitTimeoutError:
            await find_node(session, node, 0)
            text = f"node {client.node} is there, but offered no parameter services in {timeout_s:g} s"
            raise ToolError(text) from None
        try:
            yield client
        except (CallTimeoutError, ServerLostError) as error:
            raise ToolError(f"node {client.node}: {error}") from None
        except ParameterNotDeclaredError as error:
            raise ToolError(await _missing(client, error.names, timeout_s)) from None


async def _missing(client: ParameterClient, wanted: tuple[str, ...], timeout_s: float) -> str:
    """Which of the names is unknown, and what may have been meant."""
    known = (await client.list(timeout_s=timeout_s)).names
    unknown = [name for name in wanted if name not in known]
    if not unknown:
        return f"{client.node} has {', '.join(wanted)}, but at least one of them has no value"
    return f"{client.node} has no parameter {', '.join(unknown)}{did_you_mean(unknown[0], known)}"


def type_in_words(kind: ParameterType) -> str:
    """A type in the words of ``ros2 param``: ``boolean array``."""
    return _WORDS.get(kind.name, kind.name.lower().replace("_", " "))
