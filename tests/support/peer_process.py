"""Second process of the DDS tests: a node with an action; ends with its stdin."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rosidl_py_gen import get_action
from rosidl_py_gen.runtime import Context, Node
from rosidl_py_gen.runtime.transport.cyclone.library import cyclone_xml

Fibonacci: Any = get_action("example_interfaces/action/Fibonacci")


@contextmanager
def server_process(environment: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run this file in another process."""
    from support.folders import ROOT
    from support.local_network import domain_id

    env = {**os.environ, **environment, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, __file__, str(domain_id())]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env)
    try:
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def open_context(domain_id: int) -> Context:
    context = Context(domain_id, discovery="localhost", args=[])
    assert 'address="127.0.0.1"' in cyclone_xml(context.settings, process_id=1)
    return context


async def execute(goal: Any) -> Any:
    done: list[int] = []
    for number in range(-goal.request.order):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
    for number in range(goal.request.order):
        if goal.is_cancel_requested:
            return goal.canceled(Fibonacci.Result(sequence=done))
        done.append(number)
        goal.publish_feedback(Fibonacci.Feedback(sequence=done))
        await asyncio.sleep(0.02 if goal.request.order > 20 else 0)  # so that a cancel finds it under way
    return Fibonacci.Result(sequence=done)


async def main(domain_id: int) -> None:
    with open_context(domain_id) as context:
        async with Node("peer", context=context) as node:
            node.create_action_server(Fibonacci, "fib", execute)
            print("ready", flush=True)
            await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1])))
