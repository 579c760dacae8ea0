"""How many calls of an async callback may be under way at once, and what is said when they are too slow."""

from __future__ import annotations

from numbers import Integral


def require_concurrency(value: object) -> None:
    """Raises `TypeError`, `ValueError` for anything but a whole number from 1 on."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"concurrency must be an int, how many calls may be under way at once, got {value!r:.100}")
    if value < 1:
        raise ValueError(f"concurrency must be 1 or more, got {value!r}")


def drops_warning(topic: str, depth: int, concurrency: int, under_way: int) -> str:
    """What to log when a topic's messages are dropped for the first time; `under_way` calls wait for something."""
    if under_way:
        calls = "one call at a time" if concurrency == 1 else f"{concurrency} calls at once"
        reason = f"its async callback, {calls}, is slower than they come, and {depth} can wait"
        advice = "concurrency=... lets more calls run at once, and a larger depth in qos=... lets more messages wait"
    else:
        reason = f"more than {depth} came while the event loop was busy, with a plain callback perhaps"
        advice = "a larger depth in qos=... lets more wait, and what takes long belongs in asyncio.to_thread"
    return f"messages on {topic} are dropped: {reason}; {advice}. subscription.dropped counts them; this is said once"
