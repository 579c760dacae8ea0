"""Says, once, when this machine's socket buffers are too small for the messages that pass.

Decides the limits only. A message of some megabytes is a burst of thousands of packets; what does not fit the receiving
socket's buffer is lost, and has to be sent again (reliable) or stays lost (best effort).
"""

from __future__ import annotations

from pathlib import Path

from rosidl_py_gen.runtime.logs.loggers import get_logger

LARGE_BYTES = 500_000
ENOUGH_SOCKET_BYTES = 4 << 20
"""With a buffer of 4 MiB, 6 MB images at 30 Hz arrived whole; with 1 MiB a fifth of them did not (loopback)."""
_LIMIT_FILE = Path("/proc/sys/net/core/rmem_max")

_has_warned = False


def warn_about_socket_buffers(size_bytes: int, limit_file: Path = _LIMIT_FILE) -> None:
    """Warn the first time a large message passes on a Linux whose buffers are limited below `ENOUGH_SOCKET_BYTES`."""
    global _has_warned
    if _has_warned:
        return
    _has_warned = True
    try:
        limit = int(limit_file.read_text())
    except (OSError, ValueError):  # not Linux, or a container that hides it
        return
    if limit < ENOUGH_SOCKET_BYTES:
        get_logger("rosidl_py_gen").warning(
            f"a message of {size_bytes} bytes passes, but net.core.rmem_max allows socket buffers of {limit} bytes "
            "only; large messages will be slow or lost. Allow more with: sudo sysctl -w net.core.rmem_max=33554432"
        )
