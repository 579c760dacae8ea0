"""docs/internals/parity.md and `run_rclpy_tests.py` agree about rclpy's own tests: the counts fit the failures."""

from __future__ import annotations

import re

from run_rclpy_tests import REASONS
from support.folders import ROOT

PAGE = (ROOT / "docs" / "internals" / "parity.md").read_text(encoding="utf-8")
ROWS = {
    name: (int(passed), int(count), why)
    for name, passed, count, why in re.findall(r"^\| `(test_\w+\.py)` \| (\d+) of (\d+) \|(.*)\|$", PAGE, re.MULTILINE)
}


def test_parity_page_explains_every_failed_rclpy_test() -> None:
    assert set(REASONS) <= set(ROWS) and len(ROWS) > 45
    for name, (passed, count, why) in ROWS.items():
        explained = REASONS.get(name, {})
        assert count - passed == len(explained), f"{name}: failed are other tests than those explained"
        assert all(f"`{test}`" in why and reason in why for test, reason in explained.items()), name


def test_parity_page_total_equals_sum_of_rows() -> None:
    passed, count = (sum(row[index] for row in ROWS.values()) for index in (0, 1))
    assert f"**{passed} of {count}**" in PAGE
    assert passed > 0.95 * count
