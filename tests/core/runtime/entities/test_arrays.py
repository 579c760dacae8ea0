"""Sequences of fixed-size messages as arrays in services and actions; topics are in test_topics.py."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support.worlds import World

from rosidl_py_gen import compile_definition, dtype, get_message
from rosidl_py_gen.runtime import ServerGoal

pytestmark = pytest.mark.on_zenoh

Point: Any = get_message("geometry_msgs/msg/Point")
Turn: Any = compile_definition("local/srv/Turn", "geometry_msgs/Point[] points\n---\ngeometry_msgs/Point[] turned\n")
POINTS = "geometry_msgs/Point[] points\n"
Sweep: Any = compile_definition("local/action/Sweep", f"{POINTS}---\n{POINTS}---\n{POINTS}")


def three() -> np.ndarray[Any, Any]:
    points = np.zeros(3, dtype(Point))
    points["x"] = (1, 2, 3)
    return points


async def test_service_and_client_receive_arrays_with_arrays_option(world: World) -> None:
    alice, bob = world.pair()
    kinds = []

    def turn(request: Any) -> Any:
        kinds.append(type(request.points))
        turned = request.points.copy()
        turned["x"] *= -1
        return Turn.Response(turned=turned)

    alice.create_service(Turn, "turn", turn, arrays=True)
    for arrays in (True, False):
        client = bob.create_client(Turn, "turn", arrays=arrays)
        response = await client.call(Turn.Request(points=three()), timeout_s=10)
        assert [point["x"] if arrays else point.x for point in response.turned] == [-1, -2, -3]
        assert isinstance(response.turned, np.ndarray) is arrays
    assert kinds == [np.ndarray, np.ndarray]


async def test_action_server_and_client_receive_arrays_with_arrays_option(world: World) -> None:
    alice, bob = world.pair()

    async def sweep(goal: ServerGoal[Any]) -> Any:
        assert goal.request.points["x"].sum() == 6
        goal.publish_feedback(Sweep.Feedback(points=goal.request.points[:1]))
        return Sweep.Result(points=goal.request.points[::-1])

    alice.create_action_server(Sweep, "sweep", sweep, arrays=True)
    client = bob.create_action_client(Sweep, "sweep", arrays=True)
    goal = await client.send_goal(Sweep.Goal(points=three()), timeout_s=10)
    assert [one.points["x"].tolist() async for one in goal.feedback()] == [[1]]
    assert (await goal.result(timeout_s=10))[1].points["x"].tolist() == [3, 2, 1]


def test_arrays_option_is_refused_for_types_named_by_text(memory: World) -> None:
    node = memory.node("n")
    with pytest.raises(TypeError, match="arrays=True needs a"):
        node.create_client("std_srvs/srv/SetBool", "a", arrays=True)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="arrays=True needs a"):
        node.create_action_client("example_interfaces/action/Fibonacci", "a", arrays=True)  # type: ignore[call-overload]
