"""Executors, futures, entities and signals: the same lines under real rclpy (Fast DDS) and under ours."""

from __future__ import annotations

import ast
import asyncio
import sys
from functools import partial
from pathlib import Path

import pytest
from support.concurrent_programs import AT_ONCE, at_once
from support.environments import SHARED_MEMORY_LOST, rclpy_python
from support.node_fixtures import DOMAINS
from support.program_processes import run_in_domain

FOLDER = Path(__file__).parent / "semantics"
HELPERS = {"show", "until", "let_arrive", "connected", "spin_until", "main"}
CASES = [
    node.name
    for node in ast.parse((FOLDER / "spinning.py").read_text(encoding="utf-8")).body
    if isinstance(node, ast.FunctionDef) and node.name not in HELPERS
]
SIGNALS = (
    "int_spin",
    "term_spin",
    "int_thread",
    "reinit",
    "options",
    "chained",
    "spin_after",
    "spin_again_after",
)
OURS = """
import runpy, sys
sys.path.insert(0, sys.argv[1])
import install_rclpy
install_rclpy.install()
sys.argv = sys.argv[2:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""

pytestmark = pytest.mark.real_time("programs are processes")


Outcome = tuple[str, int, str]
"""Output, exit code and errors of a program."""
Outcomes = dict[str, "tuple[Outcome, Outcome] | BaseException"]


def run_program(command: list[str | Path], middleware: str, domain: int) -> Outcome:
    done = run_in_domain(command, domain, middleware)
    return SHARED_MEMORY_LOST.sub("", done.stdout), done.returncode, done.stderr


async def run_both(real: Path, program: list[str], domain: int) -> tuple[Outcome, Outcome]:
    """Run a program under real rclpy and under ours, in separate domains."""
    ours = [sys.executable, "-c", OURS, str(FOLDER.parent)]
    return await asyncio.gather(
        asyncio.to_thread(run_program, [real, *program], "rmw_fastrtps_cpp", domain),
        asyncio.to_thread(run_program, [*ours, *program], "rmw_cyclonedds_cpp", domain + DOMAINS),
    )


@pytest.fixture(scope="module")
def outcomes(request: pytest.FixtureRequest) -> Outcomes:
    """Return the output of all selected cases under both; those of `spinning` share a few processes."""
    chosen = [item.callspec.params["case"] for item in request.session.items if item.path == request.path]
    spinning, signals = ([case for case in chosen if case in all_of_them] for all_of_them in (CASES, SIGNALS))
    together = [part for number in range(AT_ONCE) if (part := spinning[number::AT_ONCE])]
    programs = [["spinning.py", *part] for part in together] + [["signals.py", case] for case in signals]
    jobs = [partial(run_both, rclpy_python(), [str(FOLDER / name), *cases]) for name, *cases in programs]
    found = asyncio.run(at_once(jobs))
    return {case: one for (_, *cases), one in zip(programs, found, strict=True) for case in cases}


@pytest.mark.parametrize("case", CASES)
def test_the_same_lines_do_the_same(case: str, outcomes: Outcomes) -> None:
    both = outcomes[case]
    if isinstance(both, BaseException):
        raise both
    outputs = []
    for output, code, errors in both:
        assert code == 0, errors
        outputs.append(dict(part.split("\n", 1) for part in output.split("== ")[1:])[case])
    expected, found = outputs
    assert expected and found == expected


@pytest.mark.parametrize("case", SIGNALS)
def test_signals_and_shutdowns_do_the_same(case: str, outcomes: Outcomes) -> None:
    both = outcomes[case]
    if isinstance(both, BaseException):
        raise both
    expected, found = both
    assert expected[0] and found[:2] == expected[:2], found[2]
