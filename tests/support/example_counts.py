"""Number of examples of random tests, and of many cases; `ROSIDL_TEST_EXAMPLES` is a factor, 0.1 for core tests."""

from __future__ import annotations

import os


def examples(number: int) -> int:
    return max(2, round(number * float(os.environ.get("ROSIDL_TEST_EXAMPLES", "1"))))
