"""Node of a command, and functions that wait until discovery has found other nodes.

Discovery never reports that it is complete, so a command waits for a quiet period (`CommandNode.wait_for_discovery`).
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, TypedDict

from rosidl_py_gen.command_support.errors import CommandError
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.runtime import Context

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterable, Iterator

    from typing_extensions import Self

    from rosidl_py_gen.runtime import Node

_MIN_DISCOVERY_S = 0.2
"""Minimum time to wait for discovery, in seconds; peers on a quiet network reply within milliseconds."""
_QUIET_PERIOD_S = 0.1
"""Time without a change of the graph after which discovery counts as complete, in seconds."""
_INCOMPLETE_QUIET_PERIOD_S = 0.5
"""Time in seconds without a change of the graph after which discovery counts as complete although announced endpoints
are missing, as over wireless links."""
_NO_PEER_TIMEOUT_S = 1.0
"""Time to wait for discovery if no other node is found, in seconds."""
_MAX_DISCOVERY_S = 2.0
"""Maximum time to wait for discovery, in seconds, even if the graph keeps changing."""
ANNOUNCE_DELAY_S = 0.05
"""Delay until endpoints of a command are announced to peers, in seconds. Most commands end earlier; otherwise DDS
delays their end by 0.1 to 0.2 s, until every peer has acknowledged the announcement."""
_WAITING_NOTE_DELAY_S = 2.0
"""Time after which a note says that a command waits for a topic, in seconds; Fast DDS nodes are found within 1.2 s."""
DEFAULT_FIND_TIMEOUT_S = 5.0
"""Default time to wait for a topic, service, action or node that the command line names, in seconds."""


_SEND_GOAL, _SEND_GOAL_TYPE = "/_action/send_goal", "_SendGoal"
_FEEDBACK, _FEEDBACK_TYPE = "/_action/feedback", "_FeedbackMessage"
_LIST_PARAMETERS = "/list_parameters", "rcl_interfaces/srv/ListParameters"
"""Name after the node's name, and type, of a service by which nodes with parameters are found."""
_MINIMAL_NODE_OPTIONS: dict[str, Any] = {
    "enable_rosout": False,
    "start_services": False,
    "parameter_events": False,
    "parameter_overrides": {"start_type_description_service": False},
}


class NetworkOptions(TypedDict, total=False):
    """Values of the options that all commands with a node have, and a context that was opened early, or the error from
    opening it.
    """

    domain_id: int | None
    discovery: str | None
    spin_time_s: float | None
    context: Context
    failure: Exception


async def first_of(*coroutines: Coroutine[Any, Any, object]) -> None:
    """Run coroutines until the first one returns or fails, and cancel the others."""
    tasks = [asyncio.ensure_future(one) for one in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


@contextmanager
def context_opened_early(network: NetworkOptions) -> Iterator[None]:
    """Open the context of a command before the rest of the command is imported, so that it discovers peers early.

    `CommandNode` uses the context, or raises the error with which opening the context failed.
    """
    handler = signal.signal(signal.SIGTERM, _end) if threading.current_thread() is threading.main_thread() else None
    with ExitStack() as undo:
        if handler is not None:
            undo.callback(signal.signal, signal.SIGTERM, handler)
        try:
            context = network["context"] = _listen(network)
            undo.callback(context.close)
        except Exception as error:  # raised by CommandNode, where it is reported
            network["failure"] = error
        yield


def _end(number: int, _: object) -> None:
    """Raise `SystemExit` when a signal arrives, so that the context is closed and peers need not wait until its lease
    expires.
    """
    sys.exit(128 + number)


def _listen(network: NetworkOptions) -> Context:
    return Context(
        network.get("domain_id"), discovery=network.get("discovery"), args=[], announce_delay_s=ANNOUNCE_DELAY_S
    )


class CommandNode:
    """Node of a command, used with ``async with``. It has no services of its own, and a hidden name by default."""

    def __init__(self, network: NetworkOptions, *, name: str | None = None, **node_options: Any) -> None:
        self._spin_time_s = network.get("spin_time_s")
        failure = network.get("failure")
        if failure is not None:
            raise failure
        self._start_s = self.now_s()
        self.context = network.pop("context") if "context" in network else _listen(network)
        options = {**_MINIMAL_NODE_OPTIONS, **node_options}
        try:
            from rosidl_py_gen.runtime import Node  # takes 0.1 s, in which the context already listens

            self.node: Node = Node(name or f"_rosidl_py_{os.getpid()}", context=self.context, **options)
        except BaseException:
            self.context.close()
            raise

    @staticmethod
    def now_s() -> float:
        """Return the time of the running event loop in seconds; tests replace it by virtual time."""
        return asyncio.get_running_loop().time()

    async def __aenter__(self) -> Self:
        self.context.on_incompatible_endpoint = self._note_incompatible
        await self.node.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        self.node.close()
        self.context.close()

    def _note_incompatible(self, text: str, _: str) -> None:
        from rosidl_py_gen.command_support import terminal_output

        terminal_output.note(f"warning: {text.replace(f'node {self.node.fully_qualified_name}', 'this command')}")

    async def wait_for_discovery(self) -> None:
        """Wait until the graph has not changed for a quiet period, at least 0.2 s and at most 2 s.

        Without any other node the wait takes 1 s. ``--spin-time`` replaces all of these times.
        """
        if self._spin_time_s is not None:
            await asyncio.sleep(self._start_s + self._spin_time_s - self.now_s())
            return
        # Time in which this process was busy does not count: no peer is discovered then.
        listened_s = min(self.now_s() - self._start_s, _MIN_DISCOVERY_S)
        last_change_s, has_changed = listened_s, False

        async def watch() -> None:
            nonlocal has_changed
            async for _ in self.node.graph_changes():
                has_changed = True

        def required_s() -> float:
            if len(self.node.get_nodes()) <= 1:
                return _NO_PEER_TIMEOUT_S
            if any(one.is_ros and one.announces_type_hashes is None for one in self.context.participants()):
                return _MAX_DISCOVERY_S  # every ROS participant has endpoints, so they will follow
            quiet_s = _QUIET_PERIOD_S if self.node.endpoints_complete() else _INCOMPLETE_QUIET_PERIOD_S
            return min(max(_MIN_DISCOVERY_S, last_change_s + quiet_s), _MAX_DISCOVERY_S)

        watching = asyncio.ensure_future(watch())
        try:
            while (step_s := min(required_s() - listened_s, _QUIET_PERIOD_S)) > 0:
                await asyncio.sleep(step_s)
                listened_s += step_s
                if has_changed:
                    last_change_s, has_changed = listened_s, False
        finally:
            watching.cancel()

    async def wait_for_node_names(self) -> None:
        """Wait for discovery, then at most 2 s for all node names, which arrive about 50 ms after endpoints."""
        await self.wait_for_discovery()
        if self._spin_time_s is None:
            await self.wait_for(self.node.node_names_complete, _MAX_DISCOVERY_S)

    def note_if_alone(self) -> None:
        """Print a note if no other node, topic or service was found in the domain."""
        from rosidl_py_gen.command_support import terminal_output

        node = self.node
        if len(node.get_nodes()) < 2 and not (node.get_topic_names_and_types() or node.get_service_names_and_types()):
            terminal_output.note(
                f"no nodes were found in domain {self.context.domain_id}; check ROS_DOMAIN_ID and "
                "ROS_AUTOMATIC_DISCOVERY_RANGE, and run `rosidl-py doctor` to see other participants"
            )

    async def wait_for(self, condition: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Wait until a condition is true, which is checked after every change of the graph.

        Returns False after the timeout. A timeout of None means ``--spin-time``, or 5 s without it.
        """
        if timeout_s is None:
            timeout_s = DEFAULT_FIND_TIMEOUT_S if self._spin_time_s is None else self._spin_time_s

        async def watch() -> bool:
            if condition():
                return True
            async for _ in self.node.graph_changes():
                if condition():
                    return True
            return False  # the node was closed

        if condition():  # also with a timeout of 0
            return True
        try:
            return await asyncio.wait_for(watch(), timeout_s)
        except asyncio.TimeoutError:
            return bool(condition())  # it may have become true while this process was busy

    async def find(self, kind: str, name: str, timeout_s: float | None = None) -> str:
        """Wait until a topic, service, action or node (`kind`) appears, and return its full name.

        Raises:
            CommandError: it did not appear within `timeout_s`; the text suggests a similar name.
            InvalidNameError: `name` is invalid.
        """
        from rosidl_py_gen.base.names import did_you_mean
        from rosidl_py_gen.command_support import terminal_output

        full = self.full_name(name, kind)
        text = f"topic {name} does not appear to be published yet; waiting for it"
        note = terminal_output.note if kind == "topic" else lambda text: None
        waiting = asyncio.get_running_loop().call_later(_WAITING_NOTE_DELAY_S, note, text)
        try:
            if await self.wait_for(lambda: full in self.names(kind), timeout_s):
                return full
        finally:
            waiting.cancel()
        names = [name for name in self.names(kind) if "/_" not in name]  # without the names of this command
        count = f"; `rosidl-py {kind} list` shows {len(names)}" if names else ""
        hint = did_you_mean(full, names, in_namespaces=True) or count
        raise CommandError(f"no {kind} {full} was found in domain {self.context.domain_id}{hint or _NO_PEERS}")

    # ----------------------------------------------------------------------------------------------------------- graph

    def full_name(self, name: str, kind: str = "topic") -> str:
        """Return the full name of a topic, service, action or node, which need not exist. Raises `InvalidNameError`."""
        resolve = self.node.resolve_topic_name if kind == "topic" else self.node.resolve_service_name
        return resolve(name if name.startswith("/") else f"/{name}")

    def names(self, kind: str) -> list[str]:
        """Return the names of the topics, services, actions or nodes (`kind`) in the graph."""
        match kind:
            case "topic":
                return [name for name, _ in self.node.get_topic_names_and_types()]
            case "service":
                return [name for name, _ in self.node.get_service_names_and_types()]
            case "action":  # both its topics and its services
                services = dict(self.node.get_service_names_and_types())
                known = self.actions(self.node.get_topic_names_and_types())
                return [name for name, _ in known if name + _SEND_GOAL in services]
        return self.node.get_node_names()

    @staticmethod
    def is_hidden(name: str) -> bool:
        """Return True for a topic or service that ROS tools hide: a part of its name begins with an underscore."""
        return "/_" in name

    @staticmethod
    def is_hidden_node(name: str) -> bool:
        """Return True for the full name of a node that ROS tools hide, because its name begins with an underscore."""
        return name.rpartition("/")[2].startswith("_")

    @staticmethod
    def actions(topics: Iterable[tuple[str, list[str]]]) -> list[tuple[str, list[str]]]:
        """Return names and types of the actions among topics, found by their feedback topics as in ``ros2 action``."""
        ends = len(_FEEDBACK_TYPE)
        return [
            (name.removesuffix(_FEEDBACK), [one[:-ends] for one in types if one.endswith(_FEEDBACK_TYPE)])
            for name, types in topics
            if name.endswith(_FEEDBACK)
        ]

    def announced_types(self, kind: str, name: str) -> list[str]:
        """Return the types that nodes announce for a topic, service or action (`kind`)."""
        if kind == "topic":
            return dict(self.node.get_topic_names_and_types()).get(name, [])
        services = dict(self.node.get_service_names_and_types())
        if kind == "service":
            return services.get(name, [])
        return [one.removesuffix(_SEND_GOAL_TYPE) for one in services.get(name + _SEND_GOAL, [])]

    def has_server(self, service: str) -> bool:
        """Return True if a service has a server; False for names that ROS does not allow, but DDS programs may use."""
        from rosidl_py_gen.runtime import validate_full_name

        try:
            validate_full_name(service)
        except InvalidNameError:
            return False
        return self.node.count_services(service) > 0

    def nodes_serving(self, ending: str, type_name: str, *, hidden: bool) -> list[str]:
        """Return the sorted full names of nodes that serve the service ``NODE`` + `ending` of type `type_name`."""
        names = [
            name.removesuffix(ending)
            for name, types in self.node.get_service_names_and_types()
            if name.endswith(ending) and type_name in types and self.has_server(name)
        ]
        return [name for name in names if hidden or not self.is_hidden_node(name)]

    def nodes_with_parameters(self, *, hidden: bool) -> list[str]:
        """Return the sorted full names of nodes whose parameters other nodes can request."""
        return self.nodes_serving(*_LIST_PARAMETERS, hidden=hidden)


_NO_PEERS = "; none exist in this domain; check ROS_DOMAIN_ID, and run `rosidl-py doctor` to see other participants"
