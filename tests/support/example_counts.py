"""How much random tests try: everything, or the part that `ROSIDL_TEST_EXAMPLES` says, such as 0.1 in quick runs."""

from __future__ import annotations

import os


def examples(number: int) -> int:
    """What of `number` examples to try, at least 2."""
    return max(2, round(number * float(os.environ.get("ROSIDL_TEST_EXAMPLES", "1"))))
