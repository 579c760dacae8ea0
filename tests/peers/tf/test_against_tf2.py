"""Random frames and lookups, compared with tf2."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.system_python import Oracle, running

from rosidl_py_gen.tf import (
    ConnectivityError,
    ExtrapolationError,
    InvalidTransformError,
    Transform,
    TransformBuffer,
    UnknownFrameError,
)

ORACLE = Path(__file__).parent / "tf2_oracle.py"
NAMES = {
    "LookupException": UnknownFrameError,
    "ConnectivityException": ConnectivityError,
    "ExtrapolationException": ExtrapolationError,
    "InvalidArgumentException": InvalidTransformError,
}
ERRORS = tuple(NAMES.values())


def unit(quaternion: tuple[float, ...]) -> list[float]:
    return [value / sum(other * other for other in quaternion) ** 0.5 for value in quaternion]


FRAMES = st.sampled_from(["a", "b", "c", "d", "e", "f"])
STAMPS = st.integers(1, 13).map(lambda seconds: seconds * 10**9)
"""Two stamps may be too old for a frame, but not three in a row, which tf2 refuses and we accept."""
TIMES = st.just(0) | STAMPS | st.integers(1, 16 * 10**9)
NUMBERS = st.integers(-3, 3).map(float)
ROTATIONS = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS).filter(any).map(unit)


@st.composite
def histories(draw: st.DrawFn) -> list[Any]:
    """Return transforms without the cases that ROS 2 decides differently.

    These are two transforms of one frame and time, and frames that change between static and moving.
    """
    static = draw(st.sets(FRAMES, max_size=2))
    inserted = []
    seen = set()
    for _ in range(draw(st.integers(1, 12))):
        child, stamp, parent = draw(FRAMES), draw(STAMPS), draw(FRAMES)
        if (child, stamp) in seen or child == parent:
            continue
        seen.add((child, stamp))
        move = draw(st.tuples(NUMBERS, NUMBERS, NUMBERS))
        inserted.append(["insert", child, stamp, parent, move, draw(ROTATIONS), child in static])
    return inserted


LOOKUPS = st.tuples(st.just("lookup"), FRAMES, FRAMES, TIMES)
FULL = st.tuples(st.just("full"), FRAMES, TIMES, FRAMES, TIMES, FRAMES)


@pytest.fixture(scope="module")
def tf2() -> Iterator[Oracle]:
    with running(ORACLE, "tf2_py, rospy", "python3-tf2") as oracle:
        yield oracle


def answer(buffer: TransformBuffer, request: Any) -> Any:
    what, *arguments = request
    try:
        if what == "insert":
            child, stamp, parent, move, turn, static = arguments
            return buffer.set_transform(Transform(parent, child, stamp, np.array(move), np.array(turn)), static=static)
        found = buffer.lookup_transform(*arguments) if what == "lookup" else buffer.lookup_transform_full(*arguments)
    except ERRORS as error:
        return type(error)
    return [found.stamp, found.translation.tolist(), found.rotation.tolist()]


@given(histories(), st.lists(LOOKUPS | FULL, min_size=1, max_size=12))
def test_lookups_and_errors_equal_the_results_of_tf2(tf2: Any, history: list[Any], questions: list[Any]) -> None:
    buffer = TransformBuffer()
    # tf2 stores the frame names even of a transform that it refuses for its age.
    taken = [request for request in history if answer(buffer, request) is None]
    for question, wanted in zip(questions, tf2.ask([*taken, *questions])[len(taken) :], strict=True):
        ours = answer(buffer, question)
        if isinstance(wanted, str):
            assert ours is NAMES[wanted], question
            continue
        assert not isinstance(ours, type), (question, ours, wanted)
        stamp, move, turn = wanted
        assert ours[0] == stamp, question
        assert np.allclose(ours[1], move, atol=1e-9), question
        assert np.isclose(abs(np.dot(ours[2], turn)), 1, atol=1e-9), question
