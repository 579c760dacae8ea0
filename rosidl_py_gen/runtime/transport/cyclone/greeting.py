"""Tells Cyclone of writers on Fast DDS what they told too early; why is written at `rtps.greeting`.

Decides where a packet has to go to be taken for one of the writer's: to the socket of this process on which the samples
of the domain arrive. Linux only, as services with Fast DDS are.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.cyclone import rtps

if TYPE_CHECKING:
    from collections.abc import Iterable


def greet(domain_id: int, writer_guids: Iterable[bytes]) -> None:
    """Send greetings of these writers. Where no packet can be sent nothing is greeted."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for port in _data_ports(domain_id):
            for guid in writer_guids:
                out.sendto(rtps.greeting(guid), ("127.0.0.1", port))


def _data_ports(domain_id: int) -> list[int]:
    """Source: protocol.md 10.6."""
    first = 7400 + 250 * domain_id + 11
    ports = []
    for descriptor in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # closed in the meantime
            if stat.S_ISSOCK(os.fstat(int(descriptor)).st_mode):
                with socket.socket(fileno=os.dup(int(descriptor))) as own:
                    if (own.family, own.type) == (socket.AF_INET, socket.SOCK_DGRAM):
                        ports.append(own.getsockname()[1])
    return [port for port in ports if port in range(first, first + 239, 2)]
