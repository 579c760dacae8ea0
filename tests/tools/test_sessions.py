"""What commands have in common: waiting, and the words of a command line."""

from __future__ import annotations

from time import monotonic
from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import String
from worlds import until

from rosidl_py_gen.runtime.transport.interface import NodeEntities, ParticipantFound
from rosidl_py_gen.tools import ToolError
from rosidl_py_gen.tools.messages import type_and_values
from rosidl_py_gen.tools.session import Session, names_are_known

if TYPE_CHECKING:
    from worlds import World


async def test_what_is_there_needs_no_time() -> None:
    async with Session({}) as session:
        assert await session.wait_for(lambda: True, 0)
        assert not await session.wait_for(lambda: False, 0)


async def test_a_command_does_not_count_itself_among_what_is_there() -> None:
    async with Session({"spin_time_s": 0}) as session:
        with pytest.raises(ToolError, match="there is none at all"):
            await session.find("node", "somebody", session.node.get_node_names)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], (None, "")),
        (["{a: 1}"], (None, "{a: 1}")),
        (["std_srvs/Empty"], ("std_srvs/Empty", "")),
        (["std_srvs/srv/Empty", "{}"], ("std_srvs/srv/Empty", "{}")),
    ],
)
def test_type_and_values_may_be_left_out(words: list[str], expected: tuple[str | None, str]) -> None:
    assert type_and_values(words) == expected


def test_values_that_a_shell_took_apart_are_refused() -> None:
    with pytest.raises(ToolError, match="put them between '"):
        type_and_values(["{a:", "1}"])


async def test_peers_are_told_of_endpoints_a_moment_later(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    assert dds
    async with Session({}) as session:
        discovery = session.context.discovery
        publish, told = discovery.publish, []
        monkeypatch.setattr(discovery, "publish", lambda: (publish(), told.append(monotonic())))
        began = monotonic()
        session.node.create_publisher(String, "/short")
        session.node.create_publisher(String, "/brief")
        await until(lambda: told)
        assert told[0] - began >= discovery.together_s > 0.01
        assert len(told) == 1


async def test_names_are_known_when_every_endpoint_is_of_a_node(dds: World) -> None:
    dds.node("base").create_publisher(String, "/speed")
    async with Session({}) as session:
        graph = session.node.scope.graph
        await until(lambda: "/base" in session.node.get_node_names() and session.node.count_publishers("/speed") == 1)
        await until(lambda: names_are_known(graph))
        participant = b"\1\x0f" + bytes(10) + b"\0\0\1\xc1"
        graph.apply(ParticipantFound(participant, "/"))
        assert not names_are_known(graph)
        graph.set_nodes(participant, [NodeEntities("/", "slow", frozenset(), frozenset())])
        assert names_are_known(graph)
