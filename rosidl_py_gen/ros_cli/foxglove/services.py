"""Services as viewers see them, and calls from there.

Decides that requests and responses are decoded on their way: a wrong request never reaches a robot, and the viewer is
told which field is wrong.
"""

from __future__ import annotations

import asyncio
import re
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.typesupport import referenced_classes
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.ros_cli import ToolError, terminal_output, types
from rosidl_py_gen.ros_cli.foxglove.decoding import Decoder, Worker
from rosidl_py_gen.ros_cli.name_lookup import has_server, is_hidden
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.runtime import Client

_CALL_S = 10.0
_AT_A_TIME = 8
_LINE = "=" * 80 + "\n"
_PART = re.compile(rf"^{_LINE}", re.MULTILINE)
_RESPONSE = re.compile(r"^---[ \t\r]*\n", re.MULTILINE)


class _AdvertisedService:
    """A service that viewers see, or soon will."""

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
    """Keeps what viewers see like what there is: `refresh` after changes of the graph."""

    def __init__(self, session: CommandNode, server: Server, *, paths: Sequence[str], hidden: bool) -> None:
        self._session = session
        self._server = server
        self._paths = paths
        self._hidden = hidden
        self._shown: dict[str, _AdvertisedService] = {}
        self._turns = asyncio.Semaphore(_AT_A_TIME)
        self._decoding = Worker()

    def refresh(self) -> None:
        """Follow the graph."""
        node = self._session.node
        there = {
            name: kinds[0]
            for name, kinds in node.get_service_names_and_types()
            if (self._hidden or not is_hidden(name)) and has_server(node, name)
        }
        gone = {name: shown for name, shown in self._shown.items() if there.get(name) != shown.type_name}
        for name in gone:
            self._shown.pop(name).close()
        if opened := [name for name, shown in gone.items() if shown.is_open]:
            self._server.remove_services(opened)
        for name, type_name in there.items():
            if name not in self._shown:
                shown = self._shown[name] = _AdvertisedService(type_name)
                shown.opening = asyncio.ensure_future(self._open(name, shown))

    async def _open(self, name: str, shown: _AdvertisedService) -> None:
        try:
            split_ros_name(shown.type_name, "srv")
            async with self._turns:
                cls: Any = await types.service_class(self._session, name, shown.type_name, self._paths)
                texts = await asyncio.to_thread(_definitions, cls)
        except InvalidNameError:
            return  # a part of an action
        except RosidlError as error:
            terminal_output.note(
                f"{name}: viewers cannot call it, as there is no definition of {shown.type_name}: {error}"
            )
            return

        decoder = Decoder(cls.Request)

        async def call(data: bytes) -> bytes:
            return await self._call(name, shown, cls, await decoder.run(data, self._decoding, lambda request: request))

        self._server.add_service(name, shown.type_name, texts, call)
        shown.is_open = True

    async def _call(self, name: str, shown: _AdvertisedService, cls: Any, request: Any) -> bytes:
        """Raises `RosidlError`, which the viewer is told."""
        if self._shown.get(name) is not shown:  # nobody would close a client made now
            raise ToolError(f"service {name} has gone")
        if shown.client is None:
            shown.client = self._session.node.create_client(cls, name)
        response = await shown.client.call(request, _CALL_S)
        encoded: bytes = response.encode()
        return encoded

    async def close(self) -> None:
        """Let go of everything."""
        opening = [shown.opening for shown in self._shown.values() if shown.opening is not None]
        for shown in self._shown.values():
            shown.close()
        self._shown.clear()
        self._decoding.close()
        await asyncio.gather(*opening, return_exceptions=True)


def _definitions(cls: Any) -> tuple[str, str]:
    """The definitions of request and response, each with the types it uses."""
    parts = _PART.split(definition_text(cls))
    texts = [*_RESPONSE.split(parts[0], maxsplit=1), ""]
    for index, half in enumerate((cls.Request, cls.Response)):
        used = {name.replace("/msg/", "/") for name in referenced_classes(half)}
        texts[index] += "".join(_LINE + part for part in parts[1:] if part.split("\n", 1)[0].split()[-1] in used)
    return texts[0], texts[1].lstrip("\n")
