"""Nodes of commands: waiting for discovery, words of a command line, classes of topics."""

from __future__ import annotations

import asyncio
import signal
from contextlib import nullcontext
from time import monotonic
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String
from support.waiting import until

from rosidl_py_gen import ros_cli
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.command_support.command_node import CommandNode, NetworkOptions, context_opened_early
from rosidl_py_gen.command_support.graph_lookup import interface_class
from rosidl_py_gen.runtime import EnvironmentSettingError
from rosidl_py_gen.runtime.node.context import core_of

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from support.worlds import World


async def test_wait_for_without_timeout_returns_current_condition() -> None:
    async with CommandNode({}) as command_node:
        assert await command_node.wait_for(lambda: True, 0)
        assert not await command_node.wait_for(lambda: False, 0)
    async with CommandNode({"spin_time_s": 0}) as command_node:
        with pytest.raises(CommandError, match="none exist in this domain"):
            await command_node.find("node", "somebody")


async def test_new_endpoints_are_announced_once_after_delay(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    assert dds
    async with CommandNode({}) as command_node:
        discovery = core_of(command_node.context).discovery
        publish, told = discovery.publish, []
        monkeypatch.setattr(discovery, "publish", lambda: (publish(), told.append(monotonic())))
        began = monotonic()
        command_node.node.create_publisher(String, "/short")
        command_node.node.create_publisher(String, "/brief")
        await until(lambda: told)
        assert told[0] - began >= discovery.announce_delay_s > 0.01
        assert len(told) == 1


async def test_discovery_wait_is_extended_if_event_loop_was_blocked(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, blocked_s = asyncio.get_running_loop(), 0.0
    monkeypatch.setattr(CommandNode, "now_s", staticmethod(lambda: loop.time() + blocked_s))
    async with CommandNode({}) as made:
        waiting = asyncio.ensure_future(made.wait_for_discovery())
        loop.call_later(0.3, dds.node, "late")
        await asyncio.sleep(0)
        blocked_s = 5.0
        await waiting
        assert "/late" in made.node.get_node_names()


class ChangingGraph:
    """Node whose graph changes at the given times in seconds; from the first change on it knows another node."""

    context: Any = None

    def __init__(self, times: list[float], *, endpoints_complete: bool = True) -> None:
        self._times, self.seen, self._known = times, 0, endpoints_complete

    async def graph_changes(self) -> AsyncIterator[None]:
        began = CommandNode.now_s()
        for time in self._times:
            await asyncio.sleep(began + time - CommandNode.now_s())
            self.seen += 1
            yield
        await asyncio.Event().wait()

    def get_nodes(self) -> list[str]:
        return ["own", "other"] if self.seen else ["own"]

    def endpoints_complete(self) -> bool:
        return self._known

    def participants(self) -> list[Any]:
        return []


@pytest.mark.parametrize(
    ("news", "are_known", "seen", "took_s"),
    [
        ([], True, 0, 1.0),  # nobody is there
        ([0.05], True, 1, 0.2),
        ([0.16 + 0.06 * number for number in range(8)], True, 8, 0.7),
        ([0.05, 0.28, 0.9], True, 1, 0.2),
        ([0.05, 0.28, 0.9], False, 2, 0.8),
        ([0.05 * number for number in range(1, 100)], True, 39, 2.0),
    ],
)
async def test_discovery_wait_lasts_until_graph_stops_changing(
    memory: World, news: Any, are_known: bool, seen: int, took_s: float
) -> None:
    made, told = CommandNode({"context": memory.context()}), ChangingGraph(news, endpoints_complete=are_known)
    start_s = CommandNode.now_s()
    made.node = made.context = told  # type: ignore[assignment]
    await made.wait_for_discovery()
    assert told.seen == pytest.approx(seen, abs=1)
    assert CommandNode.now_s() - start_s == pytest.approx(took_s, abs=0.001)


async def test_wait_for_rechecks_condition_without_graph_changes(memory: World) -> None:
    made, checks = object.__new__(CommandNode), list[bool]()
    made.node = ChangingGraph([])  # type: ignore[assignment]
    assert await made.wait_for(lambda: checks.append(True) or len(checks) > 2, 0.1)


@pytest.mark.parametrize("error", [None, CommandError("wrong")])
def test_context_opens_before_command_runs_and_closes_after_it(dds: World, error: CommandError | None) -> None:
    assert dds
    used: list[Any] = []

    @ros_cli.verb
    def command(network: NetworkOptions) -> int:
        async def main() -> None:
            used.append(CommandNode(network).context)

        used.append(network["context"])
        assert not network["context"].is_closed
        asyncio.run(main())
        if error is not None:
            raise error
        return 0

    with pytest.raises(CommandError) if error else nullcontext():
        command(network=NetworkOptions())
    assert used[0] is used[1] and used[0].is_closed


def test_error_of_early_context_is_raised_by_command_node(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    assert dds
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    with (
        context_opened_early(network := NetworkOptions()),
        pytest.raises(EnvironmentSettingError, match="ROS_DOMAIN_ID"),
    ):
        CommandNode(network)


def test_sigterm_during_command_closes_early_context(dds: World) -> None:
    assert dds
    contexts = list[Any]()

    @ros_cli.verb
    def command(network: NetworkOptions) -> None:
        contexts.append(network["context"])
        signal.raise_signal(signal.SIGTERM)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended:
        command(network=NetworkOptions())
    assert ended.value.code == 143
    assert contexts[0].is_closed and signal.getsignal(signal.SIGTERM) == before


async def test_topic_with_two_types_requires_type_argument() -> None:
    async with CommandNode({}) as command_node:
        node = command_node.node
        node.create_publisher("std_msgs/msg/String", "both")
        node.create_publisher("std_msgs/msg/Bool", "both")
        with pytest.raises(CommandError, match="more than one type: std_msgs/msg/Bool, std_msgs/msg/String"):
            await interface_class(command_node, "topic", "/both")
        assert (await interface_class(command_node, "topic", "/both", "std_msgs/Bool")).__name__ == "Bool"
