"""Run programs that mostly wait concurrently, each in two domains."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from typing import TypeVar

from support.node_fixtures import new_domain_id

T = TypeVar("T")
AT_ONCE = 3
_domains: list[int] = []


async def at_once(jobs: Iterable[Callable[[int], Awaitable[T]]]) -> list[T | BaseException]:
    """Return the results of jobs in their order; an exception that a job raised is its result.

    A job is given a domain that is its own while it runs, and so is the one `node_fixtures.DOMAINS` behind that.
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
