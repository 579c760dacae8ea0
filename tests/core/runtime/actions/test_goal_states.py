"""Goals on the server, with a state machine against a model (docs/internals/protocol.md 8.2 to 8.4)."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from each_case import each_case
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from support.example_counts import examples

from rosidl_py_gen import runtime
from rosidl_py_gen.runtime.actions.states import (
    RCLPY_RULES,
    RULES,
    ZERO_ID,
    CancelCode,
    CancelSelection,
    GoalEvent,
    GoalInfo,
    GoalRules,
    GoalStatus,
    GoalTable,
    GoalTransitionError,
    UnknownGoalError,
    find_status,
    next_goal_status,
)

S, E = GoalStatus, GoalEvent
ALLOWED = {
    (S.ACCEPTED, E.EXECUTE): S.EXECUTING,
    (S.ACCEPTED, E.CANCEL_GOAL): S.CANCELING,
    (S.EXECUTING, E.CANCEL_GOAL): S.CANCELING,
    (S.EXECUTING, E.SUCCEED): S.SUCCEEDED,
    (S.CANCELING, E.SUCCEED): S.SUCCEEDED,
    (S.EXECUTING, E.ABORT): S.ABORTED,
    (S.CANCELING, E.ABORT): S.ABORTED,
    (S.CANCELING, E.CANCELED): S.CANCELED,
}


def test_statuses_have_the_numbers_of_action_msgs() -> None:
    assert [int(status) for status in S] == list(range(7))
    assert [s for s in S if s.is_terminal] == [S.SUCCEEDED, S.CANCELED, S.ABORTED]
    assert [s for s in S if s.is_active] == [S.ACCEPTED, S.EXECUTING, S.CANCELING]
    assert [s for s in S if s.is_cancelable] == [S.ACCEPTED, S.EXECUTING]
    assert [int(code) for code in CancelCode] == [0, 1, 2, 3]


@each_case(("status", "event"), list(itertools.product(S, E)))
def test_next_goal_status_allows_only_the_transitions_of_ros(status: GoalStatus, event: GoalEvent) -> None:
    expected = ALLOWED.get((status, event))
    if expected is not None:
        assert next_goal_status(status, event) is expected
        return
    with pytest.raises(GoalTransitionError, match=f"a goal that is {status.name} cannot {event.value}") as caught:
        next_goal_status(status, event)
    assert caught.value.code == 2301


def test_goal_transitions_are_public_and_read_only() -> None:
    assert runtime.GOAL_TRANSITIONS == ALLOWED
    with pytest.raises(TypeError, match="does not support item assignment"):
        runtime.GOAL_TRANSITIONS[S.SUCCEEDED, E.EXECUTE] = S.EXECUTING  # type: ignore[index]
    assert runtime.next_goal_status(runtime.GoalStatus.ACCEPTED, runtime.GoalEvent.EXECUTE) is S.EXECUTING


@pytest.mark.parametrize(("status", "event"), [(1, E.EXECUTE), (S.ACCEPTED, "execute"), ([], {})])
def test_next_goal_status_refuses_values_of_wrong_type(status: Any, event: Any) -> None:
    with pytest.raises(TypeError, match="expected a GoalStatus and a GoalEvent, got "):
        next_goal_status(status, event)


def gid(number: int) -> bytes:
    return number.to_bytes(16, "big")


Table = GoalTable[str]


def goal_table(*stamps: int, timeout_ns: int = 100) -> Table:
    new_table = Table(timeout_ns)
    for number, stamp in enumerate(stamps, 1):
        assert new_table.accept(gid(number), stamp) == GoalInfo(gid(number), stamp)
    return new_table


def finish(goals: Table, number: int, now_ns: int) -> None:
    goals.apply(gid(number), E.SUCCEED)
    goals.retain(gid(number), "r", now_ns)


def test_finished_goals_expire_after_result_timeout() -> None:
    """r2r retains every result forever."""
    goals = goal_table(0, 0, timeout_ns=100)
    assert goals.next_expiry_ns() is None
    for number in (1, 2):
        goals.apply(gid(number), E.EXECUTE)
    finish(goals, 1, 1000)
    assert goals.expire(1100) == [] and goals.next_expiry_ns() == 1101
    assert goals.expire(1101) == [gid(1)]
    assert goals.status(gid(1)) is S.UNKNOWN and goals.result(gid(1)) is None
    assert goals.expire(10**9) == [] and gid(2) in goals
    assert goals.accept(gid(1), 2000) is not None


def test_finished_goal_without_timeout_never_expires() -> None:
    goals = Table(None)
    goals.accept(gid(1), 0)
    goals.apply(gid(1), E.EXECUTE)
    finish(goals, 1, 5)
    assert goals.expire(10**30) == [] and goals.next_expiry_ns() is None


def mixed() -> Table:
    goals = goal_table(10, 20, 30, 40, 50)
    for number in (2, 3, 4):
        goals.apply(gid(number), E.EXECUTE)
    goals.apply(gid(3), E.CANCEL_GOAL)
    finish(goals, 4, 45)
    return goals


@pytest.mark.parametrize(
    ("goal", "stamp", "code", "chosen"),
    [
        (1, 0, 0, [1]),
        (2, 0, 0, [2]),
        (3, 0, 3, []),  # canceling already
        (4, 0, 3, []),  # terminal
        (9, 0, 2, []),  # unknown
        (0, 0, 0, [1, 2, 5]),
        (0, 20, 0, [1, 2]),
        (0, 5, 0, []),
        (5, 10, 0, [1, 5]),
        (1, 10, 0, [1]),
        (4, 10, 0, [1]),
        (9, 20, 0, [1, 2]),
    ],
)
def test_cancel_request_selects_goals_and_code(goal: int, stamp: int, code: int, chosen: list[int]) -> None:
    got = mixed().select_for_cancel(gid(goal), stamp)
    assert (int(got.code), [int.from_bytes(info.goal_id, "big") for info in got.goals]) == (code, chosen)
    assert all(info.stamp_ns for info in got.goals)


@pytest.mark.parametrize(
    ("goal", "canceled", "ended", "code"),
    [
        (0, [1, 2], [], 0),
        (0, [1], [], 0),
        (0, [], [], 1),  # REJECTED as in rclcpp; rclpy returns 0
        (0, [1], [2], 0),
        (0, [], [2], 1),  # 1 is left, and was refused
        (0, [], [1, 2], 0),  # zero ids always get 0 when nothing is left
        (1, [1], [], 0),
        (1, [], [], 1),
        (1, [], [1], 3),
        (9, [], [], 2),
    ],
)
@pytest.mark.parametrize("rules", [RULES, RCLPY_RULES])
def test_code_of_cancel_response_follows_rules(
    rules: GoalRules, goal: int, canceled: list[int], ended: list[int], code: int
) -> None:
    """r2r answers REJECTED with an empty list for every request that hits two goals."""
    goals = Table(100, rules)
    for number in (1, 2):
        goals.accept(gid(number), number)
    for number in (1, 2):
        goals.apply(gid(number), E.EXECUTE)
    selection = goals.select_for_cancel(gid(goal), 0)
    for number in ended:
        finish(goals, number, 3)
    for number in canceled:
        goals.apply(gid(number), E.CANCEL_GOAL)
    expected = 2 if goal == 9 else code if rules is RULES else 0
    assert goals.cancel_code(selection, any_canceled=bool(canceled)) == expected


def test_cancel_by_id_and_stamp_is_answered_like_cancel_of_many() -> None:
    goals = mixed()
    selection = goals.select_for_cancel(gid(5), 20)
    for number in (1, 2, 5):
        goals.apply(gid(number), E.CANCEL_GOAL)
    assert goals.cancel_code(selection, any_canceled=False) is CancelCode.NONE
    only = goals.select_for_cancel(gid(3), 0)
    assert only == CancelSelection(CancelCode.GOAL_TERMINATED, by_id=True)
    assert goals.cancel_code(only, any_canceled=False) is CancelCode.GOAL_TERMINATED


def test_result_timeout_starts_when_result_is_retained() -> None:
    goals = goal_table(0, 0, timeout_ns=100)
    for number in (1, 2):
        goals.apply(gid(number), E.EXECUTE)
        goals.apply(gid(number), E.SUCCEED)
    assert goals.expire(10**9) == [] and goals.next_expiry_ns() is None and goals.result(gid(1)) is None
    goals.retain(gid(2), "r", 1000, failed=True)
    goals.retain(gid(1), "s", 1050)
    goals.retain(gid(2), "t", 1090)
    assert (goals.status(gid(2)), goals.result(gid(2)), goals.next_expiry_ns()) == (S.ABORTED, "t", 1101)
    assert goals.expire(1101) == [gid(2)]
    goals.retain(gid(2), "u", 1102)
    assert gid(2) not in goals and goals.next_expiry_ns() == 1151


def test_goal_with_forgotten_status_keeps_its_id_until_it_expires() -> None:
    goals = goal_table(10, 20, timeout_ns=100)
    for _ in range(2):
        goals.forget_status(gid(1))
    message = goals.status_message()
    assert [find_status(message, gid(number)) for number in (1, 2)] == [goals.status(gid(1)), S.ACCEPTED] == [0, 1]
    with pytest.raises(GoalTransitionError):
        goals.apply(gid(1), E.EXECUTE)
    assert goals.accept(gid(1), 30) is None and goals.next_expiry_ns() is None
    assert goals.select_for_cancel(gid(1), 0) == CancelSelection(CancelCode.UNKNOWN_GOAL_ID, by_id=True)
    goals.retain(gid(1), "r", 1000)
    assert goals.expire(1101) == [gid(1)] and goals.accept(gid(1), 1200) == GoalInfo(gid(1), 1200)


class GoalTableAgainstModel(RuleBasedStateMachine):
    ids = st.integers(1, 4)

    @initialize(timeout=st.sampled_from([0, 10, 50]))
    def create(self, timeout: int) -> None:
        self.timeout, self.now = timeout, 100
        self.table: GoalTable[int] = GoalTable(timeout)
        self.model: dict[int, GoalStatus] = {}
        self.stamps: dict[int, int] = {}
        self.ended: dict[int, int] = {}

    @rule(goal=ids)
    def accept(self, goal: int) -> None:
        info = self.table.accept(gid(goal), self.now)
        assert (info is None) == (goal in self.model)
        if info is not None:
            self.model[goal], self.stamps[goal] = S.ACCEPTED, self.now

    @rule(goal=ids, event=st.sampled_from(list(E)))
    def happen(self, goal: int, event: GoalEvent) -> None:
        target = ALLOWED.get((self.model.get(goal, S.UNKNOWN), event))
        ends = event in (E.SUCCEED, E.ABORT, E.CANCELED)
        try:
            assert self.table.apply(gid(goal), event) is target
        except (GoalTransitionError, UnknownGoalError):
            assert target is None
            return
        assert target is not None
        self.model[goal] = target
        if ends:
            self.table.retain(gid(goal), self.now, self.now)
            self.ended[goal] = self.now

    @rule(goal=ids)
    def ask_result(self, goal: int) -> None:
        known = self.model.get(goal, S.UNKNOWN)
        assert self.table.status(gid(goal)) is known
        assert self.table.result(gid(goal)) == (self.ended[goal] if known.is_terminal else None)

    @rule(goal=st.integers(0, 5), back=st.integers(0, 60), by_stamp=st.booleans())
    def cancel(self, goal: int, back: int, by_stamp: bool) -> None:
        stamp = self.now - back if by_stamp else 0
        got = self.table.select_for_cancel(gid(goal), stamp)
        cancelable = [g for g, status in self.model.items() if status.is_cancelable]
        if goal and not by_stamp:
            code = 0 if goal in cancelable else 3 if goal in self.model else 2
            assert (int(got.code), [i.goal_id for i in got.goals]) == (code, [gid(goal)] if code == 0 else [])
        else:
            chosen = [g for g in cancelable if not by_stamp or self.stamps[g] <= stamp or g == goal]
            assert (int(got.code), [i.goal_id for i in got.goals]) == (0, [gid(g) for g in chosen])

    @rule(step=st.integers(1, 30))
    def time_passes(self, step: int) -> None:
        self.now += step
        due = self.table.next_expiry_ns()
        gone = [int.from_bytes(goal_id, "big") for goal_id in self.table.expire(self.now)]
        over = [g for g, end in self.ended.items() if self.timeout <= 0 or self.now - end > self.timeout]
        assert sorted(gone) == sorted(over)
        assert (due is not None and due <= self.now) == bool(gone)
        for goal in gone:
            del self.model[goal], self.ended[goal], self.stamps[goal]

    @invariant()
    def agree(self) -> None:
        assert {goal: self.table.status(gid(goal)) for goal in self.model} == self.model
        assert len(self.table) == len(self.model)
        message = self.table.status_message()
        assert {goal: find_status(message, gid(goal)) for goal in self.model} == self.model
        assert ZERO_ID not in self.table


TestGoalTableAgainstModel = GoalTableAgainstModel.TestCase
TestGoalTableAgainstModel.settings = settings(max_examples=examples(80), stateful_step_count=40, deadline=None)
