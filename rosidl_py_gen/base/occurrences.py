"""Rule that selects which occurrences of a repeated event are logged, for events whose number depends on peers."""

from __future__ import annotations

MAX_FIRST = 10
"""Number of occurrences of an event that are all logged before occurrences are skipped. There are rarely more different
causes, such as programs on one topic."""


def is_logged(count: int) -> bool:
    """Return True if occurrence number `count` of an event should be logged: 1 to `MAX_FIRST`, then 16, 32, 64 and so
    on.

    A limit for each second would lose messages at the start of a program, when several causes are found at once.
    """
    return count <= MAX_FIRST or not count & (count - 1)
