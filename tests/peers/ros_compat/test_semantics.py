"""Executors, futures, entities and signals: programs behave the same under real rclpy (Fast DDS) and this rclpy."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from support.concurrent_programs import AT_ONCE, Both, run_under_both
from support.environments import SHARED_MEMORY_LOST

FOLDER = Path(__file__).parent / "semantics"
HELPERS = {"show", "until", "let_arrive", "connected", "spin_until", "main"}
CASES = [
    node.name
    for node in ast.parse((FOLDER / "spinning.py").read_text(encoding="utf-8")).body
    if isinstance(node, ast.FunctionDef) and node.name not in HELPERS
]
SIGNALS = ("int_spin", "options", "spin_again_after")
Ends = dict[str, Both | BaseException]

pytestmark = pytest.mark.real_time("programs are processes")


@pytest.fixture(scope="module")
def ends(request: pytest.FixtureRequest) -> Ends:
    """Run all selected cases under both; those of `spinning` share a few processes."""
    chosen = [item.callspec.params["case"] for item in request.session.items if item.path == request.path]
    spinning, signals = ([case for case in chosen if case in all_of_them] for all_of_them in (CASES, SIGNALS))
    together = [part for number in range(AT_ONCE) if (part := spinning[number::AT_ONCE])]
    programs = [["spinning.py", *part] for part in together] + [["signals.py", case] for case in signals]
    found = run_under_both([FOLDER / name, *cases] for name, *cases in programs)
    return {case: one for (_, *cases), one in zip(programs, found, strict=True) for case in cases}


@pytest.mark.parametrize("case", [*CASES, *SIGNALS])
def test_program_has_same_output_and_exit_code_under_both_rclpys(case: str, ends: Ends) -> None:
    both = ends[case]
    if isinstance(both, BaseException):
        raise both
    outputs = []
    for done in both:
        output = SHARED_MEMORY_LOST.sub("", done.stdout)
        if case in CASES:
            output = dict(part.split("\n", 1) for part in output.split("== ")[1:]).get(case, "")
        outputs.append((output, done.returncode))
    expected, found = outputs
    assert expected[0] and found == expected, both[1].stderr
