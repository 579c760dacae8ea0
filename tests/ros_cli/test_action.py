"""``rosidl-py action`` beside a server of the test's own."""

from __future__ import annotations

import asyncio
import json
import signal
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from support.node_fixtures import until

from rosidl_py_gen import get_message, get_service
from rosidl_py_gen.runtime.qos import ACTION_STATUS

if TYPE_CHECKING:
    from conftest import Tool
    from support.node_fixtures import World

    from rosidl_py_gen.runtime import ServerGoal

TYPE = "example_interfaces/action/Fibonacci"


class Counter:
    """An action server that counts; order 99 never ends, 98 aborts, above that is rejected."""

    def __init__(self, world: World, name: str = "/count", **options: Any) -> None:
        self.node = world.node("counter")
        self.goals: list[ServerGoal[Fibonacci]] = []
        accept = options.pop("accept", lambda goal: goal.order < 100)
        self.server = self.node.create_action_server(Fibonacci, name, self._run, goal_callback=accept, **options)

    async def _run(self, goal: ServerGoal[Fibonacci]) -> Fibonacci.Result | None:
        self.goals.append(goal)
        while goal.request.order == 99 and not goal.is_cancel_requested:
            await asyncio.sleep(0.01)
        if goal.is_cancel_requested:
            goal.canceled(Fibonacci.Result(sequence=[7]))
        elif goal.request.order == 98:
            goal.abort(Fibonacci.Result())
        else:
            for number in range(goal.request.order):
                goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
            return Fibonacci.Result(sequence=[0, 1])
        return None


async def test_a_goal_is_followed_to_its_result(network: World, tool: Tool) -> None:
    counter = Counter(network)
    ended = await tool("action", "send_goal", "/count", "{order: 2}", "--feedback")
    (goal,) = counter.goals
    assert ended.out == (
        "Waiting for an action server to become available...\nSending goal:\n    order: 2\n\n"
        f"Goal accepted with ID: {goal.goal_id.hex()}\n\n"
        "Feedback:\n    sequence:\n    - 0\n\nFeedback:\n    sequence:\n    - 1\n\n"
        "Result:\n    sequence:\n    - 0\n    - 1\n\nGoal finished with status: SUCCEEDED\n"
    )
    assert (ended.code, ended.err) == (0, "")


async def test_a_goal_is_followed_as_lines_of_json(memory: World, tool: Tool) -> None:
    Counter(memory)
    ended = await tool("action", "send_goal", "count", TYPE, "{order: 1}", "--feedback", "--json")
    feedback, end = map(json.loads, ended.out.splitlines())
    assert feedback == {"feedback": {"sequence": [0]}}
    assert (end["status"], end["result"], len(end["goal_id"])) == ("SUCCEEDED", {"sequence": [0, 1]}, 32)


async def test_a_result_with_an_unknown_status_is_an_error_without_traceback(memory: World, tool: Tool) -> None:
    node = memory.node("broken")
    node.create_publisher(Fibonacci.FeedbackMessage, "/count/_action/feedback")
    node.create_publisher(get_message("action_msgs/msg/GoalStatusArray"), "/count/_action/status", ACTION_STATUS)
    cancel: Any = get_service("action_msgs/srv/CancelGoal")
    accepted, result = Fibonacci.SendGoal.Response(accepted=True), Fibonacci.GetResult.Response(status=77)
    accepted.stamp.sec = -5
    node.create_service(Fibonacci.SendGoal, "/count/_action/send_goal", lambda request: accepted)
    node.create_service(cancel, "/count/_action/cancel_goal", lambda request: cancel.Response())
    node.create_service(Fibonacci.GetResult, "/count/_action/get_result", lambda request: result)
    ended = await tool("action", "send_goal", "/count", TYPE, "{order: 1}")
    assert ended.code == 1 and "Goal accepted" in ended.out
    assert ended.err.startswith("error: action server /count sent a result of goal ") and ended.err.count("\n") == 1


async def test_ctrl_c_cancels_the_goal_and_waits_for_its_end(memory: World, tool: Tool) -> None:
    counter = Counter(memory)
    process = await tool.start("action", "send_goal", "/count", "{order: 99}")
    await until(lambda: bool(counter.goals), 15)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert (ended.code, ended.err) == (130, "Canceling goal...\n")
    assert ended.out.endswith("Result:\n    sequence:\n    - 7\n\nGoal finished with status: CANCELED\n")


async def test_ctrl_c_cancels_a_goal_that_is_not_accepted_yet(memory: World, tool: Tool) -> None:
    asked = asyncio.Event()

    async def accept(goal: Fibonacci.Goal) -> bool:
        asked.set()
        await asyncio.sleep(0.5)
        return True

    counter = Counter(memory, accept=accept)
    process = await tool.start("action", "send_goal", "/count", "{order: 99}")
    await asyncio.wait_for(asked.wait(), 15)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert (ended.code, ended.out.splitlines()[-1]) == (130, "Goal finished with status: CANCELED")
    assert counter.goals


async def test_a_goal_that_cannot_be_canceled_may_still_be_running(memory: World, tool: Tool) -> None:
    counter = Counter(memory, cancel_callback=False)
    process = await tool.start("action", "send_goal", "/count", "{order: 99}", "--timeout", "1.5")
    await until(lambda: bool(counter.goals), 15)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert ended.code == 1
    assert "refused to cancel" in ended.err
    assert "error: the goal may still be running: no result" in ended.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["/count", "{order: 98}"], ""),
        (["/count", "{order: 100}"], "error: Goal was rejected.\n"),
        (["/count", "{order: many}"], "Fibonacci_Goal.order"),
        (["/count", "{order: 1", "--json"], "error: not YAML"),
        (["/count", "std_srvs/action/Empty"], f"action /count has type {TYPE}, not std_srvs/action/Empty"),
        (["/cont", "--timeout", "1"], 'did you mean "/count"?'),
    ],
)
async def test_a_goal_that_does_not_succeed_is_a_failure(
    memory: World, tool: Tool, words: list[str], said: str
) -> None:
    Counter(memory)
    ended = await tool("action", "send_goal", *words)
    assert ended.code == 1
    assert said in ended.err
    assert "Traceback" not in ended.err
    assert said or ended.out.endswith("Goal finished with status: ABORTED\n")


async def test_a_server_that_answers_no_goal_is_an_error(memory: World, tool: Tool) -> None:
    async def accept(goal: Fibonacci.Goal) -> bool:
        await asyncio.sleep(60)
        return True

    Counter(memory, accept=accept)
    ended = await tool("action", "send_goal", "/count", "--timeout", "1.5")
    assert (ended.code, ended.err) == (1, "error: action /count: no reply to the goal in 1.5 s\n")


async def test_list_type_find_and_info_know_actions(memory: World, tool: Tool) -> None:
    counter = Counter(memory)
    memory.node("asker").create_action_client(Fibonacci, "/count")
    listed, found, typed, info, as_json = await asyncio.gather(
        tool("action", "list", "-t", "--spin-time", "1.5"),
        tool("action", "find", TYPE, "--spin-time", "1.5"),
        tool("action", "type", "/count"),
        tool("action", "info", "/count", "-t", "--spin-time", "1.5"),
        tool("action", "info", "/count", "--json", "--spin-time", "1.5"),
    )
    assert (listed.out, found.out, typed.out) == (f"/count [{TYPE}]\n", "/count\n", f"{TYPE}\n")
    assert info.out == (
        f"Action: /count\nAction clients: 1\n    /asker [{TYPE}]\nAction servers: 1\n    /counter [{TYPE}]\n"
    )
    assert json.loads(as_json.out)["servers"] == [{"node": counter.node.fully_qualified_name, "types": [TYPE]}]
