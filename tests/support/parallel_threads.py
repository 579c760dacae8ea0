"""Run a function in several threads that start at the same moment."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
THREADS = 8
_SWITCH_INTERVAL_S = 1e-5
"""Interval in which an interpreter with a GIL switches threads, which is 5 ms otherwise."""


def in_threads(work: Callable[[int], T], count: int = THREADS, timeout_s: float = 60) -> list[T]:
    """Return the results of `work`, called with a thread number; raise the error of the first failed thread."""
    barrier, interval_s = threading.Barrier(count), sys.getswitchinterval()

    def start(number: int) -> T:
        barrier.wait(timeout_s)
        return work(number)

    sys.setswitchinterval(_SWITCH_INTERVAL_S)
    try:
        with ThreadPoolExecutor(count) as pool:
            return [running.result(timeout_s) for running in [pool.submit(start, number) for number in range(count)]]
    finally:
        sys.setswitchinterval(interval_s)
