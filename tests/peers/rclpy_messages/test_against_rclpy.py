"""Statements run with messages of a ROS installation, and with this package's messages of rclpy's API."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
from support.environments import rclpy_python

sys.path.insert(0, str(Path(__file__).parent))

from statements import PROGRAMS

PROGRAM = Path(__file__).with_name("describe_messages.py")
PACKAGES = [
    *("action_msgs", "builtin_interfaces", "geometry_msgs", "lifecycle_msgs", "nav_msgs", "rcl_interfaces"),
    *("rosgraph_msgs", "sensor_msgs", "service_msgs", "std_msgs", "std_srvs", "test_msgs"),
    *("type_description_interfaces", "unique_identifier_msgs"),
]


@pytest.fixture(scope="module")
def real() -> Path:
    return rclpy_python()


def run_description(python: Path | str, mode: str, given: object, *arguments: str, checked: bool = False) -> Any:
    settings = {**os.environ, "ROS_PYTHON_CHECK_FIELDS": "1" if checked else ""}
    for name in ("AMENT_PREFIX_PATH", "PYTHONPATH"):
        settings.pop(name, None)
    command = [str(python), str(PROGRAM), mode, *arguments]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, env=settings, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@lru_cache(maxsize=4)
def outcomes(python: Path, checked: bool) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Return outcomes by row with the real messages and with ours, made from the same definitions."""
    every = [one for programs in PROGRAMS.values() for one in programs]
    share = str(python.parent.parent / "share")
    both = []
    for answers in (
        iter(run_description(python, "statements", every, checked=checked)),
        iter(run_description(sys.executable, "statements", every, share, checked=checked)),
    ):
        both.append({row: [next(answers) for _ in programs] for row, programs in PROGRAMS.items()})
    return both[0], both[1]


@pytest.mark.parametrize("checked", [False, True], ids=["unchecked", "checked"])
@pytest.mark.parametrize("row", PROGRAMS)
def test_statements_have_equal_outcomes_with_messages_of_rclpy(row: str, checked: bool, real: Path) -> None:
    wanted, found = outcomes(real, checked)
    pairs = zip(PROGRAMS[row], wanted[row], found[row], strict=True)
    different = [(program.split("copy\n")[1], one, other) for program, one, other in pairs if one != other]
    assert different == []


def test_statements_cover_valid_and_invalid_values(real: Path) -> None:
    wanted, _ = outcomes(real, False)
    errors = [text for row in wanted.values() for text in row if "Error" in text.split(" ")[0]]
    assert 20 < len(errors) < sum(map(len, wanted.values())) / 3
    checked = [text for text in outcomes(real, True)[0]["wrong values"] if text.startswith("AssertionError: The '")]
    assert len(checked) > 35


def test_every_type_of_an_installation_has_an_equal_description(real: Path) -> None:
    wanted = run_description(real, "types", PACKAGES)
    found = run_description(sys.executable, "types", PACKAGES, str(real.parent.parent / "share"))
    assert len(wanted) > 250
    assert {name: (one, found.get(name)) for name, one in wanted.items() if one != found.get(name)} == {}
