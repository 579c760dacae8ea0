"""The table of differences between distributions is what the command finds."""

from __future__ import annotations

from support.record_distribution_changes import PAGE, page


def test_the_table_of_definitions_is_current() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert page(text) == text, "run: python tests/support/record_distribution_changes.py"
