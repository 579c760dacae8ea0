"""Number of examples of random tests; `ROSIDL_TEST_EXAMPLES` is a factor, such as 0.1 in quick runs."""

from __future__ import annotations

import os


def examples(number: int) -> int:
    return max(2, round(number * float(os.environ.get("ROSIDL_TEST_EXAMPLES", "1"))))
