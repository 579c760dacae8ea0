"""Send a goal and follow it; then another one, and cancel that: python examples/fibonacci_client.py 5

Needs fibonacci_server.py in another terminal. Seen: ``so far: 0 1 1`` and so on, ``SUCCEEDED: 0 1 1 2 3 5``,
``CANCELED after 3 of 41 numbers``.
"""

import sys

from example_interfaces.action import Fibonacci

from rosidl_py_gen.runtime import Node, run


async def main() -> None:
    order = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    async with Node("fibonacci_client") as node:
        client = node.create_action_client(Fibonacci, "fibonacci")
        goal = await client.send_goal(Fibonacci.Goal(order=order), timeout_s=10)
        async for feedback in goal.feedback():  # ends when the result is in
            print("so far:", *feedback.sequence, flush=True)
        status, result = await goal.result(timeout_s=60)
        print(f"{status.name}:", *result.sequence, flush=True)

        goal = await client.send_goal(Fibonacci.Goal(order=40), timeout_s=10)
        async for _ in goal.feedback():
            await goal.cancel(timeout_s=10)  # raises CancelRejectedError, UnknownGoalError or AlreadyTerminatedError
            break
        status, result = await goal.result(timeout_s=60)
        print(f"{status.name} after {len(result.sequence)} of 41 numbers", flush=True)


run(main)
