"""Program with a slow plain action handler, which its parent interrupts with Ctrl-C; loopback only."""

from __future__ import annotations

import asyncio
import sys
import time
from typing import Any

from rosidl_py_gen import get_action
from rosidl_py_gen.runtime import Context, MemoryTransport, Node, run, spin

Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")
TRANSPORT = MemoryTransport()


def until_cancelled(goal: Any) -> Any:
    print("executing", flush=True)
    while not goal.is_cancel_requested:
        time.sleep(0.02)
    print("ended", flush=True)
    return Fibonacci.Result()


def for_ever(goal: Any) -> Any:
    print("executing", flush=True)
    while True:
        time.sleep(0.02)


def open_node(name: str) -> Node:
    return Node(name, context=Context(0, args=[], transport=TRANSPORT))


async def main(execute: Any) -> None:
    async with open_node("server") as server, open_node("client") as client:
        server.create_action_server(Fibonacci, "fib", execute)
        await client.create_action_client(Fibonacci, "fib").send_goal(Fibonacci.Goal(order=1))
        await asyncio.Event().wait()


def main_with_callbacks(execute: Any) -> None:
    node = open_node("server")
    node.create_action_server(Fibonacci, "fib", execute)
    client = node.create_action_client(Fibonacci, "fib")
    timer: Any = node.create_wall_timer(0.05, lambda: (timer.close(), node._scope.create_task(send(client))))
    spin(node)


async def send(client: Any) -> None:
    await client.send_goal(Fibonacci.Goal(order=1))


if __name__ == "__main__":
    handler = {"until_cancelled": until_cancelled, "for_ever": for_ever}[sys.argv[2]]
    if sys.argv[1] == "asyncio":
        asyncio.run(main(handler))
    elif sys.argv[1] == "run":
        run(main(handler))
    else:
        main_with_callbacks(handler)
