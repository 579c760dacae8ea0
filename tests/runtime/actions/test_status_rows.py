"""GoalStatusArray as bytes equals what the generated code makes of it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.msgs.action_msgs.msg import GoalStatus, GoalStatusArray
from rosidl_py_gen.runtime.actions.status import StatusRows, find_status

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
def test_rows_are_the_generated_bytes_after_every_change(ids: list[bytes], data: st.DataObject) -> None:
    rows = StatusRows()
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


def test_an_id_is_only_found_where_a_row_begins() -> None:
    rows = StatusRows()
    rows.add(bytes(16), 0, 3)
    rows.add(bytes(15) + b"\x01", 0, 2)
    assert find_status(rows.message(), bytes(15) + b"\x01") == 2
    assert find_status(rows.message()[:20], bytes(16)) is None
    assert find_status(b"", bytes(16)) is None
