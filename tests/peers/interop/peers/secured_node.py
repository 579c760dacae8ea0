"""Nodes that the environment secures, for `test_security.py`: prints a line of JSON for each result.

Arguments: a role, and the name of an enclave; of several for the role "open". Further ones are for the role.
"""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import suppress
from typing import Any

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime import Context, Node
from rosidl_py_gen.runtime.node.context import core_of

String: Any = get_message("std_msgs/msg/String")
Add: Any = get_service("example_interfaces/srv/AddTwoInts")
Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
TIMEOUT_S = 8.0


def show(**result: object) -> None:
    print(json.dumps(result), flush=True)


async def talk(node: Node) -> None:
    """Publish on /chatter, and serve /add, /fibonacci and parameters, until the process is killed."""

    async def count(goal: Any) -> Any:
        goal.publish_feedback(Fibonacci.Feedback(sequence=[0, 1]))
        return Fibonacci.Result(sequence=[0, 1, 1])

    node.declare_parameter("color", "red")
    node.create_service(Add, "/add", lambda request: Add.Response(sum=request.a + request.b))
    node.create_action_server(Fibonacci, "/fibonacci", count)
    publisher = node.create_publisher(String, "/chatter")
    show(ready=True)
    number = 0
    while True:
        publisher.publish(String(data=f"secret {number}"))
        number += 1
        await asyncio.sleep(0.02)


async def listen(node: Node) -> None:
    """Use everything that `talk` has."""
    subscription = node.create_subscription(String, "/chatter")
    client, goals = node.create_client(Add, "/add"), node.create_action_client(Fibonacci, "/fibonacci")
    show(received=(await subscription.receive(timeout_s=TIMEOUT_S)).data)
    await client.wait_for_service(TIMEOUT_S)
    show(sum=(await client.call(Add.Request(a=2, b=3), timeout_s=TIMEOUT_S)).sum)
    parameters = node.create_parameter_client("/talk")
    show(color=(await parameters.get(["color"], timeout_s=TIMEOUT_S)))
    await goals.wait_for_server(TIMEOUT_S)
    goal = await goals.send_goal(Fibonacci.Goal(order=2), timeout_s=TIMEOUT_S)
    show(result=[*map(int, (await goal.result(TIMEOUT_S))[1].sequence)])
    show(enclaves={one.fully_qualified_name: one.enclave for one in node.get_nodes()})


async def watch(node: Node) -> None:
    """Report what is seen in two seconds."""
    subscription, received = node.create_subscription(String, "/chatter"), []
    with suppress(RosidlError):
        received = [(await subscription.receive(timeout_s=2)).data]
    show(nodes=[one.name for one in node.get_nodes()], received=received)


async def create(node: Node) -> None:
    """Try to create endpoints."""
    kinds = {
        "publisher": lambda: node.create_publisher(String, "/secret"),
        "subscription": lambda: node.create_subscription(String, "/secret"),
        "service": lambda: node.create_service(Add, "/secret", lambda request: Add.Response()),
        "client": lambda: node.create_client(Add, "/secret"),
    }
    for name, function in kinds.items():
        try:
            function()
            show(**{name: "created"})
        except RosidlError as error:
            show(**{name: f"{type(error).__name__}: {error}"})


async def use(node: Node) -> None:
    """Use programs of others: call the services that further arguments name; "topics" are those that are echoed."""
    publisher = node.create_publisher(String, "/ask_string")
    answers = node.create_subscription(String, "/answer_string")
    sizes, sums = [], []
    if "topics" in sys.argv:
        await publisher.wait_for_subscribers(timeout_s=TIMEOUT_S)
        await answers.wait_for_publishers(timeout_s=TIMEOUT_S)
        for size in (5, 70_000):
            publisher.publish(String(data="x" * size))
            sizes.append(len((await answers.receive(timeout_s=TIMEOUT_S)).data))
    for name in sys.argv[3:]:
        if name != "topics":
            client = node.create_client(Add, name)
            await client.wait_for_service(TIMEOUT_S)
            sums.append((await client.call(Add.Request(a=1, b=41), timeout_s=TIMEOUT_S)).sum)
    show(sizes=sizes, sums=sums)


ROLES = {"talk": talk, "listen": listen, "watch": watch, "create": create, "use": use}


def open_each(enclaves: list[str]) -> None:
    """Open a context of each enclave."""
    for enclave in enclaves:
        try:
            Context(args=["test"], enclave=enclave).close()
            show(**{enclave: "open"})
        except RosidlError as error:
            show(**{enclave: f"{type(error).__name__}: {error}"})


async def main(role: str, enclave: str) -> None:
    if role == "open":
        return open_each(enclave.split(","))
    participant: Any = None
    try:
        async with Context(args=["test"], enclave=enclave) as context, Node(role, context=context) as node:
            participant = core_of(context).participant
            await ROLES[role](node)
    except RosidlError as error:
        show(error=f"{type(error).__name__}: {error}")
    assert participant is None or not participant.fast_dds.has_secured_peers(), "peers of a closed context"


asyncio.run(main(*sys.argv[1:3]))
