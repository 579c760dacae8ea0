"""Warning about socket buffers of this machine that are too small for large messages.

A message of some megabytes is a burst of thousands of packets. Packets that do not fit the receive buffer are lost, and
sent again (reliable) or not (best effort).
"""

from __future__ import annotations

from pathlib import Path

from rosidl_py_gen.runtime.logs.loggers import get_logger

LARGE_BYTES = 500_000
"""Size from which a message needs large buffers."""
ENOUGH_SOCKET_BYTES = 4 << 20
"""With a buffer of 4 MiB, 6 MB images at 30 Hz arrived completely; with 1 MiB a fifth of them did not (loopback)."""
_LIMIT_FILE = Path("/proc/sys/net/core/rmem_max")

_has_warned = False


def warn_about_socket_buffers(size_bytes: int) -> None:
    """Warn at the first large message if Linux limits socket buffers to less than `ENOUGH_SOCKET_BYTES`."""
    global _has_warned
    if _has_warned:
        return
    _has_warned = True
    try:
        limit = int(_LIMIT_FILE.read_text())
    except (OSError, ValueError):  # not Linux, or a container that hides it
        return
    if limit < ENOUGH_SOCKET_BYTES:
        get_logger("rosidl_py_gen").warning(
            f"a message of {size_bytes} bytes was sent or received, but net.core.rmem_max limits socket buffers to "
            f"{limit} bytes; large messages will be slow or lost. Increase it: sudo sysctl -w "
            "net.core.rmem_max=33554432"
        )
