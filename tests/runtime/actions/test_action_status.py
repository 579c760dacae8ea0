"""When the status topic is written: completely, in order, and behind the responses that a change belongs to."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
from action_worlds import Fibonacci, goal, pair, result
from worlds import World, take, until

from rosidl_py_gen.msgs.action_msgs.msg import GoalStatusArray
from rosidl_py_gen.runtime.actions.states import GoalStatus as S


def record(monkeypatch: pytest.MonkeyPatch, server: Any) -> list[str]:
    """What an action server writes from now on, in order, by the last part of the topic."""
    written: list[str] = []
    endpoints = [server._goals._status._publisher, server._goals.feedback, *server._services]
    for writer in (endpoint._writer for endpoint in endpoints):
        owner = next(one for one in endpoints if one._writer is writer)
        name = str(getattr(owner, "topic", None) or owner.name).rpartition("/")[2]

        def write(data: Any, name: str = name, inner: Any = writer.write) -> bool:
            written.append(f"{name} {data[-1]}" if name == "status" else name)
            done: bool = inner(data)
            return done

        monkeypatch.setattr(writer, "write", write)
        if hasattr(owner, "_write"):
            monkeypatch.setattr(owner, "_write", write)
    return written


async def at_once(handle: Any) -> Any:
    return result(1)


async def test_every_transition_of_immediate_goals_is_published_in_order(world: World) -> None:
    seen: list[list[int]] = []

    _, client = await pair(world, at_once)
    watcher = world.node("watcher").create_subscription(
        GoalStatusArray, "fib/_action/status", lambda m: seen.append([row.status for row in m.status_list]), 100
    )
    assert await watcher.wait_for_publishers(timeout_s=5)
    await asyncio.sleep(0.05)
    for _ in range(3):
        await (await client.send_goal(goal(), timeout_s=5)).result(timeout_s=5)
    await until(lambda: len(seen) >= 6)
    assert seen == [[2], [4], [4, 2], [4, 4], [4, 4, 2], [4, 4, 4]]


@pytest.mark.parametrize("accept", [None, lambda request: True])
async def test_the_response_is_sent_before_the_status(
    world: World, monkeypatch: pytest.MonkeyPatch, accept: Any
) -> None:
    server, client = await pair(world, at_once, accept=accept)
    written = record(monkeypatch, server)
    await (await client.send_goal(goal(), timeout_s=5)).result(timeout_s=5)
    await until(lambda: len(written) >= 4)
    assert written[:2] == ["send_goal", "status 2"]
    assert sorted(written[2:]) == ["get_result", "status 4"]


async def test_feedback_follows_the_status_before_it(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    server, client = await pair(world, None)
    written = record(monkeypatch, server)
    asked = asyncio.ensure_future(client.send_goal(goal(), timeout_s=5))
    handle = (await take(server.__aiter__())).accept()
    handle.publish_feedback(Fibonacci.Feedback(sequence=[1]))
    handle.succeed(result(1))
    await (await asked).result(timeout_s=5)
    await until(lambda: "status 4" in written)
    assert [one for one in written if one[0] in "sf" and one != "send_goal"] == ["status 2", "feedback", "status 4"]


async def test_other_threads_return_when_the_status_is_published(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    server, client = await pair(world, None)
    asked = asyncio.ensure_future(client.send_goal(goal(), timeout_s=5))
    handle = (await take(server.__aiter__())).accept()
    await asked
    written = record(monkeypatch, server)
    at_return: list[str] = []

    def end() -> None:
        handle.succeed(result(1))
        at_return.extend(written)

    thread = threading.Thread(target=end)
    thread.start()
    await until(lambda: not thread.is_alive())
    assert "status 4" in at_return


async def test_closing_publishes_what_is_on_its_way(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    server, client = await pair(world, None)
    asked = asyncio.ensure_future(client.send_goal(goal(), timeout_s=5))
    handle = (await take(server.__aiter__())).accept()
    await asked
    written = record(monkeypatch, server)
    handle.succeed(result(1))
    assert handle.status is S.SUCCEEDED and "status 4" not in written
    world.nodes[0].close()
    assert written == ["status 4"]
