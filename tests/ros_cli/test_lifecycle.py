"""``rosidl-py lifecycle`` beside lifecycle nodes of the test's own."""

from __future__ import annotations

import asyncio
import json
import re
from typing import TYPE_CHECKING

from rosidl_py_gen.msgs.lifecycle_msgs.srv import GetState
from rosidl_py_gen.runtime import LifecycleNode, State, TransitionCallbackReturn

if TYPE_CHECKING:
    from conftest import Tool
    from support.node_fixtures import World


class Camera(LifecycleNode):
    """Configures, but never activates."""

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.FAILURE


async def test_a_node_is_led_through_its_states(network: World, tool: Tool) -> None:
    async with Camera("camera", context=network.context()):
        assert (await tool("lifecycle", "get", "/camera")).out == "unconfigured [1]\n"
        assert (await tool("lifecycle", "set", "/camera", "configure")).out == "Transitioning successful\n"
        state, possible, failed = await asyncio.gather(
            tool("lifecycle", "get", "camera", "--json"),
            tool("lifecycle", "list", "/camera"),
            tool("lifecycle", "set", "/camera", "3"),
        )
        assert json.loads(state.out) == {"id": 2, "label": "inactive"}
        assert "- activate [3]\n    Start: inactive\n    Goal: activating\n" in possible.out
        assert (failed.code, failed.err) == (1, "error: Transitioning failed\n")


async def test_what_cannot_be_done_says_why(memory: World, tool: Tool) -> None:
    memory.node("plain")
    async with Camera("camera", context=memory.context()):
        unknown, plain, missing, every = await asyncio.gather(
            tool("lifecycle", "set", "/camera", "activate"),
            tool("lifecycle", "get", "/plain"),
            tool("lifecycle", "get", "/camer", "--timeout", "1"),
            tool("lifecycle", "list", "/camera", "-a", "--json"),
        )
    assert "possible now: configure [1]" in unknown.err
    assert plain.err == "error: /plain is not a lifecycle node: it does not serve /plain/get_state\n"
    assert 'did you mean "/camera"?' in missing.err
    assert {unknown.code, plain.code, missing.code} == {1}
    assert len(json.loads(every.out)) > 20


async def test_services_that_come_after_the_name_of_their_node_are_waited_for(memory: World, tool: Tool) -> None:
    late, answer = memory.node("late"), GetState.Response()
    answer.current_state.id, answer.current_state.label = 2, "inactive"
    asyncio.get_running_loop().call_later(2, late.create_service, GetState, "/late/get_state", lambda _: answer)
    assert (await tool("lifecycle", "get", "/late")).out == "inactive [2]\n"


async def test_all_lifecycle_nodes_are_asked_at_once(memory: World, tool: Tool) -> None:
    silent = memory.node("silent")
    servers = [silent.create_service(GetState, "/silent/get_state"), silent.create_client(GetState, "/gone/get_state")]
    async with Camera("camera", context=memory.context()), Camera("_hidden", context=memory.context()):
        nodes, states = await asyncio.gather(
            tool("lifecycle", "nodes", "--spin-time", "1.25"),
            tool("lifecycle", "get", "--timeout", "1.25", "--spin-time", "1.25"),
        )
    assert nodes.out == "/camera\n/silent\n"
    assert (states.code, states.out) == (0, "/camera: unconfigured [1]\n")
    assert re.fullmatch("/silent: no response from /silent/get_state .*\n", states.err)
    assert servers
