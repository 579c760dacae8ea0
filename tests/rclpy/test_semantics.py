"""Executors, futures, entities, signals: what the same lines do under real rclpy (Fast DDS) and under ours."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from environments import environment
from worlds import domain_id

FOLDER = Path(__file__).parent / "semantics"
HELPERS = {"show", "quietly", "connected", "spin_until", "main"}
CASES = [
    node.name
    for node in ast.parse((FOLDER / "spinning.py").read_text(encoding="utf-8")).body
    if isinstance(node, ast.FunctionDef) and node.name not in HELPERS
]
SIGNALS = (
    "int_spin",
    "term_spin",
    "int_sleep",
    "int_thread",
    "multi_term",
    "reinit",
    "after",
    "shutdown_in_callback",
    "options",
    "chained",
    "spin_after",
    "spin_again_after",
)
OURS = """
import runpy, sys
sys.path.insert(0, sys.argv[1])
import shim
shim.install()
sys.argv = sys.argv[2:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""

pytestmark = pytest.mark.real_time("programs are processes")


def started(command: list[str], middleware: str) -> subprocess.Popen[str]:
    """A program in the domain of this test process, on this machine only."""
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_"))}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, text=True, env={**kept, **settings, "RMW_IMPLEMENTATION": middleware}, **pipes)  # type: ignore[call-overload, no-any-return]


def ended(process: subprocess.Popen[str]) -> tuple[str, int, str]:
    """What it printed, its exit code, and its errors."""
    try:
        output, errors = process.communicate(timeout=200)
    except subprocess.TimeoutExpired:
        process.kill()
        output, errors = process.communicate()
    return output, process.returncode, errors


@pytest.fixture(scope="module")
def real() -> list[str]:
    """How real rclpy is started."""
    sys.path.insert(0, str(FOLDER.parents[1] / "interop_rclpy"))
    from rclpy_peer import REQUIREMENTS

    return [str(environment("rclpy-jazzy", REQUIREMENTS["jazzy"]))]


@pytest.fixture(scope="module")
def ours() -> list[str]:
    """How ours is started."""
    return [sys.executable, "-c", OURS, str(FOLDER.parent)]


def run_both(real: list[str], ours: list[str], *program: str) -> list[tuple[str, int, str]]:
    """One after the other: they would hear each other."""
    first = ended(started([*real, *program], "rmw_fastrtps_cpp"))
    return [first, ended(started([*ours, *program], "rmw_cyclonedds_cpp"))]


@pytest.fixture(scope="module")
def told(real: list[str], ours: list[str]) -> list[dict[str, str]]:
    """What real rclpy and ours print, by case."""
    found = []
    for output, code, errors in run_both(real, ours, str(FOLDER / "spinning.py"), *CASES):
        assert code == 0, errors
        found.append(dict(part.split("\n", 1) for part in output.split("== ")[1:]))
    return found


@pytest.mark.parametrize("case", CASES)
def test_the_same_lines_do_the_same(case: str, told: list[dict[str, str]]) -> None:
    expected, found = told
    assert expected[case] and found[case] == expected[case]


@pytest.mark.parametrize("case", SIGNALS)
def test_signals_and_shutdowns_do_the_same(case: str, real: list[str], ours: list[str]) -> None:
    expected, found = run_both(real, ours, str(FOLDER / "signals.py"), case)
    assert expected[0] and found[:2] == expected[:2], found[2]
