"""Checks of the network: interfaces, multicast, and DDS domains of other programs on this machine.

Linux reports flags and addresses; other systems only names. Multicast is tested with a packet that does not leave the
machine (TTL 0).
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
"""IP address of the multicast group that DDS discovery uses."""
_MULTICAST_TIMEOUT_S = 0.2
FIRST_PORT = 7400
PORTS_PER_DOMAIN = 250
_MAX_DOMAIN = 101
"""Maximum DDS domain whose ports are checked; ports of higher domains are also assigned to other programs."""
_UNICAST_OFFSETS = range(10, 42, 2)
_MAX_INTERFACES = 64


@dataclass(frozen=True)
class Interface:
    """Network interface; attributes that the system does not report are None."""

    name: str
    address: str | None = None
    is_up: bool | None = None
    is_loopback: bool | None = None
    multicast_flag: bool | None = None
    multicast_works: bool | None = None


def network_interfaces() -> list[Interface]:
    """Return the network interfaces of this machine, at most 64; an empty list if the system does not report them."""
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
            with suppress(OSError):  # no IPv4 address
                address = socket.inet_ntoa(fcntl.ioctl(any_socket, _SIOCGIFADDR, request)[20:24])
    except OSError:
        return Interface(name)
    is_up = bool(flags & _UP)
    works = multicast_works(address) if address and is_up else None
    return Interface(name, address, is_up, bool(flags & _LOOPBACK), bool(flags & _MULTICAST), works)


def multicast_works(address: str) -> bool:
    """Return True if a multicast packet to the group of DDS, sent through the interface with `address`, is received."""
    own = socket.inet_aton(address)
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            receiver.bind(("", 0))
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(_GROUP) + own)
            receiver.settimeout(_MULTICAST_TIMEOUT_S)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            sender.sendto(b"rosidl-py doctor", (_GROUP, receiver.getsockname()[1]))
            return receiver.recv(64) == b"rosidl-py doctor"
    except OSError:
        return False


def check_interfaces(interfaces: list[Interface], settings: DomainSettings | None) -> Iterator[Finding]:
    """Report each network interface, and check that the interfaces suffice for the discovery range of DDS."""
    is_local = settings is not None and settings.discovery_range.name == "LOCALHOST"
    for one in interfaces:
        yield _describe(one, is_local)
    if not interfaces:
        yield Finding(NOTE, "this system does not report network interfaces")
    if all(one.is_up is None for one in interfaces):
        return
    if not any(one.is_up and one.address for one in interfaces):
        yield Finding(BROKEN, "no network interface is up, not even loopback", "ip link set lo up")
        return
    if settings is None or settings.discovery_range.name != "SUBNET":
        return
    yield from _check_subnet([one for one in interfaces if one.address and one.is_up and not one.is_loopback], settings)


def _describe(one: Interface, is_local: bool) -> Finding:
    data = {
        "name": one.name,
        "address": one.address,
        "up": one.is_up,
        "loopback": one.is_loopback,
        "multicast": one.multicast_flag,
        "multicast_works": one.multicast_works,
    }
    if one.is_up is None:
        return Finding(OK, f"{one.name}: this system reports no details", data=data)
    if not one.is_up or not one.address:
        return Finding(OK, f"{one.name}: {'no IPv4 address' if one.is_up else 'down'}", data=data)
    if is_local and one.is_loopback:
        return Finding(OK, f"{one.name}: {one.address}, used by the discovery range LOCALHOST", data=data)
    works = "multicast works" if one.multicast_works else "multicast does not work"
    flag = "" if one.multicast_flag or not one.multicast_works else ", though its flag is not set: DDS does not use it"
    return Finding(OK, f"{one.name}: {one.address}, {works} on it{flag}", data=data)


def _check_subnet(usable: list[Interface], settings: DomainSettings) -> Iterator[Finding]:
    names = ", ".join(one.name for one in usable)
    if not usable:
        advice = "if only this machine is used, set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST for all nodes"
        yield Finding(NOTE, "no interface leads to other machines; only nodes of this machine can be found", advice)
    elif not any(one.multicast_flag and one.multicast_works for one in usable) and not settings.static_peers:
        advice = "set ROS_STATIC_PEERS to the addresses of the other machines, on each machine"
        yield Finding(
            WARNING, f"multicast does not work on {names}: other machines are not found automatically", advice
        )
    if len(usable) > 1 and "NetworkInterface" not in settings.cyclonedds_uri:
        choice = f'<NetworkInterface name="{usable[0].name}"/>'
        yield Finding(
            NOTE,
            f"{names} lead to other machines, and Cyclone DDS uses one of them: nodes on the others are not found",
            f"choose: CYCLONEDDS_URI='<CycloneDDS><Domain><General><Interfaces>{choice}</Interfaces></General></Domain>"
            "</CycloneDDS>'",
        )


def other_domains(own: int, files: tuple[Path, ...] = (Path("/proc/net/udp"),)) -> Iterator[Finding]:
    """Report DDS domains whose ports are open on this machine, up to domain 101."""
    ports: set[int] = set()
    for file in files:
        with suppress(OSError, ValueError, IndexError):
            ports.update(int(line.split()[1].rpartition(":")[2], 16) for line in file.read_text().splitlines()[1:])
    domains = set()
    for port in ports:
        domain, offset = divmod(port - FIRST_PORT, PORTS_PER_DOMAIN)
        if 0 <= domain <= _MAX_DOMAIN and domain != own and (offset == 0 or offset in _UNICAST_OFFSETS):
            domains.add(domain)
    if domains:
        listed = ", ".join(map(str, sorted(domains)[:20]))
        advice = f"to check one: rosidl-py doctor --domain {min(domains)}"
        yield Finding(
            NOTE, f"programs on this machine are in other domains: {listed}", advice, data={"domains": sorted(domains)}
        )
