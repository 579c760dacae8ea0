"""Run of the Foxglove server from its options to its end, with the clock for viewers and the connection graph.

Viewers may connect before discovery is complete. They are sent simulated time if ``/clock`` is published at the start;
otherwise they use system time.
"""

from __future__ import annotations

import asyncio
import time
from socket import gethostname
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.command_support import CommandNode, NetworkOptions, first_of, terminal_output
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.foxglove.protocol import Graph
from rosidl_py_gen.foxglove.server import FoxgloveOptions, Handlers, Server
from rosidl_py_gen.foxglove.services import ParameterBridge, ServiceBridge
from rosidl_py_gen.foxglove.topics import ClientPublishing, TopicBridge
from rosidl_py_gen.runtime import qos, validate_full_name

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node, NodeInfo

_CLOCK_TOPIC = "/clock"
_MIN_INTERVAL_S = 1 / 30
"""Minimum interval in seconds between time updates, because viewers draw at most 30 times a second and queued updates
are never dropped."""


def connection_graph(node: Node, *, hidden: bool) -> Graph:
    """Return the nodes of each topic and service; `hidden` includes hidden names.

    Nodes with invalid names are skipped.
    """
    graph: Graph = ({}, {}, {})
    for info in {(one.name, one.namespace): one for one in node.get_nodes()}.values():
        if not _is_shown(info, hidden):
            continue
        names_of_node = (
            node.get_publisher_names_and_types_by_node(info.name, info.namespace),
            node.get_subscriber_names_and_types_by_node(info.name, info.namespace),
            node.get_service_names_and_types_by_node(info.name, info.namespace),
        )
        for nodes_by_name, names in zip(graph, names_of_node, strict=True):
            for name, _ in names:
                if hidden or not CommandNode.is_hidden(name):
                    nodes_by_name.setdefault(name, []).append(info.fully_qualified_name)
    return graph


def _is_shown(info: NodeInfo, hidden: bool) -> bool:
    try:
        validate_full_name(info.fully_qualified_name)
    except InvalidNameError:
        return False
    return hidden or not CommandNode.is_hidden_node(info.fully_qualified_name)


_APP = "https://app.foxglove.dev"
_UPDATE_INTERVAL_S = 0.1
"""Minimum interval between two updates of viewers while the graph or parameters keep changing, in seconds."""
_VIEWERS_INTERVAL_S = 0.01
"""Minimum interval between two updates of subscriptions, in seconds; an update takes time for each topic."""


def addresses(host: str, port: int, token: str) -> tuple[str, str]:
    """Return the address that viewers connect to, and a link that opens the app in a browser of this machine.

    The hosts 0.0.0.0 and ::, which mean all addresses, are replaced: in the address by the name of this machine, in the
    link by localhost, because a browser lets the page of the app connect to its own machine only.
    """
    is_all = host in ("0.0.0.0", "::")
    host = f"[{host}]" if ":" in host else host
    address, here = (
        f"ws://{name}:{port}" + (f"/?token={quote(token)}" if token else "")
        for name in ((gethostname(), "localhost") if is_all else (host, host))
    )
    return address, f"{_APP}?ds=foxglove-websocket&ds.url={quote(here, safe='')}"


async def serve(network: NetworkOptions, options: FoxgloveOptions) -> None:
    """Run the Foxglove server until cancelled."""
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
        self._sim_ns: int | None = None
        """Simulated time in ns; 0 before the first message of ``/clock``, None if system time is used."""
        self._time_sent_s = 0.0
        self._parameters_changed = asyncio.Event()
        self._viewers_changed = asyncio.Event()  # or their subscriptions
        self._has_clock = self._has_noted_clock = False
        self._server = server = Server(options)
        settings: dict[str, Any] = {"paths": options.paths, "hidden": options.hidden}
        self._topics = TopicBridge(command_node, server, self._now_ns, **settings)
        self._services = ServiceBridge(command_node, server, **settings)
        self._publishing = ClientPublishing(command_node, server, paths=options.paths)
        self._parameters = ParameterBridge(
            command_node, server, self._parameters_changed.set, is_read_only=options.is_read_only
        )

    async def show(self) -> None:
        self._has_clock = self._options.use_sim_time or self._node.count_publishers(_CLOCK_TOPIC) > 0
        handlers = Handlers(
            self._viewers_changed.set, self._publishing.publish_from_viewer, self._parameters.get, self._parameters.set_
        )
        port = await self._server.start(handlers, has_time=self._has_clock)
        if self._has_clock:
            self._follow_clock()
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
        self._server.publish_graph(connection_graph(self._node, hidden=self._options.hidden))

    def _now_ns(self) -> int:
        return time.time_ns() if self._sim_ns is None else self._sim_ns

    def _follow_clock(self) -> None:
        self._sim_ns = 0

        def on_message(message: Any) -> None:
            self._sim_ns = max(0, stamp_ns(message.clock))
            now_s = time.monotonic()
            if now_s >= self._time_sent_s + _MIN_INTERVAL_S:
                self._time_sent_s = now_s
                self._server.send_time(self._sim_ns)

        clock: Any = get_message("rosgraph_msgs/msg/Clock")
        self._node.create_subscription(clock, _CLOCK_TOPIC, on_message, qos.CLOCK)

    def _note_clock(self) -> None:
        if not (self._has_clock or self._has_noted_clock) and self._node.count_publishers(_CLOCK_TOPIC):
            self._has_noted_clock = True
            terminal_output.note(f"{_CLOCK_TOPIC} has appeared; restart the command to send its time to viewers")

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
        address, app = addresses(self._options.host, port, self._options.token)
        if self._options.as_json:
            terminal_output.document({"address": address, "open": app}, in_stream=True)
            return
        terminal_output.line(f"{address} for Foxglove and Lichtblick; Ctrl-C ends the server", "bold")
        terminal_output.line(app)

    async def close(self) -> None:
        await self._server.stop()
        for part in (self._topics, self._services, self._publishing, self._parameters):
            await part.close()
