"""Status topic: its bytes, and the order of its messages after responses."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
from fibonacci_action import Fibonacci, goal, pair, result, statuses_of
from hypothesis import given
from hypothesis import strategies as st
from support.inner_state import parts_of, transport_end_of
from support.waiting import take, until
from support.worlds import World

from rosidl_py_gen.msgs.action_msgs.msg import GoalStatus, GoalStatusArray
from rosidl_py_gen.runtime import ServiceServer
from rosidl_py_gen.runtime.actions.states import GoalStatus as S
from rosidl_py_gen.runtime.actions.states import StatusArray, find_status


def record(monkeypatch: pytest.MonkeyPatch, server: Any) -> list[str]:
    written: list[str] = []
    for owner in parts_of(server):
        name = str(getattr(owner, "topic", None) or getattr(owner, "name", "")).rpartition("/")[2]
        of, function = (transport_end_of(owner), "send") if isinstance(owner, ServiceServer) else (owner, "_write")
        if not hasattr(of, function):
            continue

        inner = getattr(of, function)

        def write(*sent: Any, name: str = name, inner: Any = inner) -> bool:
            written.append(f"{name} {sent[-1][-1]}" if name == "status" else name)
            done: bool = inner(*sent)
            return done

        monkeypatch.setattr(of, function, write)
    return written


async def at_once(handle: Any) -> Any:
    return result(1)


@pytest.mark.every_transport
async def test_status_topic_publishes_every_transition_in_order(world: World) -> None:
    server, client = await pair(world, at_once)
    seen = await statuses_of(world, server)
    for _ in range(3):
        await (await client.send_goal(goal(), timeout_s=20)).result(timeout_s=20)
    await until(lambda: len(seen) >= 6)
    assert seen == [[2], [4], [4, 2], [4, 4], [4, 4, 2], [4, 4, 4]]


@pytest.mark.every_transport
@pytest.mark.parametrize("accept", [None, lambda request: True])
async def test_goal_response_is_sent_before_first_status(
    world: World, monkeypatch: pytest.MonkeyPatch, accept: Any
) -> None:
    server, client = await pair(world, at_once, goal_callback=accept)
    written = record(monkeypatch, server)
    await (await client.send_goal(goal(), timeout_s=20)).result(timeout_s=20)
    await until(lambda: len(written) >= 4)
    assert written[:2] == ["send_goal", "status 2"]
    assert sorted(written[2:]) == ["get_result", "status 4"]


async def test_feedback_is_sent_after_earlier_status_and_before_later_status(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, client = await pair(world, None)
    written = record(monkeypatch, server)
    sending = asyncio.ensure_future(client.send_goal(goal(), timeout_s=5))
    handle = (await take(server.__aiter__())).accept()
    handle.publish_feedback(Fibonacci.Feedback(sequence=[1]))
    handle.succeed(result(1))
    await (await sending).result(timeout_s=5)
    await until(lambda: "status 4" in written)
    assert [one for one in written if one[0] in "sf" and one != "send_goal"] == ["status 2", "feedback", "status 4"]


async def test_succeed_in_another_thread_returns_after_status_is_published(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, client = await pair(world, None)
    sending = asyncio.ensure_future(client.send_goal(goal(), timeout_s=5))
    handle = (await take(server.__aiter__())).accept()
    await sending
    written = record(monkeypatch, server)
    at_return: list[str] = []

    def end() -> None:
        handle.succeed(result(1))
        at_return.extend(written)

    thread = threading.Thread(target=end)
    thread.start()
    await until(lambda: not thread.is_alive())
    assert "status 4" in at_return


@pytest.mark.every_transport
async def test_closing_node_publishes_pending_status(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    server, client = await pair(world, None)
    sending = asyncio.ensure_future(client.send_goal(goal(), timeout_s=20))
    handle = (await take(server.__aiter__())).accept()
    await sending
    written = record(monkeypatch, server)
    handle.succeed(result(1))
    assert handle.status is S.SUCCEEDED and "status 4" not in written
    world.nodes[0].close()
    assert written == ["status 4"]


IDS = st.lists(st.binary(min_size=16, max_size=16), unique=True, max_size=6)


def expected(rows: list[tuple[bytes, int, int]]) -> bytes:
    message = GoalStatusArray()
    for goal_id, stamp_ns, status in rows:
        row = GoalStatus(status=status)
        row.goal_info.goal_id.uuid = goal_id  # type: ignore[assignment]
        row.goal_info.stamp.sec, row.goal_info.stamp.nanosec = divmod(stamp_ns, 10**9)
        message.status_list.append(row)
    return message.encode()


@given(IDS, st.data())
def test_incremental_status_array_equals_encoded_message(ids: list[bytes], data: st.DataObject) -> None:
    rows = StatusArray()
    model: dict[bytes, tuple[int, int]] = {}
    assert rows.message() == expected([])
    for goal_id in ids:
        stamp = data.draw(st.integers(0, 2**31 * 10**9 - 1))
        rows.add(goal_id, stamp, 1)
        model[goal_id] = (stamp, 1)
    for goal_id in data.draw(st.lists(st.sampled_from(ids), max_size=5)) if ids else []:
        status = data.draw(st.integers(0, 6))
        rows.set_status(goal_id, status)
        model[goal_id] = (model[goal_id][0], status)
    gone = data.draw(st.lists(st.sampled_from(ids), unique=True)) if ids else []
    rows.remove(gone)
    for goal_id in gone:
        del model[goal_id]
    message = rows.message()
    assert message == expected([(goal_id, *row) for goal_id, row in model.items()])
    for goal_id in ids:
        assert find_status(message, goal_id) == (model[goal_id][1] if goal_id in model else None)
        assert find_status(memoryview(message), goal_id) == find_status(message, goal_id)


def test_find_status_matches_goal_ids_only_at_row_starts() -> None:
    rows = StatusArray()
    rows.add(bytes(16), 0, 3)
    rows.add(bytes(15) + b"\x01", 0, 2)
    assert find_status(rows.message(), bytes(15) + b"\x01") == 2
    assert find_status(rows.message()[:20], bytes(16)) is None
    assert find_status(b"", bytes(16)) is None
