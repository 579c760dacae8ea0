"""What commands have in common: waiting, and the words of a command line."""

from __future__ import annotations

import pytest

from rosidl_py_gen.tools import ToolError
from rosidl_py_gen.tools.messages import type_and_values
from rosidl_py_gen.tools.session import Session


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
