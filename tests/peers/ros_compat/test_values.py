"""Results of rclpy's functions and classes, ours against the real ones: each expression of `programs` in both.

A comment after an expression says that ours differs: ``# ours: ...`` in the result, ``# text`` in the text of an
exception of the same type.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from support.concurrent_programs import Both, run_under_both

HERE = Path(__file__).resolve().parent
PROGRAMS = sorted((HERE / "programs").glob("values_*.py"))


@pytest.fixture(scope="module")
def ends(request: pytest.FixtureRequest) -> dict[Path, Both | BaseException]:
    """Run the selected programs under both."""
    programs = [item.callspec.params["program"] for item in request.session.items if item.path == request.path]
    both = run_under_both([HERE / "print_results.py", program] for program in programs)
    return dict(zip(programs, both, strict=True))


def results_of(done: subprocess.CompletedProcess[str]) -> Any:
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_expressions_have_same_results_under_both_rclpys(ends: dict[Path, Both | BaseException], program: Path) -> None:
    both = ends[program]
    if isinstance(both, BaseException):
        raise both
    theirs, ours = map(results_of, both)
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
