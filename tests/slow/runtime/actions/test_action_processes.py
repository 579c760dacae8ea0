"""Actions on DDS between two processes, over loopback only."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest
from peer_process import Fibonacci, open_context, server_process
from support.fibonacci_action import result_client
from support.inner_state import servers_of
from support.local_network import domain_id
from support.waiting import until

from rosidl_py_gen.runtime import Context, GoalStatus, Node, UnknownGoalError


@pytest.fixture
def loopback(monkeypatch: pytest.MonkeyPatch) -> Iterator[Context]:
    for name in ("CYCLONEDDS_URI", "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.delenv(name, raising=False)
    with open_context(domain_id()) as context:
        yield context


async def test_feedback_result_and_cancel_work_across_two_processes(loopback: Context) -> None:
    with server_process({}):
        node = Node("here", context=loopback)
        client = node.create_action_client(Fibonacci, "fib")
        assert await client.wait_for_server(timeout_s=10)
        for _ in range(2):  # also the first goal, when the two processes have just met
            handle = await client.send_goal(Fibonacci.Goal(order=3), timeout_s=10)
            assert [len(item.sequence) async for item in handle.feedback()] == [1, 2, 3]
            status, result = await handle.result(timeout_s=10)
            assert (status, list(result.sequence)) == (GoalStatus.SUCCEEDED, [0, 1, 2])
        burst = await client.send_goal(Fibonacci.Goal(order=-80), timeout_s=10)
        assert [item.sequence[0] async for item in burst.feedback()] == list(range(80))
        slow = await client.send_goal(Fibonacci.Goal(order=10_000), timeout_s=10)
        await asyncio.wait_for(slow.feedback().__anext__(), 10)
        await slow.cancel(timeout_s=10)
        assert (await slow.result(timeout_s=10))[0] is GoalStatus.CANCELED
        handles = [await client.send_goal(Fibonacci.Goal(order=10_000), timeout_s=10) for _ in range(3)]
        assert sorted(await client.cancel_all(timeout_s=10)) == sorted(h.goal_id for h in handles)
        assert {(await h.result(timeout_s=10))[0] for h in handles} == {GoalStatus.CANCELED}


async def test_goal_becomes_unknown_after_its_killed_server_restarts(loopback: Context) -> None:
    lease = "<CycloneDDS><Domain><Discovery><LeaseDuration>60s</LeaseDuration></Discovery></Domain></CycloneDDS>"
    node = Node("here", context=loopback)
    client = node.create_action_client(Fibonacci, "fib")
    with server_process({"CYCLONEDDS_URI": lease}) as process:
        handle = await client.send_goal(Fibonacci.Goal(order=100_000), timeout_s=10)
        old = servers_of(result_client(client))
        await until(node.node_names_complete)  # node names arrive after the endpoints
        process.kill()
        process.wait()
        with server_process({}):
            with pytest.raises(UnknownGoalError, match="does not know goal"):
                await handle.result(timeout_s=40)
            assert old < servers_of(result_client(client)), "the old lease is not over"
