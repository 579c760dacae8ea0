"""``foxglove``.

Decides the order: what is there is shown as it is found, and viewers may come from the first moment on.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.foxglove.access import Access
from rosidl_py_gen.tools.foxglove.clock import TOPIC as CLOCK
from rosidl_py_gen.tools.foxglove.clock import Clock
from rosidl_py_gen.tools.foxglove.connections import Connections
from rosidl_py_gen.tools.foxglove.parameters import Parameters
from rosidl_py_gen.tools.foxglove.publishing import Publishing
from rosidl_py_gen.tools.foxglove.server import Listening, Server
from rosidl_py_gen.tools.foxglove.services import Services
from rosidl_py_gen.tools.foxglove.topics import Topics
from rosidl_py_gen.tools.foxglove.viewer import Handlers
from rosidl_py_gen.tools.session import Network, Session, first_of

if TYPE_CHECKING:
    from rosidl_py_gen.tools.foxglove.command import FoxgloveOptions

_APP = "https://app.foxglove.dev"
_PAUSE_S = 0.1
"""Between looks at a graph that keeps changing."""
_VIEWERS_INTERVAL_S = 0.01
"""Shortest time between two updates of subscriptions, which take time for each topic."""


async def serve(network: Network, options: FoxgloveOptions) -> int:
    """Show viewers what is there, until it is cancelled."""
    async with Session(network) as session:
        await session.wait_until_quiet()
        view = _View(session, options)
        try:
            await view.show()
        finally:
            await view.close()
    return 0


class _View:
    """Everything between the graph and viewers."""

    def __init__(self, session: Session, options: FoxgloveOptions) -> None:
        self._options = options
        self._node = session.node
        self._clock = Clock()
        self._server = server = Server(Access(options.origins, options.token))
        self._changed, self._wanted = asyncio.Event(), asyncio.Event()
        """Parameters have changed, and what viewers want."""
        self._has_clock = self._has_noted_clock = False
        shown: dict[str, Any] = {"paths": options.paths, "hidden": options.hidden}
        self._topics = Topics(session, server, self._clock, **shown)
        self._services = Services(session, server, **shown)
        self._publishing = Publishing(session, server, paths=options.paths)
        self._parameters = Parameters(session, server, self._changed.set, is_read_only=options.is_read_only)
        self._connections = Connections(session.node, server, hidden=options.hidden)

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
        self._topics.look()
        if not self._options.is_read_only:
            self._services.look()
        self._parameters.look()
        self._connections.look()

    def _note_clock(self) -> None:
        if not (self._has_clock or self._has_noted_clock) and self._node.count_publishers(CLOCK):
            self._has_noted_clock = True
            printing.note(f"{CLOCK} has appeared; viewers are told its time when this is started again")

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
            printing.document({"address": address, "open": app}, in_stream=True)
            return
        printing.line(f"{address} for Foxglove and Lichtblick; Ctrl-C ends it", "bold")
        printing.line(app)

    async def close(self) -> None:
        """Let go of viewers, and of everything that was opened for them."""
        await self._server.stop()
        for part in (self._topics, self._services, self._publishing, self._parameters):
            await part.close()
