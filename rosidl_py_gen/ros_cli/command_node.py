"""The node a command works with, and waiting until others are found.

Decides how long a command listens before it believes what it sees: discovery has no end that one could wait for.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, TypedDict

from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.runtime import Context

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator

    from typing_extensions import Self

    from rosidl_py_gen.runtime import Node

_MIN_DISCOVERY_S, _QUIET_PERIOD_S, _INCOMPLETE_QUIET_PERIOD_S, _NO_PEER_TIMEOUT_S, _MAX_DISCOVERY_S = (
    0.2,
    0.1,
    0.5,
    1.0,
    2.0,
)
"""When nothing is said: peers are asked at once and answer within milliseconds on a quiet network; those that answer
later, over wireless links or when busy, are waited for as long as news keep coming: longer apart while nodes have told
of endpoints that were not found."""
_ANNOUNCE_DELAY_S = 0.05
"""Most commands are over before it is worth telling peers of their endpoints; DDS would hold up the end, by 0.1 to
0.2 s, until all of them had acknowledged that."""
DEFAULT_FIND_TIMEOUT_S = 5.0
"""How long something that was named is waited for, when the user says nothing."""


_MINIMAL_NODE_OPTIONS: dict[str, Any] = {
    "enable_rosout": False,
    "start_services": False,
    "parameter_events": False,
    "parameter_overrides": {"start_type_description_service": False},
}


def now_s() -> float:
    """The running loop's time: what commands wait by."""
    return asyncio.get_running_loop().time()


async def first_of(*coroutines: Coroutine[Any, Any, object]) -> None:
    """Run all until one ends or fails."""
    tasks = [asyncio.ensure_future(one) for one in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


class NetworkOptions(TypedDict, total=False):
    """What `options.node_options` give, and what `context_opened_early` adds: a context, or why there is none."""

    domain_id: int | None
    discovery: str | None
    spin_time_s: float | None
    context: Context
    failure: Exception


@contextmanager
def context_opened_early(network: NetworkOptions) -> Iterator[None]:
    """Let a context listen for others while the rest of a command is loaded; `CommandNode` uses it."""
    handler = signal.signal(signal.SIGTERM, _end) if threading.current_thread() is threading.main_thread() else None
    with ExitStack() as undo:
        if handler is not None:
            undo.callback(signal.signal, signal.SIGTERM, handler)
        try:
            context = network["context"] = _listen(network)
            undo.callback(context.close)
        except Exception as error:  # the command says what it means
            network["failure"] = error
        yield


def _end(number: int, _: object) -> None:
    """Leave the network first, so that peers need not wait until our lease ends."""
    sys.exit(128 + number)


def _listen(network: NetworkOptions) -> Context:
    return Context(
        network.get("domain_id"), discovery=network.get("discovery"), args=[], announce_delay_s=_ANNOUNCE_DELAY_S
    )


class CommandNode:
    """A node of a command, hidden as ROS hides tools' unless it has a `name`; it serves nothing by itself.

    Use with ``async with``.
    """

    def __init__(self, network: NetworkOptions, *, name: str | None = None, **node_options: Any) -> None:
        self._spin_time_s = network.get("spin_time_s")
        failure = network.get("failure")
        if failure is not None:
            raise failure
        self._began = now_s()
        self.context = network.pop("context") if "context" in network else _listen(network)
        options = {**_MINIMAL_NODE_OPTIONS, **node_options}
        try:
            from rosidl_py_gen.runtime import Node  # takes 0.1 s, in which the context already listens

            self.node: Node = Node(name or f"_rosidl_py_{os.getpid()}", context=self.context, **options)
        except BaseException:
            self.context.close()
            raise

    async def __aenter__(self) -> Self:
        self.context.on_incompatible_endpoint = self._note_mismatch
        await self.node.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        self.node.close()
        self.context.close()

    def _note_mismatch(self, text: str, _: str) -> None:
        """Say on standard error why nothing comes."""
        from rosidl_py_gen.ros_cli import terminal_output

        terminal_output.note(f"warning: {text.replace(f'node {self.node.fully_qualified_name}', 'this command')}")

    async def wait_for_discovery(self) -> None:
        """Listen until discovery says nothing new: at least 0.2 s, at most 2 s; or as long as the user said.

        Where nobody else is seen there is no news to go by: that takes 1 s.
        """
        if self._spin_time_s is not None:
            await asyncio.sleep(self._began + self._spin_time_s - now_s())
            return
        listened_s = min(
            now_s() - self._began, _MIN_DISCOVERY_S
        )  # without what holds this process up: others are not heard then
        last_s, news = listened_s, False

        async def watch() -> None:
            nonlocal news
            async for _ in self.node.graph_changes():
                news = True

        def enough_s() -> float:
            if len(self.node.get_nodes()) <= 1:
                return _NO_PEER_TIMEOUT_S
            if any(one.is_ros and one.announces_type_hashes is None for one in self.context.participants()):
                return _MAX_DISCOVERY_S  # every ROS participant has endpoints: these will come
            quiet_s = _QUIET_PERIOD_S if self.node.endpoints_complete() else _INCOMPLETE_QUIET_PERIOD_S
            return min(max(_MIN_DISCOVERY_S, last_s + quiet_s), _MAX_DISCOVERY_S)

        watching = asyncio.ensure_future(watch())
        try:
            while (step_s := min(enough_s() - listened_s, _QUIET_PERIOD_S)) > 0:
                await asyncio.sleep(step_s)
                listened_s += step_s
                if news:
                    last_s, news = listened_s, False
        finally:
            watching.cancel()

    async def wait_for_node_names(self) -> None:
        """`wait_for_discovery`, then until the nodes of all that was found have told their names, at most 2 s more.

        Names follow endpoints by some 50 ms.
        """
        await self.wait_for_discovery()
        if self._spin_time_s is None:
            await self.wait_for(self.node.node_names_complete, _MAX_DISCOVERY_S)

    def note_if_alone(self) -> None:
        """Print a note if no other node, topic or service was found in the domain."""
        from rosidl_py_gen.ros_cli import terminal_output

        node = self.node
        if len(node.get_nodes()) < 2 and not (node.get_topic_names_and_types() or node.get_service_names_and_types()):
            terminal_output.note(
                f"no nodes were found in domain {self.context.domain_id}; check ROS_DOMAIN_ID and "
                "ROS_AUTOMATIC_DISCOVERY_RANGE, and run `rosidl-py doctor` to see other participants"
            )

    async def wait_for(self, is_there: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Wait until `is_there` gives something true, asked after every change of the graph.

        Args:
            timeout_s: None means as long as the user said, else 5 s.
        """
        if timeout_s is None:
            timeout_s = DEFAULT_FIND_TIMEOUT_S if self._spin_time_s is None else self._spin_time_s

        async def watch() -> bool:
            if is_there():
                return True
            async for _ in self.node.graph_changes():
                if is_there():
                    return True
            return False  # it was closed

        if is_there():  # even when there is no time to begin to watch
            return True
        try:
            return await asyncio.wait_for(watch(), timeout_s)
        except asyncio.TimeoutError:
            return bool(is_there())  # it may have come while this process was held up

    async def find(self, kind: str, name: str, known: Callable[[], list[str]], timeout_s: float | None = None) -> str:
        """The full name of a topic, service, action or node that somebody has; waits until it appears.

        Args:
            kind: for the error text.
            known: the names there are now.

        Raises:
            ToolError: it did not appear; says which similar name exists.
            InvalidNameError: this is no name.
        """
        from rosidl_py_gen.base.names import similar_name

        resolve = self.node.resolve_topic_name if kind == "topic" else self.node.resolve_service_name
        full = resolve(name if name.startswith("/") else f"/{name}")
        if await self.wait_for(lambda: full in known(), timeout_s):
            return full
        names = [name for name in known() if "/_" not in name]  # not ourselves
        hint = similar_name(full, names) or (f"; `rosidl-py {kind} list` shows {len(names)}" if names else "")
        raise ToolError(f"no {kind} {full} was found in domain {self.context.domain_id}{hint or _no_peers_hint()}")


def _no_peers_hint() -> str:
    return "; there is none at all: is the domain right, and does `rosidl-py doctor` see other participants?"
