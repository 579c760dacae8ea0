"""Results of rclpy's functions and classes, ours against the real ones: each expression of `programs` in both.

A comment after an expression says that ours differs: ``# ours: ...`` in the result, ``# text`` in the text of an
exception of the same type.
"""

from __future__ import annotations

import asyncio
import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from support.concurrent_programs import at_once
from support.environments import rclpy_python
from support.node_fixtures import DOMAINS
from support.program_processes import run_in_domain

HERE = Path(__file__).resolve().parent
PROGRAMS = sorted((HERE / "programs").glob("values_*.py"))
Both = tuple[dict[str, Any], dict[str, Any]]


def results_of(python: Path | str, program: Path, *more: str, domain: int) -> dict[str, Any]:
    middleware = "rmw_cyclonedds_cpp" if more else "rmw_fastrtps_cpp"
    done = run_in_domain([python, HERE / "print_results.py", program, *more], domain, middleware)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


async def results_of_both(python: Path, program: Path, domain: int) -> Both:
    return await asyncio.gather(
        asyncio.to_thread(results_of, python, program, domain=domain),
        asyncio.to_thread(results_of, sys.executable, program, "ours", domain=domain + DOMAINS),
    )


@pytest.fixture(scope="module")
def all_results(request: pytest.FixtureRequest) -> dict[Path, Both | BaseException]:
    """Return the results of the selected programs, in a Python with rclpy of Jazzy and in ours."""
    python = rclpy_python()
    programs = [item.callspec.params["program"] for item in request.session.items if item.path == request.path]
    found = asyncio.run(at_once(partial(results_of_both, python, program) for program in programs))
    return dict(zip(programs, found, strict=True))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_both_give_the_same(all_results: dict[Path, Both | BaseException], program: Path) -> None:
    both = all_results[program]
    if isinstance(both, BaseException):
        raise both
    theirs, ours = both
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
