"""Programs of rclpy users without peers print and end the same under this rclpy and the real one."""

from __future__ import annotations

import pytest
from observed_programs import PROGRAMS, Case, Observed, difference

CASES = [Case(f"alone/{path.stem}") for path in sorted(PROGRAMS.glob("alone/*.py"))]


@pytest.mark.real_time("programs are processes")
@pytest.mark.parametrize("case", CASES, ids=Case.name)
def test_program_without_peers_prints_the_same_under_both_rclpys(case: Case, observed: Observed) -> None:
    if different := difference(case, *observed(case)):
        pytest.fail(different, pytrace=False)
