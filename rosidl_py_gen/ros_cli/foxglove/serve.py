"""``foxglove``.

Decides the order: what is there is shown as it is found, and viewers may come from the first moment on.
"""

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
_PAUSE_S = 0.1
"""Between looks at a graph that keeps changing."""
_VIEWERS_INTERVAL_S = 0.01
"""Shortest time between two updates of subscriptions, which take time for each topic."""


async def serve(network: NetworkOptions, options: FoxgloveOptions) -> int:
    """Show viewers what is there, until it is cancelled."""
    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        view = _View(session, options)
        try:
            await view.show()
        finally:
            await view.close()
    return 0


class _View:
    """Everything between the graph and viewers."""

    def __init__(self, session: CommandNode, options: FoxgloveOptions) -> None:
        self._options = options
        self._node = session.node
        self._clock = ViewerClock()
        self._server = server = Server(Access(options.origins, options.token))
        self._changed, self._wanted = asyncio.Event(), asyncio.Event()
        """Parameters have changed, and what viewers want."""
        self._has_clock = self._has_noted_clock = False
        shown: dict[str, Any] = {"paths": options.paths, "hidden": options.hidden}
        self._topics = TopicBridge(session, server, self._clock, **shown)
        self._services = ServiceBridge(session, server, **shown)
        self._publishing = ClientPublishing(session, server, paths=options.paths)
        self._parameters = ParameterBridge(session, server, self._changed.set, is_read_only=options.is_read_only)
        self._connections = ConnectionGraph(session.node, server, hidden=options.hidden)

    async def show(self) -> None:
        """Until it is cancelled.

        Raises:
            ToolError: the address cannot be used.
        """
        options = self._options
        self._has_clock = options.use_sim_time or self._node.count_publishers(CLOCK) > 0
        handlers = Handlers(self._wanted.set, self._publishing.take, self._parameters.get, self._parameters.set_)
        listening = Listening(
            *(options.host, options.port, options.queue, options.most_mib << 20, options.per_s),
            *(self._has_clock, options.is_read_only),
        )
        port = await self._server.start(listening, handlers)
        if self._has_clock:
            self._clock.follow(self._node, self._server)
        self._say_where(port)
        await first_of(self._follow(), self._follow_viewers(), self._follow_parameters())

    async def _follow(self) -> None:
        """Follow the graph, for ever."""
        self._look()
        async for _ in self._node.graph_changes():
            self._look()
            await asyncio.sleep(_PAUSE_S)

    def _look(self) -> None:
        self._note_clock()
        self._topics.refresh()
        if not self._options.is_read_only:
            self._services.refresh()
        self._parameters.refresh()
        self._connections.refresh()

    def _note_clock(self) -> None:
        if not (self._has_clock or self._has_noted_clock) and self._node.count_publishers(CLOCK):
            self._has_noted_clock = True
            terminal_output.note(f"{CLOCK} has appeared; viewers are told its time when this is started again")

    async def _follow_viewers(self) -> None:
        while await self._wanted.wait():
            self._wanted.clear()
            self._topics.serve()
            self._publishing.serve()
            await asyncio.sleep(_VIEWERS_INTERVAL_S)

    async def _follow_parameters(self) -> None:
        while await self._changed.wait():
            self._changed.clear()
            self._server.publish_parameters(self._parameters.refreshed())
            await asyncio.sleep(_PAUSE_S)

    def _say_where(self, port: int) -> None:
        host = f"[{self._options.host}]" if ":" in self._options.host else self._options.host
        address = f"ws://{host}:{port}" + (f"/?token={quote(self._options.token)}" if self._options.token else "")
        app = f"{_APP}?ds=foxglove-websocket&ds.url={quote(address, safe='')}"
        if self._options.as_json:
            terminal_output.document({"address": address, "open": app}, in_stream=True)
            return
        terminal_output.line(f"{address} for Foxglove and Lichtblick; Ctrl-C ends it", "bold")
        terminal_output.line(app)

    async def close(self) -> None:
        """Let go of viewers, and of everything that was opened for them."""
        await self._server.stop()
        for part in (self._topics, self._services, self._publishing, self._parameters):
            await part.close()
