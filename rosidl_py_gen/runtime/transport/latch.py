"""Flag that exactly one of several threads sets."""

from __future__ import annotations


class Latch:
    """Flag that can be set once, for code that must run once although several threads may start it, such as `close`.

    The flag takes no lock, so a signal handler and a forked child may set it at any point. Thread: any.
    """

    __slots__ = ("_unset",)

    def __init__(self) -> None:
        self._unset = [None]

    def set(self) -> bool:
        """Set the flag; return True only for the call that has set it."""
        try:
            self._unset.pop()  # atomic, also without the GIL; a test followed by an assignment is not
        except IndexError:
            return False
        return True

    def __bool__(self) -> bool:
        """Return True if the flag is set."""
        return not self._unset
