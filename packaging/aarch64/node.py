"""A node that offers a peer everything, and asks for everything it offers: topic, service, action, parameter.

``node.py SHARE``: SHARE has the definitions of test_msgs. The peer is peer.py; README.md says how both are run.
"""

from __future__ import annotations

import asyncio
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.runtime import Context, Node, QoSProfile, ServerGoal, run

LIMIT_S = 120.0
"""Emulated processes are some twenty times slower."""
CALLS = 200
SHARE = sys.argv[1]
String = get_message("std_msgs/msg/String")
SetBool = get_service("std_srvs/srv/SetBool")
Fibonacci = get_action("test_msgs/action/Fibonacci", path=SHARE)


def generated() -> str:
    """Run the generator and the codec."""
    with tempfile.TemporaryDirectory() as folder:
        generate(scan_search_path([interfaces_dir()], ament="", bundled=False), ["geometry_msgs"], Path(folder))
        files = sum(1 for _ in Path(folder).rglob("*.py"))
    cls = get_message("geometry_msgs/msg/PoseStamped")
    pose = cls()
    pose.pose.orientation.w = 0.5
    assert cls.decode(pose.encode()) == pose
    return f"generated {files} files; {cls.__name__} to {len(pose.encode())} bytes and back"


async def count(goal: ServerGoal[Any]) -> Any:
    for number in range(goal.request.order):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        await asyncio.sleep(0.1)
    return Fibonacci.Result(sequence=list(range(goal.request.order)))


async def main() -> None:
    print(platform.machine(), "CPython", platform.python_version(), generated(), sep=", ", flush=True)
    async with Context(discovery="localhost") as context, Node("arm", context=context) as node:
        print(context.middleware, dict(context.library_capabilities), flush=True)
        node.declare_parameter("speed", 1.5)
        node.create_service(SetBool, "arm_set", lambda request: SetBool.Response(success=request.data, message="arm"))
        node.create_action_server(Fibonacci, "arm_count", count)
        said = node.create_publisher(String, "arm_says", QoSProfile().transient_local())
        said.publish(String(data="from aarch64"))
        heard = node.create_subscription(String, "peer_says", qos=QoSProfile().transient_local())
        print("topic:", (await heard.receive(timeout_s=LIMIT_S)).data, flush=True)
        client = node.create_client(SetBool, "peer_set")
        await client.wait_for_service(timeout_s=LIMIT_S)
        for number in range(CALLS):
            response = await client.call(SetBool.Request(data=number % 2 == 0), timeout_s=LIMIT_S)
            assert response.success == (number % 2 == 0)
        print("service:", CALLS, "calls,", response.message, flush=True)
        actions = node.create_action_client(Fibonacci, "peer_count")
        await actions.wait_for_server(timeout_s=LIMIT_S)
        goal = await actions.send_goal(Fibonacci.Goal(order=5), timeout_s=LIMIT_S)
        steps = [list(step.sequence) async for step in goal.feedback()]
        status, result = await goal.result(timeout_s=LIMIT_S)
        print("action:", status.name, list(result.sequence), "after", len(steps), "times feedback", flush=True)
        parameters = node.create_parameter_client("peer")
        (answer,) = await parameters.set({"speed": 4.5}, timeout_s=LIMIT_S)
        print("parameter:", answer, await parameters.get("speed", timeout_s=LIMIT_S), flush=True)
        while node.get_parameter("speed") != 2.5:  # the peer sets it, last of all
            await asyncio.sleep(0.1)
        print("done: the peer has set ours", flush=True)


run(main)
