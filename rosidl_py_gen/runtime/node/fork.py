"""What becomes of open nodes in a forked child: they look closed there, and nothing of the transport is touched.

Decides how that is done and what it is called. A child has the memory of its parent, but none of the threads that serve
DDS and wait for it: a call into the middleware, a join or a lock may hang for ever. New nodes of the child are another
matter; see `transport/cyclone/domain.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

FORKED = (
    "made before this process was forked, and works in the parent process only: start processes with multiprocessing's "
    '"spawn" method, or make nodes after the fork'
)


def mark_closed(endpoints: Iterable[object]) -> None:
    """Make endpoints, and what they consist of, look closed, so that whoever uses them gets an error."""
    for endpoint in endpoints:
        if not hasattr(endpoint, "__dict__") or not type(endpoint).__module__.startswith("rosidl_py_gen.runtime."):
            continue
        parts = vars(endpoint)
        if parts.get("_closed", False) is False:
            parts["_closed"] = True  # also says that we were here
            mark_closed(part for part in list(parts.values()) if hasattr(part, "close"))
