"""Messages at the times they were recorded, as far apart as then."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Protocol, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterable


class _HasLogTime(Protocol):
    @property
    def log_time(self) -> int: ...


T = TypeVar("T", bound=_HasLogTime)


def at_recorded_pace(messages: Iterable[T], rate: float) -> AsyncIterator[T]:
    """Give each message when it is due; `rate` 2.0 is twice as fast. Raises ValueError when it is not above 0."""
    if not rate > 0:
        raise ValueError(f"rate must be above 0, got {rate}")
    return _paced(messages, rate)


async def _paced(messages: Iterable[T], rate: float) -> AsyncIterator[T]:
    clock = asyncio.get_running_loop().time
    began: tuple[float, int] | None = None
    for item in messages:
        began = began or (clock(), item.log_time)
        await asyncio.sleep(max(0.0, began[0] + (item.log_time - began[1]) / NS_PER_S / rate - clock()))
        yield item
