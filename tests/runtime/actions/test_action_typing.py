"""Types of actions under mypy --strict."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.node_fixtures import ROOT

from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import generate

HEAD = """
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
"""
PROGRAM = """
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
"""
WRONG = {
    "a handler that returns feedback": (
        "async def execute(goal: ServerGoal[Fibonacci]) -> Fibonacci.Feedback: ...\n"
        'node.create_action_server(Fibonacci, "c", execute)',
        "arg-type",
    ),
    "a plain handler that returns feedback": (
        "def execute(goal: ServerGoal[Fibonacci]) -> Fibonacci.Feedback: ...\n"
        'node.create_action_server(Fibonacci, "c", execute)',
        "arg-type",
    ),
    "a handler of another action": (
        "class Other(Action[Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback]): ...\n"
        "async def execute(goal: ServerGoal[Other]) -> Fibonacci.Result: ...\n"
        'node.create_action_server(Fibonacci, "c", execute)',
        "arg-type",
    ),
    "an accept callback for another type": (
        "def accept(goal: Fibonacci.Result) -> bool: ...\n"
        "async def execute(goal: ServerGoal[Fibonacci]) -> Fibonacci.Result: ...\n"
        'node.create_action_server(Fibonacci, "c", execute, goal_callback=accept)',
        "arg-type",
    ),
    "another result": ("def f(goal: ServerGoal[Fibonacci]) -> None: goal.succeed(Fibonacci.Feedback())", "arg-type"),
    "another feedback": (
        "def f(goal: ServerGoal[Fibonacci]) -> None: goal.publish_feedback(Fibonacci.Result())",
        "arg-type",
    ),
    "no such field": ("def f(goal: ServerGoal[Fibonacci]) -> None: goal.request.nothing", "attr-defined"),
    "another goal": ('node.create_action_client(Fibonacci, "c").send_goal_sync(Fibonacci.Result())', "arg-type"),
    "a service": ('node.create_action_server(AddTwoInts, "c")', "arg-type"),
    "three arguments": ("def f(goal: ServerGoal[Fibonacci.Goal, Fibonacci.Result, int]) -> None: ...", "type-arg"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("typing")
    generate(scan_search_path([interfaces_dir()], ament="", bundled=False), ["example_interfaces"], made)
    return made


def check(folder: Path, program: str) -> str:
    path = folder / "program.py"
    path.write_text(HEAD + program)
    flags = ["--strict", "--no-error-summary", "--follow-imports=silent", "--disable-error-code=empty-body"]
    environment = {**os.environ, "MYPYPATH": f"{folder}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "mypy", *flags, str(path)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False).stdout


@pytest.mark.needs("mypy")
def test_actions_under_strict_mypy(folder: Path) -> None:
    assert check(folder, PROGRAM) == ""


@pytest.mark.needs("mypy")
def test_every_wrong_type_is_an_error_of_its_own(folder: Path) -> None:
    names = list(WRONG)
    functions = [f"def wrong{n}() -> None:\n" + _indented(WRONG[name][0]) for n, name in enumerate(names)]
    lines = (HEAD + "\n".join(functions)).splitlines()
    starts = [lines.index(f"def wrong{n}() -> None:") + 1 for n in range(len(names))]
    found: dict[str, set[str]] = {name: set() for name in names}
    for line in check(folder, "\n".join(functions)).splitlines():
        if ": error: " in line:
            number = int(line.split(":")[1])
            name = names[max(n for n, start in enumerate(starts) if start <= number)]
            found[name].add(line.rpartition("[")[2].rstrip("]"))
    assert found == {name: {code} for name, (_, code) in WRONG.items()}


def _indented(text: str) -> str:
    return "\n".join("    " + line for line in text.splitlines())
