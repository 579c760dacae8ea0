"""Many goals at once, cancelled at random, by a server that refuses at random: python examples/random_cancel.py 8

Every goal counts to ten. Its client cancels it after some time, which the server may refuse, and which may come too
late. Whatever happens, both sides agree about the end. Seen, other lines each time:

    goal 0: cancel after 0.31 s, accepted: CANCELED at 4
    goal 1: cancel after 0.78 s, refused: SUCCEEDED at 10
    goal 2: cancel after 1.13 s, too late: SUCCEEDED at 10
    ...
    the server ended 3 goals: 2 SUCCEEDED, 1 CANCELED
"""

import asyncio
import random
import sys
from collections import Counter

from example_interfaces.action import Fibonacci

from rosidl_py_gen.runtime import (
    ActionClient,
    AlreadyTerminatedError,
    CancelRejectedError,
    GoalResult,
    Node,
    ServerGoal,
    UnknownGoalError,
    run,
)

Goal = ServerGoal[Fibonacci]
ends: Counter[str] = Counter()


async def count(goal: Goal) -> Fibonacci.Result | GoalResult:
    for number in range(1, goal.request.order + 1):
        await asyncio.sleep(0.08)  # something that takes its time
        if goal.is_cancel_requested:  # true once `agrees` has agreed
            ends["CANCELED"] += 1
            return goal.canceled(Fibonacci.Result(sequence=[number]))
    ends["SUCCEEDED"] += 1
    return Fibonacci.Result(sequence=[goal.request.order])


def agrees(_: Goal) -> bool:
    """Asked about every cancel; the goal goes on as if nothing had happened where this is false."""
    return random.random() < 0.6


async def one_goal(client: ActionClient[Fibonacci], number: int) -> None:
    goal = await client.send_goal(Fibonacci.Goal(order=10), timeout_s=10)
    patience_s = random.uniform(0.1, 1.5)
    await asyncio.sleep(patience_s)
    try:
        await goal.cancel(timeout_s=10)
        outcome = "accepted"
    except CancelRejectedError:
        outcome = "refused"
    except (AlreadyTerminatedError, UnknownGoalError):  # it has ended meanwhile
        outcome = "too late"
    status, result = await goal.result(timeout_s=10)
    end = f"{status.name} at {result.sequence[0]}"
    print(f"goal {number}: cancel after {patience_s:.2f} s, {outcome}: {end}", flush=True)


async def main() -> None:
    goals = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    async with Node("server") as server, Node("client") as node:
        server.create_action_server(Fibonacci, "count", count, cancel_callback=agrees)
        client = node.create_action_client(Fibonacci, "count")
        await asyncio.gather(*(one_goal(client, number) for number in range(goals)))
    print(f"the server ended {ends.total()} goals: " + ", ".join(f"{n} {name}" for name, n in sorted(ends.items())))


run(main)
