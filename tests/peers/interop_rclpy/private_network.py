"""Network namespace of this test process with a loopback device only, so that the packets of peers stay in it.

Linux moves single threads into a network namespace. Threads and processes that are started inside stay inside, so those
of Cyclone DDS and of the peers do; the calling thread goes in and out. It needs the right to create a namespace, which
root has.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import socket
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_CLONE_NEWNET = 0x40000000  # linux/sched.h
_SIOCSIFFLAGS = 0x8914  # linux/sockios.h
_IFF_UP_RUNNING_MULTICAST = 0x1 | 0x40 | 0x1000  # linux/if.h
_HERE = "/proc/thread-self/ns/net"
_libc = ctypes.CDLL(None, use_errno=True)


class PrivateNetwork:
    """Network namespace; raises OSError if the system refuses it."""

    def __init__(self) -> None:
        before = os.open(_HERE, os.O_RDONLY)
        try:
            _checked(_libc.unshare(_CLONE_NEWNET))
            self._inside = os.open(_HERE, os.O_RDONLY)
            _start_loopback()
        finally:
            _checked(_libc.setns(before, _CLONE_NEWNET))
            os.close(before)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Return a context manager that puts the calling thread inside."""
        before = os.open(_HERE, os.O_RDONLY)
        _checked(_libc.setns(self._inside, _CLONE_NEWNET))
        try:
            yield
        finally:
            _checked(_libc.setns(before, _CLONE_NEWNET))
            os.close(before)

    def close(self) -> None:
        os.close(self._inside)


def _checked(result: int) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _start_loopback() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sH14x", b"lo", _IFF_UP_RUNNING_MULTICAST)
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, request)
