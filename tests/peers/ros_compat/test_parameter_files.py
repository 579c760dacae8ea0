"""Parameter files and ``-p`` under real rclpy and under ours: the table of `support/parameter_file_cases.py`."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from support import parameter_file_cases
from support.concurrent_programs import run_under_both
from support.parameter_file_cases import DEVIATIONS, GOLDEN

pytestmark = pytest.mark.real_time("programs are processes")


@pytest.fixture(scope="module")
def ends() -> tuple[dict[str, Any], dict[str, Any]]:
    (both,) = run_under_both([[Path(parameter_file_cases.__file__)]])
    if isinstance(both, BaseException):
        raise both
    theirs, ours = map(results_of, both)
    return theirs, ours


def results_of(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert done.returncode == 0, done.stderr
    results: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return results


def test_real_rclpy_reads_parameter_files_as_recorded(ends: tuple[dict[str, Any], dict[str, Any]]) -> None:
    recorded = json.loads(GOLDEN.read_text(encoding="utf-8"))
    assert ends[0] == recorded["kilted"] | recorded["jazzy_differs"]


def test_this_rclpy_reads_parameter_files_like_real_rclpy(ends: tuple[dict[str, Any], dict[str, Any]]) -> None:
    expected = json.loads(GOLDEN.read_text(encoding="utf-8"))["kilted"] | DEVIATIONS
    assert {name: value for name, value in ends[1].items() if value != expected[name]} == {}
    assert ends[1].keys() == expected.keys()
