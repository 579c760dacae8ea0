"""Run programs that mostly wait concurrently, each in two domains."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import Awaitable, Callable, Iterable
from pathlib import Path
from typing import TypeVar

from support.environments import rclpy_python
from support.folders import ROOT
from support.local_network import DOMAINS, new_domain_id
from support.program_processes import RUN, run_in_domain

T = TypeVar("T")
Both = tuple[subprocess.CompletedProcess[str], subprocess.CompletedProcess[str]]
"""Ends of a program under real rclpy and under ours."""
AT_ONCE = 3
_domains: list[int] = []


async def at_once(jobs: Iterable[Callable[[int], Awaitable[T]]]) -> list[T | BaseException]:
    """Return the results of jobs in their order; an exception that a job raised is its result.

    A job is given a domain that is its own while it runs, and so is the one `local_network.DOMAINS` behind that.
    """
    _domains.extend(new_domain_id() for _ in range(AT_ONCE - len(_domains)))
    free: asyncio.Queue[int] = asyncio.Queue()
    for domain in _domains:
        free.put_nowait(domain)

    async def one(job: Callable[[int], Awaitable[T]]) -> T:
        domain = await free.get()
        try:
            return await job(domain)
        finally:
            free.put_nowait(domain)

    return await asyncio.gather(*map(one, jobs), return_exceptions=True)


def run_under_both(programs: Iterable[list[str | Path]]) -> list[Both | BaseException]:
    """Run programs under real rclpy on Fast DDS and under ours on Cyclone DDS."""
    real, ours = [rclpy_python()], [*RUN, "--path", ROOT / "tests" / "interfaces"]

    def job(program: list[str | Path]) -> Callable[[int], Awaitable[Both]]:
        return lambda domain: asyncio.gather(
            asyncio.to_thread(run_in_domain, [*real, *program], domain, "rmw_fastrtps_cpp"),
            asyncio.to_thread(run_in_domain, [*ours, *program], domain + DOMAINS, "rmw_cyclonedds_cpp"),
        )

    return asyncio.run(at_once(map(job, programs)))
