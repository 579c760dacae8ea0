"""Services of the graph, which are advertised to viewers so that viewers can call them.

Requests and responses are decoded: an invalid request never reaches a server, and the viewer is sent the name of the
wrong field.
"""

from __future__ import annotations

import asyncio
import re
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.ros_cli import terminal_output, type_resolution
from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.foxglove.decoding import Decoder, Worker
from rosidl_py_gen.ros_cli.foxglove.keyed_tasks import KeyedTasks
from rosidl_py_gen.ros_cli.name_lookup import has_server, is_hidden
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.runtime import Client

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
        node = self._command_node.node
        self._tasks.update(
            {
                (name, kinds[0])
                for name, kinds in node.get_service_names_and_types()
                if (self._hidden or not is_hidden(name)) and has_server(node, name)
            }
        )

    async def _show(self, name_and_type: tuple[str, str]) -> None:
        name, type_name = name_and_type
        try:
            split_ros_name(type_name, "srv")
            async with self._tasks.limiter:
                cls: Any = await type_resolution.interface_class(
                    self._command_node, "service", name, type_name, self._paths
                )
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
