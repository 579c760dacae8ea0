"""Count Fibonacci numbers for whoever asks: python examples/fibonacci_server.py, stop with Ctrl-C.

Many goals at once, each can be cancelled. Seen: ``cancelled after 4 numbers``, when fibonacci_client.py was there.
"""

import asyncio

from example_interfaces.action import Fibonacci

from rosidl_py_gen.runtime import GoalResult, Node, ServerGoal, run


async def execute(goal: ServerGoal[Fibonacci]) -> Fibonacci.Result | GoalResult:
    sequence = [0, 1]
    for _ in range(goal.request.order - 1):
        if goal.is_cancel_requested:
            print(f"cancelled after {len(sequence)} numbers", flush=True)
            return goal.canceled(Fibonacci.Result(sequence=sequence))
        sequence.append(sequence[-2] + sequence[-1])
        goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        await asyncio.sleep(0.1)  # something that takes its time
    return Fibonacci.Result(sequence=sequence)  # the goal has succeeded


async def main() -> None:
    async with Node("fibonacci_server") as node:
        node.create_action_server(Fibonacci, "fibonacci", execute)
        await asyncio.Event().wait()


run(main)
