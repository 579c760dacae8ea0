"""Access of commands to the parameters of a node."""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.command_node import CommandNode
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

    from rosidl_py_gen.ros_cli.options import NetworkOptions
    from rosidl_py_gen.runtime import ParameterClient


@asynccontextmanager
async def parameters_of(network: NetworkOptions, node: str, timeout_s: float) -> AsyncIterator[ParameterClient]:
    """Yield a client for the parameters of a node; requests are sent before the causes of errors are known.

    Raises:
        CommandError: the node does not exist, serves no parameters, does not reply in time, or has no such parameter.
    """
    async with CommandNode(network) as command_node:
        client = command_node.node.create_parameter_client(node if node.startswith("/") else f"/{node}")
        try:
            await client.wait_for_services(timeout_s)
        except WaitTimeoutError:
            await find_node(command_node, node, 0)
            text = f"node {client.node} exists, but offered no parameter services in {timeout_s:g} s"
            raise CommandError(text) from None
        try:
            yield client
        except (CallTimeoutError, ServerLostError) as error:
            raise CommandError(f"node {client.node}: {error}") from None
        except ParameterNotDeclaredError as error:
            raise CommandError(await _missing_parameters_text(client, error.names, timeout_s)) from None


async def _missing_parameters_text(client: ParameterClient, requested: tuple[str, ...], timeout_s: float) -> str:
    known = (await client.list(timeout_s=timeout_s)).names
    unknown = [name for name in requested if name not in known]
    if not unknown:
        return f"{client.node} has {', '.join(requested)}, but at least one of them has no value"
    return f"{client.node} has no parameter {', '.join(unknown)}{did_you_mean(unknown[0], known)}"


def type_text(kind: ParameterType) -> str:
    """Return the name of a parameter type in ``ros2 param``, such as ``boolean array``."""
    return kind.name.lower().replace("_", " ").replace("bool", "boolean")


def plain_parameter(value: Any) -> Any:
    """Return the value of a parameter; arrays become lists."""
    return list(value) if isinstance(value, tuple | bytes) else value
