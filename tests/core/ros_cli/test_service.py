"""``rosidl-py service`` and ``rosidl-py action`` with servers of the test."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from geometry_msgs.msg import Polygon, TransformStamped
from std_msgs.msg import UInt8MultiArray
from support.waiting import until

from rosidl_py_gen import get_message, get_service
from rosidl_py_gen.ros_cli.message_text import rclpy_repr
from rosidl_py_gen.runtime import IntrospectionState
from rosidl_py_gen.runtime.qos import ACTION_STATUS, SERVICES_DEFAULT

if TYPE_CHECKING:
    from pathlib import Path

    from support.commands import Tool
    from support.worlds import World

    from rosidl_py_gen.runtime import Node, ServerGoal, ServiceServer


ADD = "example_interfaces/srv/AddTwoInts"


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return AddTwoInts.Response(sum=request.a + request.b)


def serve(world: World) -> tuple[Node, ServiceServer[Any, Any]]:
    node = world.node("adder")
    return node, node.create_service(AddTwoInts, "/add", add)


@pytest.mark.slow
async def test_service_call_prints_request_and_response(network: World, tool: Tool) -> None:
    serve(network)
    ended = await tool("service", "call", "/add", "{a: 1, b: 2}")
    assert ended.out == (
        "requester: making request: example_interfaces.srv.AddTwoInts_Request(a=1, b=2)\n\n"
        "response:\nexample_interfaces.srv.AddTwoInts_Response(sum=3)\n\n"
    )
    assert (ended.code, ended.err) == (0, "")
    ended = await tool("service", "call", "add", ADD, "--stdin", "--json", stdin='{"a": 40, "b": 2}')
    assert (ended.code, json.loads(ended.out)) == (0, {"sum": 42})


@pytest.mark.slow
async def test_service_call_uses_definition_of_server(network: World, tool: Tool, tmp_path: Path) -> None:
    package = tmp_path / "example_interfaces"
    (package / "srv").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>example_interfaces</name></package>")
    (package / "srv" / "AddTwoInts.srv").write_text("int64 other\n---\nint64 sum\n")
    serve(network)
    ended = await tool("service", "call", "/add", ADD, "{a: 1, b: 2}", "--json", "--path", str(tmp_path))
    assert (ended.code, ended.out, ended.err) == (0, '{"sum": 3}\n', "")


async def test_service_call_repeats_at_rate_until_interrupted(memory: World, tool: Tool) -> None:
    serve(memory)
    process = await tool.start("service", "call", "/add", "{a: 1}", "--rate", "50", "--json")
    assert process.stdout is not None
    assert [await process.stdout.readline() for _ in range(3)] == [b'{"sum": 1}\n'] * 3
    assert (await tool.interrupt(process)).code == 0


async def test_service_call_without_reply_times_out(memory: World, tool: Tool) -> None:
    node = memory.node("silent")
    server = node.create_service(AddTwoInts, "/never")
    ended = await tool("service", "call", "/never", "--timeout", "1")
    assert ended.code == 1
    assert ended.err == f"error: no response from /never ({ADD}) in 1 s\n"
    assert server is not None


@pytest.mark.slow
async def test_ctrl_c_ends_pending_service_call(memory: World, tool: Tool) -> None:
    server = memory.node("silent").create_service(AddTwoInts, "/never")
    process = await tool.start("service", "call", "/never")
    await asyncio.wait_for(server.__anext__(), 10)
    ended = await tool.interrupt(process)
    assert (ended.code, ended.err) == (130, "")


@pytest.mark.parametrize(
    ("words", "expected_text"),
    [
        (["/add", "{a: 1"], "error: not YAML: 2:1: "),
        (["/add", "{c: 1}"], 'unknown field "c"'),
        (["/add", "{a: x}"], "AddTwoInts_Request.a"),
        (["/add", "std_srvs/srv/Empty"], f"service /add has type {ADD}, not std_srvs/srv/Empty"),
        (["/ad", "--timeout", "1"], 'did you mean "/add"?'),
    ],
)
async def test_invalid_service_calls_are_reported(
    memory: World, tool: Tool, words: list[str], expected_text: str
) -> None:
    serve(memory)
    ended = await tool("service", "call", *words)
    assert (ended.code, ended.out, expected_text in ended.err, "Traceback" in ended.err) == (1, "", True, False), (
        ended.err
    )


async def test_service_list_hides_services_of_actions(memory: World, tool: Tool) -> None:
    node, _ = serve(memory)
    node.create_action_server("example_interfaces/action/Fibonacci", "/count", lambda goal: {})
    ended = await tool("service", "list", "-t")
    assert f"/add [{ADD}]" in ended.out.splitlines()
    assert "_action" not in ended.out
    found = {one["name"]: one for one in json.loads((await tool("service", "list", "-a", "--json")).out)}
    assert found["/add"] == {"name": "/add", "types": [ADD], "servers": 1, "clients": 0}
    assert "/count/_action/send_goal" in found


async def test_service_type_find_and_info_print_services(memory: World, tool: Tool) -> None:
    node, _ = serve(memory)
    assert (await tool("service", "type", "/add")).out == f"{ADD}\n"
    assert (await tool("service", "find", "example_interfaces/AddTwoInts")).out == "/add\n"
    node.create_client(AddTwoInts, "/add")
    ended = await tool("service", "info", "/add", "-v")
    assert ended.out.startswith(f"Type: {ADD}\nClients count: 1\nServices count: 1\n\nNode: /adder\n")
    found = json.loads((await tool("service", "info", "/add", "-v", "--json")).out)
    assert [one["endpoint"] for one in found["endpoints"]] == ["SERVER", "CLIENT"]
    assert found["endpoints"][0]["reliability"] == "RELIABLE"


@pytest.mark.slow
async def test_service_echo_prints_requests_and_responses(network: World, tool: Tool) -> None:
    node, server = serve(network)
    server.configure_introspection(node.clock, SERVICES_DEFAULT, IntrospectionState.CONTENTS)
    process = await tool.start("service", "echo", "/add", "--json")
    await until(lambda: node.count_subscribers("/add/_service_event") > 0, 25)
    client = node.create_client(AddTwoInts, "/add")
    assert process.stdout is not None
    first = asyncio.ensure_future(process.stdout.readline())
    while not first.done():  # the command may learn of the publisher of events later than this node of its subscription
        await client.call(AddTwoInts.Request(a=2, b=3), 20)
        await asyncio.wait([first], timeout=1)
    events = [json.loads(await first), json.loads(await process.stdout.readline())]
    assert (await tool.interrupt(process)).code == 0
    assert [one["info"]["event_type"] for one in events] == ["REQUEST_RECEIVED", "RESPONSE_SENT"]
    assert (events[0]["request"], events[1]["response"]) == ([{"a": 2, "b": 3}], [{"sum": 5}])


async def test_service_echo_reports_disabled_introspection(memory: World, tool: Tool) -> None:
    serve(memory)
    process = await tool.start("service", "echo", "/add")
    assert process.stderr is not None
    assert b"introspection is off at all servers and clients of /add" in await process.stderr.readline()
    assert (await tool.interrupt(process)).code == 0


def test_messages_are_formatted_like_rclpy_repr() -> None:
    assert rclpy_repr(UInt8MultiArray(data=np.arange(3, dtype=np.uint8)), None) == (
        "std_msgs.msg.UInt8MultiArray(layout=std_msgs.msg.MultiArrayLayout(dim=[], data_offset=0), data=[0, 1, 2])"
    )
    assert rclpy_repr(UInt8MultiArray(data=np.zeros(200, np.uint8)), 2).endswith("data=[0, 0, ...])")
    assert rclpy_repr(TransformStamped(child_frame_id="a" * 5), 3).count("child_frame_id='aaa'...") == 1
    assert rclpy_repr(Polygon(), 3) == "geometry_msgs.msg.Polygon(points=[])"


FIBONACCI = "example_interfaces/action/Fibonacci"


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


@pytest.mark.slow
async def test_send_goal_prints_feedback_and_result(network: World, tool: Tool) -> None:
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


async def test_send_goal_prints_feedback_and_result_as_json_lines(memory: World, tool: Tool) -> None:
    Counter(memory)
    ended = await tool("action", "send_goal", "count", FIBONACCI, "{order: 1}", "--feedback", "--json")
    feedback, end = map(json.loads, ended.out.splitlines())
    assert feedback == {"feedback": {"sequence": [0]}}
    assert (end["status"], end["result"], len(end["goal_id"])) == ("SUCCEEDED", {"sequence": [0, 1]}, 32)


async def test_goal_result_with_unknown_status_is_an_error(memory: World, tool: Tool) -> None:
    node = memory.node("broken")
    node.create_publisher(Fibonacci.FeedbackMessage, "/count/_action/feedback")
    node.create_publisher(get_message("action_msgs/msg/GoalStatusArray"), "/count/_action/status", ACTION_STATUS)
    cancel: Any = get_service("action_msgs/srv/CancelGoal")
    accepted, result = Fibonacci.SendGoal.Response(accepted=True), Fibonacci.GetResult.Response(status=77)
    accepted.stamp.sec = -5
    node.create_service(Fibonacci.SendGoal, "/count/_action/send_goal", lambda request: accepted)
    node.create_service(cancel, "/count/_action/cancel_goal", lambda request: cancel.Response())
    node.create_service(Fibonacci.GetResult, "/count/_action/get_result", lambda request: result)
    ended = await tool("action", "send_goal", "/count", FIBONACCI, "{order: 1}")
    assert ended.code == 1 and "Goal accepted" in ended.out
    assert ended.err.startswith("error: action server /count sent a result of goal ") and ended.err.count("\n") == 1


@pytest.mark.slow
async def test_ctrl_c_cancels_goal_and_waits_for_result(memory: World, tool: Tool) -> None:
    counter = Counter(memory)
    process = await tool.start("action", "send_goal", "/count", "{order: 99}")
    await until(lambda: bool(counter.goals), 15)
    ended = await tool.interrupt(process)
    assert (ended.code, ended.err) == (130, "Canceling goal...\n")
    assert ended.out.endswith("Result:\n    sequence:\n    - 7\n\nGoal finished with status: CANCELED\n")


@pytest.mark.slow
async def test_ctrl_c_cancels_a_goal_that_is_not_accepted_yet(memory: World, tool: Tool) -> None:
    requested = asyncio.Event()

    async def accept(goal: Fibonacci.Goal) -> bool:
        requested.set()
        await asyncio.sleep(0.5)
        return True

    counter = Counter(memory, accept=accept)
    process = await tool.start("action", "send_goal", "/count", "{order: 99}")
    await asyncio.wait_for(requested.wait(), 15)
    ended = await tool.interrupt(process)
    assert (ended.code, ended.out.splitlines()[-1]) == (130, "Goal finished with status: CANCELED")
    assert counter.goals


async def test_refused_cancellation_reports_that_goal_may_still_run(memory: World, tool: Tool) -> None:
    counter = Counter(memory, cancel_callback=False)
    process = await tool.start("action", "send_goal", "/count", "{order: 99}", "--timeout", "1.5")
    await until(lambda: bool(counter.goals), 15)
    ended = await tool.interrupt(process)
    assert ended.code == 1
    assert "refused to cancel" in ended.err
    assert "error: the goal may still be running: no result" in ended.err


@pytest.mark.parametrize(
    ("words", "expected_text"),
    [
        (["/count", "{order: 98}"], ""),
        (["/count", "{order: 100}"], "error: Goal was rejected.\n"),
        (["/count", "{order: many}"], "Fibonacci_Goal.order"),
        (["/count", "{order: 1", "--json"], "error: not YAML"),
        (["/count", "std_srvs/action/Empty"], f"action /count has type {FIBONACCI}, not std_srvs/action/Empty"),
        (["/cont", "--timeout", "1"], 'did you mean "/count"?'),
    ],
)
async def test_unsuccessful_goals_are_an_error(memory: World, tool: Tool, words: list[str], expected_text: str) -> None:
    Counter(memory)
    ended = await tool("action", "send_goal", *words)
    assert (ended.code, expected_text in ended.err, "Traceback" in ended.err) == (1, True, False), ended.err
    assert expected_text or ended.out.endswith("Goal finished with status: ABORTED\n")


async def test_goal_request_without_reply_times_out(memory: World, tool: Tool) -> None:
    async def accept(goal: Fibonacci.Goal) -> bool:
        await asyncio.sleep(60)
        return True

    Counter(memory, accept=accept)
    ended = await tool("action", "send_goal", "/count", "--timeout", "1.5")
    assert (ended.code, ended.err) == (1, "error: action /count: no reply to the goal in 1.5 s\n")


async def test_action_list_type_find_and_info_print_actions(memory: World, tool: Tool) -> None:
    counter = Counter(memory)
    memory.node("asker").create_action_client(Fibonacci, "/count")
    listed, found, typed, info, as_json = await asyncio.gather(
        tool("action", "list", "-t", "--spin-time", "1.5"),
        tool("action", "find", FIBONACCI, "--spin-time", "1.5"),
        tool("action", "type", "/count"),
        tool("action", "info", "/count", "-t", "--spin-time", "1.5"),
        tool("action", "info", "/count", "--json", "--spin-time", "1.5"),
    )
    assert (listed.out, found.out, typed.out) == (f"/count [{FIBONACCI}]\n", "/count\n", f"{FIBONACCI}\n")
    assert info.out == (
        f"Action: /count\nAction clients: 1\n    /asker [{FIBONACCI}]\nAction servers: 1\n    /counter [{FIBONACCI}]\n"
    )
    assert json.loads(as_json.out)["servers"] == [{"node": counter.node.fully_qualified_name, "types": [FIBONACCI]}]
