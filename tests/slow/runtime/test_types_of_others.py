"""Types that only one process defines; another process uses its topic, service and action."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from support.inner_state import type_fields
from support.processes import python_process

from rosidl_py_gen import TypeNotFoundError, get_message, type_name

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.worlds import World

ROBOT = """
import asyncio, sys
from rosidl_py_gen import compile_definition
from rosidl_py_gen.runtime import Node

Part = "=" * 80 + "\\nMSG: robot_only_msgs/Part\\nstring<=8 word\\nuint8 FRESH=3\\nuint8 state 3\\n"
NOTE = "std_msgs/Header header\\nPart[] parts\\nfloat32[3] where\\n" + Part
Note = compile_definition("robot_only_msgs/msg/Note", NOTE)
Ask = compile_definition("robot_only_msgs/srv/Ask", "Part part\\nint32 times 2\\n---\\nstring[] words\\n" + Part)
WALK = "float32 metres 1.5\\n---\\nPart part\\n---\\nint32 steps\\n" + Part
Walk = compile_definition("robot_only_msgs/action/Walk", WALK)
PartClass = Note._TYPE.fields[1].cls

async def walk(goal):
    goal.publish_feedback(Walk.Feedback(steps=7))
    return Walk.Result(part=PartClass(word=str(goal.request.metres)))

async def main():
    async with Node("robot") as node:
        publisher = node.create_publisher(Note, "notes")
        node.create_service(Ask, "ask", lambda request: Ask.Response(words=[request.part.word] * request.times))
        node.create_action_server(Walk, "walk", walk)
        print("READY", flush=True)
        reading = asyncio.ensure_future(asyncio.to_thread(sys.stdin.readline))
        while not reading.done():
            publisher.publish(Note(parts=[PartClass(word="a"), PartClass(word="b", state=9)], where=[1.0, 2.0, 3.0]))
            await asyncio.sleep(0.05)

asyncio.run(main())
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path))


@pytest.fixture
def robot(network: World) -> Iterator[None]:
    """Process with a node and its own definitions."""
    with python_process(ROBOT) as process:
        assert process.stdin is not None and process.stdout is not None
        assert process.stdout.readline() == "READY\n"
        yield
        process.stdin.write("end\n")
        process.stdin.flush()
        assert process.wait(60) == 0


@pytest.mark.usefixtures("robot")
async def test_types_defined_only_in_another_process_are_resolved_and_used(network: World) -> None:
    with pytest.raises(TypeNotFoundError):
        get_message("robot_only_msgs/msg/Note")
    node = network.node("stranger")
    note: Any = await node.resolve_type("notes", timeout_s=10)
    message = await node.create_subscription(note, "notes").receive(10)
    assert [(part.word, part.state) for part in message.parts] == [("a", 3), ("b", 9)]
    assert list(message.where) == [1.0, 2.0, 3.0]
    header, part = (type_fields(note)[index].cls for index in (0, 1))
    assert header is get_message("std_msgs/msg/Header")

    ask: Any = await node.resolve_service_type("ask", timeout_s=10)
    assert type_name(ask) == "robot_only_msgs/srv/Ask" and type_fields(ask.Request)[0].cls is part
    client = node.create_client(ask, "ask")
    response = await client.call(ask.Request(part=part(word="hey")), timeout_s=10)
    assert response.words == ["hey", "hey"]  # twice is a default of the definition

    walk: Any = await node.resolve_action_type("walk", timeout_s=10)
    action = node.create_action_client(walk, "walk")
    assert await action.wait_for_server(10)
    goal = await action.send_goal(walk.Goal(), timeout_s=10)
    assert [one.steps async for one in goal.feedback()] == [7]
    _, result = await goal.result(timeout_s=10)
    assert result.part.word == "1.5"

    assert await node.resolve_type("walk/_action/feedback", timeout_s=10) is walk.FeedbackMessage
    assert await node.resolve_service_type("walk/_action/send_goal", timeout_s=10) is walk.SendGoal
