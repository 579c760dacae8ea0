"""Clocks, the override of ROS time and jump callbacks (docs/internals/protocol.md 9.6)."""

from __future__ import annotations

import logging

import pytest

from rosidl_py_gen.runtime.clocks import Clock
from rosidl_py_gen.runtime.time_values import (
    ClockChange,
    ClockType,
    ClockTypeError,
    Duration,
    Time,
    TimeJump,
    TimeRangeError,
)

ROS = ClockType.ROS_TIME


class World:
    def __init__(self) -> None:
        self.system, self.steady = 1_000, 5
        self.clock = self.make(ROS)
        self.seen: list[tuple[str, str, int, int]] = []

    def make(self, kind: ClockType) -> Clock:
        return Clock(kind, system_ns=lambda: self.system, steady_ns=lambda: self.steady)

    def note(self, when: str, jump: TimeJump) -> None:
        self.seen.append((when, jump.clock_change.name, jump.delta.nanoseconds, self.clock.now_ns()))


def ros(ns: int) -> Time:
    return Time(nanoseconds=ns, clock_type=ROS)


def test_each_clock_type_reads_its_own_time_source() -> None:
    world = World()
    for kind, expected in ((ROS, 1_000), (ClockType.SYSTEM_TIME, 1_000), (ClockType.STEADY_TIME, 5)):
        assert world.make(kind).now() == Time(nanoseconds=expected, clock_type=kind)


def test_clocks_without_injected_sources_read_real_time() -> None:
    assert Clock().now().nanoseconds > 1_500_000_000 * 10**9
    steady = Clock(ClockType.STEADY_TIME)
    assert steady.now() <= steady.now()


def test_overridden_time_is_zero_until_set_and_system_time_resumes_when_disabled() -> None:
    clock = World().clock
    clock.enable_ros_time_override()
    assert clock.ros_time_is_active and clock.now_ns() == 0
    clock.set_ros_time_override(ros(77))
    assert clock.now() == ros(77)
    clock.disable_ros_time_override()
    assert clock.now_ns() == 1_000 and not clock.ros_time_is_active


def test_time_set_while_override_is_disabled_applies_when_enabled() -> None:
    world = World()
    world.clock.create_jump_callback(pre=lambda j: world.note("pre", j), min_forward=Duration(nanoseconds=1))
    world.clock.set_ros_time_override(ros(9))
    assert world.clock.now_ns() == 1_000 and world.seen == []
    world.clock.enable_ros_time_override()
    assert world.clock.now_ns() == 9


def test_only_ros_clocks_can_be_overridden_and_only_with_ros_times() -> None:
    for kind in (ClockType.SYSTEM_TIME, ClockType.STEADY_TIME):
        clock = Clock(kind)
        for call in (
            clock.enable_ros_time_override,
            clock.disable_ros_time_override,
            lambda clock=clock: clock.set_ros_time_override(ros(1)),
        ):
            with pytest.raises(ClockTypeError, match="only a ROS_TIME clock"):
                call()
    with pytest.raises(ClockTypeError, match="must be a ROS_TIME"):
        Clock().set_ros_time_override(Time(nanoseconds=1))
    with pytest.raises(TypeError, match="must be a Time, got 5"):
        Clock().set_ros_time_override(5)  # type: ignore[arg-type]


def test_jump_callbacks_run_before_and_after_a_time_source_change() -> None:
    world = World()
    world.clock.create_jump_callback(
        pre=lambda j: world.note("pre", j), post=lambda j: world.note("post", j), on_clock_change=True
    )
    world.clock.enable_ros_time_override()
    world.clock.enable_ros_time_override()
    world.clock.set_ros_time_override(ros(50))
    world.clock.disable_ros_time_override()
    assert world.seen == [
        ("pre", "ROS_TIME_ACTIVATED", 0, 1_000),
        ("post", "ROS_TIME_ACTIVATED", 0, 0),
        ("pre", "ROS_TIME_DEACTIVATED", 0, 50),
        ("post", "ROS_TIME_DEACTIVATED", 0, 1_000),
    ]


@pytest.mark.parametrize(
    ("delta", "min_forward", "min_backward", "called"),
    [
        (10, 10, None, True),
        (9, 10, None, False),
        (-10, None, -10, True),
        (-9, None, -10, False),
        (-10, 10, None, False),
        (10, None, -10, False),
        (-20, 10, -10, True),
    ],
)
def test_jump_callbacks_run_only_for_jumps_beyond_their_thresholds(
    delta: int, min_forward: int | None, min_backward: int | None, called: bool
) -> None:
    world = World()
    world.clock.enable_ros_time_override()
    world.clock.set_ros_time_override(ros(100))
    world.clock.create_jump_callback(
        pre=lambda j: world.note("pre", j),
        post=lambda j: world.note("post", j),
        min_forward=None if min_forward is None else Duration(nanoseconds=min_forward),
        min_backward=None if min_backward is None else Duration(nanoseconds=min_backward),
    )
    world.clock.set_ros_time_override(ros(100 + delta))
    kind = ClockChange.ROS_TIME_NO_CHANGE.name
    expected = [("pre", kind, delta, 100), ("post", kind, delta, 100 + delta)]
    assert world.seen == (expected if called else [])


def test_jump_thresholds_of_wrong_sign_or_type_are_refused() -> None:
    with pytest.raises(TimeRangeError, match="min_forward must be a positive"):
        Clock().create_jump_callback(min_forward=Duration())
    with pytest.raises(TimeRangeError, match="min_backward must be a negative"):
        Clock().create_jump_callback(min_backward=Duration(nanoseconds=1))
    for name in ("min_forward", "min_backward"):
        with pytest.raises(TypeError, match=f"{name} must be a Duration or None, got 5"):
            Clock().create_jump_callback(**{name: 5})  # type: ignore[arg-type]


def test_closed_jump_callback_is_not_called() -> None:
    world = World()
    second = []
    handle = world.clock.create_jump_callback(post=lambda j: second.append(j), on_clock_change=True)
    world.clock.create_jump_callback(pre=lambda j: handle.close(), on_clock_change=True)
    world.clock.enable_ros_time_override()
    handle.close()
    assert second == []
    with world.clock.create_jump_callback(post=lambda j: world.note("post", j), on_clock_change=True):
        pass
    world.clock.disable_ros_time_override()
    assert world.seen == []


def test_failing_jump_callback_is_logged_and_others_run(caplog: pytest.LogCaptureFixture) -> None:
    world = World()

    def fail(_: TimeJump) -> None:
        raise RuntimeError("boom")

    world.clock.create_jump_callback(pre=fail, on_clock_change=True)
    world.clock.create_jump_callback(post=lambda j: world.note("post", j), on_clock_change=True)
    with caplog.at_level(logging.ERROR):
        world.clock.enable_ros_time_override()
    assert "boom" in caplog.text and len(world.seen) == 1 and world.clock.now_ns() == 0
