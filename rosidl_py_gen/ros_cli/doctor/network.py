"""Checks of the network: interfaces, whether multicast works on them, and which DDS domains others use here.

Flags and addresses are asked of the kernel (Linux); whether multicast works is tried with a packet that does not leave
the machine (TTL 0). Elsewhere only the names are known.
"""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.ros_cli.doctor.findings import BROKEN, NOTE, OK, WARNING, Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.runtime import DomainSettings

_SIOCGIFFLAGS, _SIOCGIFADDR = 0x8913, 0x8915  # linux/sockios.h
_UP, _LOOPBACK, _MULTICAST = 0x1, 0x8, 0x1000  # linux/if.h
_GROUP = "239.255.0.1"
"""Where DDS participants look for each other."""
_ECHO_S = 0.2
_FIRST_PORT, _PORTS, _LAST_DOMAIN = 7400, 250, 101
_UNICAST = range(10, 42, 2)
_MAX_INTERFACES = 64


@dataclass(frozen=True)
class Interface:
    """A network interface; None where the system does not tell."""

    name: str
    address: str | None = None
    is_up: bool | None = None
    is_loopback: bool | None = None
    multicast_flag: bool | None = None
    multicast_works: bool | None = None

    @property
    def reaches_others(self) -> bool:
        """Whether packets can go to other machines through it, as far as can be told."""
        return bool(self.address and self.is_up and not self.is_loopback)


def interfaces() -> list[Interface]:
    """What there is, at most 64; empty where the system does not tell."""
    try:
        names = [name for _, name in socket.if_nameindex()][:_MAX_INTERFACES]
    except (OSError, AttributeError):
        return []
    return [_interface(name) for name in names]


def _interface(name: str) -> Interface:
    try:
        import fcntl
    except ImportError:  # Windows
        return Interface(name)
    request = struct.pack("256s", name.encode()[:15])
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
            (flags,) = struct.unpack_from("=H", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request), 16)
            address = None
            with suppress(OSError):  # it has none
                address = socket.inet_ntoa(fcntl.ioctl(any_socket, _SIOCGIFADDR, request)[20:24])
    except OSError:
        return Interface(name)
    is_up = bool(flags & _UP)
    works = multicast_works(address) if address and is_up else None
    return Interface(name, address, is_up, bool(flags & _LOOPBACK), bool(flags & _MULTICAST), works)


def multicast_works(address: str) -> bool:
    """Whether a packet to the group of DDS, sent through the interface with this address, comes back to us."""
    own = socket.inet_aton(address)
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            receiver.bind(("", 0))
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(_GROUP) + own)
            receiver.settimeout(_ECHO_S)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            sender.sendto(b"rosidl-py doctor", (_GROUP, receiver.getsockname()[1]))
            return receiver.recv(64) == b"rosidl-py doctor"
    except OSError:
        return False


def list_interfaces(found: list[Interface]) -> Iterator[Finding]:
    """Each interface."""
    for one in found:
        yield _describe(one)
    if not found:
        yield Finding(NOTE, "network interfaces are not told by this system")


def check_interfaces(found: list[Interface], settings: DomainSettings | None) -> Iterator[Finding]:
    """Each interface, and whether they fit the discovery range of DDS."""
    yield from list_interfaces(found)
    if all(one.is_up is None for one in found):
        return
    if not any(one.is_up and one.address for one in found):
        yield Finding(BROKEN, "no network interface is up, not even loopback", "ip link set lo up")
        return
    if settings is None or settings.discovery_range.name != "SUBNET":
        return
    yield from _check_subnet([one for one in found if one.reaches_others], settings)


def _describe(one: Interface) -> Finding:
    data = {
        "name": one.name,
        "address": one.address,
        "up": one.is_up,
        "loopback": one.is_loopback,
        "multicast": one.multicast_flag,
        "multicast_works": one.multicast_works,
    }
    if one.is_up is None:
        return Finding(OK, f"{one.name}: nothing else is known of it on this system", data=data)
    if not one.is_up or not one.address:
        return Finding(OK, f"{one.name}: {'no IPv4 address' if one.is_up else 'down'}", data=data)
    works = "multicast works" if one.multicast_works else "multicast does not work"
    flag = "" if one.multicast_flag or not one.multicast_works else ", though its flag is not set: DDS does not use it"
    return Finding(OK, f"{one.name}: {one.address}, {works} on it{flag}", data=data)


def _check_subnet(usable: list[Interface], settings: DomainSettings) -> Iterator[Finding]:
    names = ", ".join(one.name for one in usable)
    if not usable:
        advice = "set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST for all, if only this machine is meant"
        yield Finding(NOTE, "no interface leads to other machines; only nodes of this one can be seen", advice)
    elif not any(one.multicast_flag and one.multicast_works for one in usable) and not settings.static_peers:
        advice = "set ROS_STATIC_PEERS to the addresses of the other machines, here and there"
        yield Finding(WARNING, f"multicast does not work on {names}: others are not found by themselves", advice)
    if len(usable) > 1 and "NetworkInterface" not in settings.cyclonedds_uri:
        choice = f'<NetworkInterface name="{usable[0].name}"/>'
        yield Finding(
            NOTE,
            f"{names} lead to other machines, and Cyclone DDS takes one of them: nodes behind the others are not seen",
            f"choose: CYCLONEDDS_URI='<CycloneDDS><Domain><General><Interfaces>{choice}</Interfaces></General></Domain>"
            "</CycloneDDS>'",
        )


def other_domains(own: int, files: tuple[Path, ...] = (Path("/proc/net/udp"),)) -> Iterator[Finding]:
    """Domains whose ports somebody on this machine has open; those above 101 cannot be told from other programs."""
    ports: set[int] = set()
    for file in files:
        with suppress(OSError, ValueError, IndexError):
            ports.update(int(line.split()[1].rpartition(":")[2], 16) for line in file.read_text().splitlines()[1:])
    found = set()
    for port in ports:
        domain, place = divmod(port - _FIRST_PORT, _PORTS)
        if 0 <= domain <= _LAST_DOMAIN and domain != own and (place == 0 or place in _UNICAST):
            found.add(domain)
    if found:
        listed = ", ".join(map(str, sorted(found)[:20]))
        advice = f"to look there: rosidl-py doctor --domain {min(found)}"
        yield Finding(
            NOTE, f"programs on this machine are in other domains: {listed}", advice, data={"domains": sorted(found)}
        )
