"""Programs without peers, as users of rclpy write them, print and end as under the real one."""

from __future__ import annotations

import pytest
from observed_programs import PROGRAMS, Case, Observed, difference

OURS_SAYS = {"lifecycle_triggers": "[ERROR] [lamp]: on_configure raised ValueError: broken"}
"""Lines that ours logs and rclpy does not."""
CASES = [
    Case(f"alone/{path.stem}", ours_says=OURS_SAYS.get(path.stem, "")) for path in sorted(PROGRAMS.glob("alone/*.py"))
]


@pytest.mark.real_time("programs are processes")
@pytest.mark.parametrize("case", CASES, ids=Case.name)
def test_a_program_prints_the_same(case: Case, observed: Observed) -> None:
    if different := difference(case, *observed(case)):
        pytest.fail(different, pytrace=False)
