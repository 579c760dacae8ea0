"""Services as viewers see them, and their calls.

Requests and responses are decoded: an invalid request never reaches a server, and the viewer is sent the wrong field.
"""

from __future__ import annotations

import asyncio
import re
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.ros_cli import CommandError, terminal_output, type_resolution
from rosidl_py_gen.ros_cli.foxglove.decoding import Decoder, Worker
from rosidl_py_gen.ros_cli.name_lookup import has_server, is_hidden
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.runtime import Client

_CALL_TIMEOUT_S = 10.0
_MAX_CONCURRENT = 8
_LINE = "=" * 80 + "\n"
_SECTION = re.compile(rf"^{_LINE}", re.MULTILINE)
_RESPONSE = re.compile(r"^---[ \t\r]*\n", re.MULTILINE)


class _AdvertisedService:
    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self.opening: asyncio.Task[None] | None = None
        self.is_open = False
        self.client: Client[Any, Any] | None = None

    def close(self) -> None:
        if self.opening is not None:
            self.opening.cancel()
        if self.client is not None:
            self.client.close()


class ServiceBridge:
    """Advertises the services of the graph: `refresh` is called after changes."""

    def __init__(self, command_node: CommandNode, server: Server, *, paths: Sequence[str], hidden: bool) -> None:
        self._command_node = command_node
        self._server = server
        self._paths = paths
        self._hidden = hidden
        self._services: dict[str, _AdvertisedService] = {}
        self._limiter = asyncio.Semaphore(_MAX_CONCURRENT)
        self._decoding = Worker()

    def refresh(self) -> None:
        """Advertise new services, and withdraw those that have disappeared."""
        node = self._command_node.node
        current = {
            name: kinds[0]
            for name, kinds in node.get_service_names_and_types()
            if (self._hidden or not is_hidden(name)) and has_server(node, name)
        }
        withdrawn = {name: one for name, one in self._services.items() if current.get(name) != one.type_name}
        for name in withdrawn:
            self._services.pop(name).close()
        if opened := [name for name, service in withdrawn.items() if service.is_open]:
            self._server.remove_services(opened)
        for name, type_name in current.items():
            if name not in self._services:
                service = self._services[name] = _AdvertisedService(type_name)
                service.opening = asyncio.ensure_future(self._open(name, service))

    async def _open(self, name: str, service: _AdvertisedService) -> None:
        try:
            split_ros_name(service.type_name, "srv")
            async with self._limiter:
                cls: Any = await type_resolution.interface_class(
                    self._command_node, "service", name, service.type_name, self._paths
                )
                texts = await asyncio.to_thread(_definitions, cls)
        except InvalidNameError:
            return  # belongs to an action
        except RosidlError as error:
            terminal_output.note(
                f"{name}: viewers cannot call it, because the definition of {service.type_name} is unknown: {error}"
            )
            return

        decoder = Decoder(cls.Request)

        async def call(data: bytes) -> bytes:
            return await self._call(name, service, cls, await decoder.run(data, self._decoding, lambda one: one))

        self._server.add_service(name, service.type_name, texts, call)
        service.is_open = True

    async def _call(self, name: str, service: _AdvertisedService, cls: Any, request: Any) -> bytes:
        if self._services.get(name) is not service:  # a client that is created now would never be closed
            raise CommandError(f"service {name} has disappeared")
        if service.client is None:
            service.client = self._command_node.node.create_client(cls, name)
        response = await service.client.call(request, _CALL_TIMEOUT_S)
        encoded: bytes = response.encode()
        return encoded

    async def close(self) -> None:
        """Close all clients."""
        opening = [service.opening for service in self._services.values() if service.opening is not None]
        for service in self._services.values():
            service.close()
        self._services.clear()
        self._decoding.close()
        await asyncio.gather(*opening, return_exceptions=True)


def _definitions(cls: Any) -> tuple[str, str]:
    parts = _SECTION.split(definition_text(cls))
    texts = [*_RESPONSE.split(parts[0], maxsplit=1), ""]
    for index, half in enumerate((cls.Request, cls.Response)):
        used = {name.replace("/msg/", "/") for name in referenced_classes(half)}
        texts[index] += "".join(_LINE + part for part in parts[1:] if part.split("\n", 1)[0].split()[-1] in used)
    return texts[0], texts[1].lstrip("\n")
