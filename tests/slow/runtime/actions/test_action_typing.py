"""Types of actions under mypy --strict."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.folders import ROOT
from support.generated_packages import GENERATED

PROGRAM = """
from collections.abc import Callable
from typing import Any

from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from typing_extensions import assert_type

from rosidl_py_gen import get_action
from rosidl_py_gen.cdr import Action
from rosidl_py_gen.runtime import ActionClient, ActionServer, ClientGoal, GoalDecision, GoalStatus, Node, ServerGoal
from rosidl_py_gen.runtime.actions.server_goal import GoalResult

node = Node("n")

async def execute(goal: ServerGoal[Fibonacci]) -> Fibonacci.Result | GoalResult:
    assert_type(goal.request, Fibonacci.Goal)
    goal.publish_feedback(Fibonacci.Feedback())
    if goal.is_cancel_requested:
        return goal.canceled(Fibonacci.Result())
    assert_type(await goal.started(), bool)
    return Fibonacci.Result()


async def only_a_result(goal: ServerGoal[Fibonacci]) -> Fibonacci.Result:
    return Fibonacci.Result()


def plain(goal: ServerGoal[Fibonacci]) -> Fibonacci.Result | None:
    goal.abort()
    return None


def anything(goal: Any) -> Any: ...


def accept(goal: Fibonacci.Goal) -> GoalDecision:
    return GoalDecision.DEFER if goal.order > 3 else GoalDecision.ACCEPT


async def on_cancel(goal: ServerGoal[Fibonacci]) -> bool:
    return goal.request.order > 3


async def servers() -> None:
    server = node.create_action_server(Fibonacci, "c", execute, goal_callback=accept, cancel_callback=on_cancel)
    assert_type(server, ActionServer[Fibonacci])
    assert_type(server.goals, list[ServerGoal[Fibonacci]])
    node.create_action_server(Fibonacci, "c", only_a_result, goal_callback=lambda goal: goal.order > 3)
    node.create_action_server(Fibonacci, "c", plain)
    node.create_action_server(Fibonacci, "c", anything)
    node.create_action_server(Fibonacci, "c", lambda goal: goal.succeed(Fibonacci.Result()))
    async for request in node.create_action_server(Fibonacci, "c"):
        assert_type(request.goal, Fibonacci.Goal)
        assert_type(request.accept(), ServerGoal[Fibonacci])
    async for cancel in server.cancel_requests():
        assert_type(cancel.goal, ServerGoal[Fibonacci])


async def clients() -> None:
    client = node.create_action_client(Fibonacci, "c")
    assert_type(client, ActionClient[Fibonacci])
    goal = await client.send_goal(Fibonacci.Goal(order=5))
    assert_type(goal, ClientGoal[Fibonacci])
    assert_type(goal.goal, Fibonacci.Goal)
    async for feedback in goal.feedback():
        assert_type(feedback, Fibonacci.Feedback)
    assert_type(await goal.result(), tuple[GoalStatus, Fibonacci.Result])
    assert_type(client.send_goal_sync(Fibonacci.Goal()), ClientGoal[Fibonacci])
    assert_type(goal.result_sync(), tuple[GoalStatus, Fibonacci.Result])


async def untyped(found: type[Action[Any, Any, Any]]) -> None:
    async def serve(goal: ServerGoal[Any]) -> dict[str, Any]:
        return {"sequence": [goal.request["order"]]}

    node.create_action_server("example_interfaces/action/Fibonacci", "c", serve, goal_callback=lambda g: g["order"] > 3)
    client = node.create_action_client("example_interfaces/action/Fibonacci", "c")
    goal = await client.send_goal({"order": 3})
    print((await goal.result())[1]["sequence"])
    node.create_action_server(found, "c", anything)
    node.create_action_server(get_action("a/action/B"), "c", anything)
    node.create_action_client(get_action("a/action/B"), "c")


async def feedback_is_no_result(goal: ServerGoal[Fibonacci]) -> Fibonacci.Feedback:
    return Fibonacci.Feedback()


def plain_feedback(goal: ServerGoal[Fibonacci]) -> Fibonacci.Feedback:
    return Fibonacci.Feedback()


class Other(Action[Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback]):
    pass


async def of_another_action(goal: ServerGoal[Other]) -> Fibonacci.Result:
    return Fibonacci.Result()


def accept_results(goal: Fibonacci.Result) -> bool:
    return True


def wrong(goal: ServerGoal[Fibonacci]) -> None:
    node.create_action_server(Fibonacci, "c", feedback_is_no_result)  # error: arg-type
    node.create_action_server(Fibonacci, "c", plain_feedback)  # error: arg-type
    node.create_action_server(Fibonacci, "c", of_another_action)  # error: arg-type
    node.create_action_server(Fibonacci, "c", execute, goal_callback=accept_results)  # error: arg-type
    goal.succeed(Fibonacci.Feedback())  # error: arg-type
    goal.publish_feedback(Fibonacci.Result())  # error: arg-type
    goal.request.nothing  # error: attr-defined
    node.create_action_client(Fibonacci, "c").send_goal_sync(Fibonacci.Result())  # error: arg-type
    node.create_action_server(AddTwoInts, "c")  # error: arg-type


def three_arguments(goal: ServerGoal[Fibonacci.Goal, Fibonacci.Result, int]) -> None:  # error: type-arg
    pass
"""


@pytest.mark.needs("mypy")
def test_strict_mypy_accepts_actions_and_reports_wrong_uses(tmp_path: Path) -> None:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--follow-imports=silent", str(path)]
    command.append("--disable-error-code=empty-body")
    environment = {**os.environ, "MYPYPATH": f"{GENERATED.name}{os.pathsep}{ROOT}"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    found = {int(line.split(":")[1]): line.rpartition("[")[2].rstrip("]") for line in errors}
    lines = enumerate(PROGRAM.splitlines(), 1)
    assert found == {number: line.partition("# error: ")[2] for number, line in lines if "# error: " in line}, (
        done.stdout
    )
