"""What rclpy's functions and classes give, ours against the real one: each expression of `programs` in both.

A comment behind an expression says where ours differs: ``# ours: ...`` in what comes out, ``# text`` in the words of an
exception of the same kind.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from environments import environment
from worlds import domain_id

HERE = Path(__file__).resolve().parent
PROGRAMS = sorted((HERE / "programs").glob("values_*.py"))


@pytest.fixture(scope="session")
def rclpy_python() -> Path:
    """The Python that has rclpy of Jazzy."""
    sys.path.insert(0, str(HERE.parent / "interop_rclpy"))
    from rclpy_peer import REQUIREMENTS

    made = os.environ.get("ROSIDL_PEER_JAZZY")
    return Path(made, "bin", "python") if made else environment("rclpy-jazzy", REQUIREMENTS["jazzy"])


def told(python: Path | str, program: Path, *more: str) -> dict[str, Any]:
    own = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    environ = {**os.environ, **own, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp" if more else "rmw_fastrtps_cpp"}
    done = subprocess.run(
        [str(python), str(HERE / "told.py"), str(program), *more],
        capture_output=True,
        text=True,
        timeout=120,
        env=environ,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_both_give_the_same(rclpy_python: Path, program: Path) -> None:
    theirs, ours = told(rclpy_python, program), told(sys.executable, program, "ours")
    lines = program.read_text(encoding="utf-8").splitlines()
    assert len(theirs) > 20, "the program ended early"
    assert list(theirs) == list(ours)
    wrong = []
    for number, (kind, text) in theirs.items():
        line = lines[int(number) - 1]
        if "  # ours: " in line:
            as_expected = ours[number] != [kind, text]
        elif line.endswith("  # text"):
            as_expected = ours[number][0] == kind != "value" and ours[number][1] not in ("", text)
        else:
            as_expected = ours[number] == [kind, text]
        if not as_expected:
            wrong.append((line, [kind, text], ours[number]))
    assert wrong == []
