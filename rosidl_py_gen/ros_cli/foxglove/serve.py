"""``foxglove``: a run from options to closing; viewers may connect before discovery is complete."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions, first_of
from rosidl_py_gen.ros_cli.foxglove.access import Access
from rosidl_py_gen.ros_cli.foxglove.clock import TOPIC as CLOCK
from rosidl_py_gen.ros_cli.foxglove.clock import ViewerClock
from rosidl_py_gen.ros_cli.foxglove.connections import ConnectionGraph
from rosidl_py_gen.ros_cli.foxglove.parameters import ParameterBridge
from rosidl_py_gen.ros_cli.foxglove.publishing import ClientPublishing
from rosidl_py_gen.ros_cli.foxglove.server import Listening, Server
from rosidl_py_gen.ros_cli.foxglove.services import ServiceBridge
from rosidl_py_gen.ros_cli.foxglove.topics import TopicBridge
from rosidl_py_gen.ros_cli.foxglove.viewer import Handlers

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.foxglove.command import FoxgloveOptions

_APP = "https://app.foxglove.dev"
_UPDATE_INTERVAL_S = 0.1
"""Minimum interval between two updates of a graph that keeps changing."""
_VIEWERS_INTERVAL_S = 0.01
"""Minimum interval between two updates of subscriptions, which take time for each topic."""


async def serve(network: NetworkOptions, options: FoxgloveOptions) -> None:
    """Serve viewers until cancelled."""
    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        view = _View(command_node, options)
        try:
            await view.show()
        finally:
            await view.close()


class _View:
    def __init__(self, command_node: CommandNode, options: FoxgloveOptions) -> None:
        self._options = options
        self._node = command_node.node
        self._clock = ViewerClock()
        self._server = server = Server(Access(options.origins, options.token))
        self._parameters_changed = asyncio.Event()
        self._viewers_changed = asyncio.Event()  # or their subscriptions
        self._has_clock = self._has_noted_clock = False
        settings: dict[str, Any] = {"paths": options.paths, "hidden": options.hidden}
        self._topics = TopicBridge(command_node, server, self._clock, **settings)
        self._services = ServiceBridge(command_node, server, **settings)
        self._publishing = ClientPublishing(command_node, server, paths=options.paths)
        self._parameters = ParameterBridge(
            command_node, server, self._parameters_changed.set, is_read_only=options.is_read_only
        )
        self._connections = ConnectionGraph(command_node.node, server, hidden=options.hidden)

    async def show(self) -> None:
        options = self._options
        self._has_clock = options.use_sim_time or self._node.count_publishers(CLOCK) > 0
        handlers = Handlers(
            self._viewers_changed.set, self._publishing.publish_from_viewer, self._parameters.get, self._parameters.set_
        )
        listening = Listening(
            *(options.host, options.port, options.queue, options.max_mib << 20, options.per_s),
            *(self._has_clock, options.is_read_only),
        )
        port = await self._server.start(listening, handlers)
        if self._has_clock:
            self._clock.follow(self._node, self._server)
        self._print_address(port)
        await first_of(self._follow(), self._follow_viewers(), self._follow_parameters())

    async def _follow(self) -> None:
        self._refresh()
        async for _ in self._node.graph_changes():
            self._refresh()
            await asyncio.sleep(_UPDATE_INTERVAL_S)

    def _refresh(self) -> None:
        self._note_clock()
        self._topics.refresh()
        if not self._options.is_read_only:
            self._services.refresh()
        self._parameters.refresh()
        self._connections.refresh()

    def _note_clock(self) -> None:
        if not (self._has_clock or self._has_noted_clock) and self._node.count_publishers(CLOCK):
            self._has_noted_clock = True
            terminal_output.note(f"{CLOCK} has appeared; restart the command to send its time to viewers")

    async def _follow_viewers(self) -> None:
        while await self._viewers_changed.wait():
            self._viewers_changed.clear()
            self._topics.update_subscriptions()
            self._publishing.update_publishers()
            await asyncio.sleep(_VIEWERS_INTERVAL_S)

    async def _follow_parameters(self) -> None:
        while await self._parameters_changed.wait():
            self._parameters_changed.clear()
            self._server.publish_parameters(self._parameters.refreshed())
            await asyncio.sleep(_UPDATE_INTERVAL_S)

    def _print_address(self, port: int) -> None:
        host = f"[{self._options.host}]" if ":" in self._options.host else self._options.host
        address = f"ws://{host}:{port}" + (f"/?token={quote(self._options.token)}" if self._options.token else "")
        app = f"{_APP}?ds=foxglove-websocket&ds.url={quote(address, safe='')}"
        if self._options.as_json:
            terminal_output.document({"address": address, "open": app}, in_stream=True)
            return
        terminal_output.line(f"{address} for Foxglove and Lichtblick; Ctrl-C ends the server", "bold")
        terminal_output.line(app)

    async def close(self) -> None:
        await self._server.stop()
        for part in (self._topics, self._services, self._publishing, self._parameters):
            await part.close()
