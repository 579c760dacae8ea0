"""Choice of the occurrences of an event that are logged, where peers decide how often it occurs."""

from __future__ import annotations

MAX_FIRST = 10
"""Occurrences that are all logged. A larger number of different causes is rare, such as programs on one topic."""


def is_logged(count: int) -> bool:
    """Return True for the first `MAX_FIRST` occurrences, then for the 16th, 32nd, 64th and so on.

    A limit for each second would lose messages at the start of a program, when several causes are found at once.
    """
    return count <= MAX_FIRST or not count & (count - 1)
