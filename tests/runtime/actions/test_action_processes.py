"""Actions, parameters and type descriptions on DDS between two processes, over loopback only."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import Iterator

import pytest
from peer_process import Fibonacci, open_context, server_process
from support.node_fixtures import SHORT_LEASE, domain_id, run

from rosidl_py_gen import type_hash
from rosidl_py_gen.runtime import ActionServerLostError, GoalStatus, Node, SetResult
from rosidl_py_gen.runtime.parameters.client import ParameterClient, ParameterEvents


@pytest.fixture(params=[{}])
def peer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[bytes]]:
    for name in ("CYCLONEDDS_URI", "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.delenv(name, raising=False)
    with server_process(request.param) as process:
        yield process


def test_an_action_with_feedback_and_cancel(peer: subprocess.Popen[bytes]) -> None:
    async def main() -> None:
        with open_context(domain_id()) as context:
            node = Node("here", context=context)
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
            node.close()

    run(main, 60)


async def until_heard(events: ParameterEvents, remote: ParameterClient) -> None:
    heard = asyncio.ensure_future(events.__anext__())
    while not heard.done():
        await remote.set({"tags": ["again"]}, timeout_s=10)
        await asyncio.wait([heard], timeout=0.1)


def test_parameters_and_type_descriptions(peer: subprocess.Popen[bytes]) -> None:
    async def main() -> None:
        with open_context(domain_id()) as context:
            node = Node("here", context=context)
            remote = node.create_parameter_client("/peer")
            assert await remote.wait_for_services(timeout_s=10)
            events = remote.events()
            await until_heard(events, remote)
            assert await remote.set({"speed": 1.5, "tags": ["x", "y"]}, timeout_s=10) == [SetResult(True)] * 2
            assert await remote.get(["speed", "tags"], timeout_s=10) == [1.5, ("x", "y")]
            refused = await remote.set_atomically({"speed": 5.0}, timeout_s=10)
            assert refused == SetResult(False, "Parameter speed out of range Min: 0.0, Max: 2.0, value: 5.0")
            told = [await asyncio.wait_for(events.__anext__(), 10)]
            while told[-1].event.changed[0].name != "speed":
                told.append(await asyncio.wait_for(events.__anext__(), 10))
            assert (told[-1].node, told[-1].event.changed[0].value.value) == ("/peer", 1.5)
            assert "    speed: 1.5\n" in await remote.dump_yaml(timeout_s=10)
            wanted = type_hash(Fibonacci)
            got = await node.get_type_description("/peer", "", wanted, timeout_s=10)
            assert got.type_description.type_description.type_name == "example_interfaces/action/Fibonacci"
            assert "int32 order" in got.type_sources[0].raw_file_contents
            node.close()

    run(main, 60)


@pytest.mark.parametrize("peer", [SHORT_LEASE], ids=[""], indirect=True)
def test_a_server_that_is_killed_is_noticed(peer: subprocess.Popen[bytes]) -> None:
    async def main() -> None:
        with open_context(domain_id()) as context:
            node = Node("here", context=context)
            client = node.create_action_client(Fibonacci, "fib", server_lost_timeout_s=1.0)
            handle = await client.send_goal(Fibonacci.Goal(order=100_000), timeout_s=10)
            peer.kill()
            with pytest.raises(ActionServerLostError):
                await handle.result(timeout_s=40)
            assert client._goals == {} and not client._result._pending
            node.close()

    run(main, 60)
