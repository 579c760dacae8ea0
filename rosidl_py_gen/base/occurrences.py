"""Rule for which occurrences of a repeated event are logged, if peers decide how often it occurs."""

from __future__ import annotations

MAX_FIRST = 10
"""Number of first occurrences that are all logged. It is rare that more different causes, such as programs on one
topic, exist."""


def is_logged(count: int) -> bool:
    """Return True if the occurrence number `count` is to be logged: 1 to `MAX_FIRST`, then 16, 32, 64 and so on.

    A limit for each second would lose messages at the start of a program, when several causes are found at once.
    """
    return count <= MAX_FIRST or not count & (count - 1)
