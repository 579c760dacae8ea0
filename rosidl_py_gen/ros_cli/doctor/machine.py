"""Checks of the machine and its network.

Checks of the machine are about versions, interface packages, environment variables and limits of the kernel. Checks of
the network are about interfaces, multicast, and DDS domains of other programs on this machine. Linux reports flags and
addresses of interfaces; other systems only names. Multicast is tested with a packet that does not leave the machine
(TTL 0).
"""

from __future__ import annotations

import os
import platform
import re
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen import __version__
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.compiler.frontend import SearchPath
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli.doctor import BROKEN, NOTE, OK, REDACTED_VARIABLES, WARNING, Finding
from rosidl_py_gen.runtime import ENOUGH_SOCKET_BYTES, SecurityError, find_security, middleware, read_environment
from rosidl_py_gen.type_loading import CacheFolder

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

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


_SHOWN_VARIABLES = (
    *("ROS_DISTRO", "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY"),
    *("ROS_SECURITY_ENABLE", "ROS_SECURITY_STRATEGY", "ROS_SECURITY_ENCLAVE_OVERRIDE"),
    *("RMW_IMPLEMENTATION", "FASTDDS_BUILTIN_TRANSPORTS", "AMENT_PREFIX_PATH"),
)
_DDS = ("rmw_cyclonedds_cpp", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_MIDDLEWARE_OF = {"cyclonedds": "dds", "eclipse-zenoh": "zenoh"}


def uses_zenoh(environ: Mapping[str, str]) -> bool:
    """Return True if nodes on this machine use Zenoh, to which the checks of DDS do not apply."""
    return middleware(environ, lambda warning: None) == "zenoh"


# -------------------------------------------------------------------------------------------------------- installation


def python() -> Iterator[Finding]:
    """Report the versions of this package and of Python, and the operating system."""
    system = f"{platform.system()} {platform.release()} {platform.machine()}"
    runs = f"{platform.python_implementation()} {platform.python_version()}"
    data = {"rosidl_py_gen": __version__, "python": runs, "system": system}
    yield Finding(OK, f"rosidl-py-gen {__version__}, {runs}, {system}", data=data)


def libraries() -> Iterator[Finding]:
    """Check that the Python packages that a node requires are installed, and report their versions."""
    chosen, extra = ("zenoh", "zenoh") if uses_zenoh(os.environ) else ("dds", "node")
    for name in (*_MIDDLEWARE_OF, "PyYAML", "rich", "numpy"):
        try:
            yield Finding(OK, f"{name} {version(name)}", data={name: version(name)})
        except PackageNotFoundError:
            if _MIDDLEWARE_OF.get(name, chosen) != chosen:
                continue
            if name == "cyclonedds":
                # Without advice: the self-test reports the library that is used, or what to install on this platform.
                yield Finding(NOTE, "cyclonedds is not installed; DDS uses another libddsc if one is found")
            else:
                yield Finding(BROKEN, f"{name} is not installed", Extra(extra).install_command())


def interfaces(paths: tuple[str, ...]) -> Iterator[Finding]:
    """Report the number of interface packages in each part of the search path, and problems with them."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if not Path(prefix).is_dir():
            yield Finding(
                WARNING, f"AMENT_PREFIX_PATH names {prefix}, which is not a folder", "source the setup file again"
            )
    try:
        search = SearchPath.scan(paths)
    except RosidlError as error:
        yield Finding(BROKEN, str(error), "correct --path or AMENT_PREFIX_PATH")
        return
    for origin in search.searched:
        count = sum(package.origin == origin for package in search.packages.values())
        yield Finding(
            OK, f"{pluralize(count, 'interface package')}: {origin}", data={"origin": origin, "packages": count}
        )
    for problem in search.refused.values():
        yield Finding(WARNING, str(problem))


# ------------------------------------------------------------------------------------------------------------ settings


def settings(environ: Mapping[str, str], domain_id: int | None, discovery: str | None) -> Iterator[Finding]:
    """Check the domain id, the discovery range, and environment variables of ROS."""
    try:
        domain = read_environment(environ, domain_id=domain_id, discovery=discovery)
    except RosidlError as error:
        yield Finding(BROKEN, str(error), "correct the variable or the option")
    else:
        text = f"domain {domain.domain_id}"
        if not uses_zenoh(environ):
            text += f", discovery range {domain.discovery_range.name}"
        peers = f", static peers: {', '.join(domain.static_peers)}" if domain.static_peers else ""
        public = f"{text}, {len(domain.static_peers)} static peers" if peers else ""
        data = {"domain": domain.domain_id, "discovery": domain.discovery_range.value}
        yield Finding(OK, text + peers, public=public, data=data)
        for sentence in domain.warnings:
            yield Finding(WARNING, sentence)
        if not uses_zenoh(environ):
            yield from discovery_ports(domain.domain_id)
    for name in (*_SHOWN_VARIABLES, *REDACTED_VARIABLES):
        value = environ.get(name, "")
        if value:
            yield Finding(OK, f"{name}={value}", public=f"{name} is set" if name in REDACTED_VARIABLES else "")
    yield from _pitfalls(environ)
    for text, advice in CacheFolder.problems():
        yield Finding(WARNING, text, advice)


def discovery_ports(domain_id: int, file: Path = Path("/proc/sys/net/ipv4/ip_local_port_range")) -> Iterator[Finding]:
    """Report a note if Linux may assign the UDP ports of the DDS domain to sockets of other programs."""
    try:
        low, high = map(int, file.read_text().split())
    except (OSError, ValueError):  # not Linux, or hidden
        return
    first = FIRST_PORT + PORTS_PER_DOMAIN * domain_id
    if low <= first + PORTS_PER_DOMAIN and first <= high:
        yield Finding(
            NOTE,
            f"the UDP ports of domain {domain_id} begin at {first}, in the range that Linux assigns to other programs "
            f"({low} to {high}): a port may be in use, or a node of another domain may be found",
            f"a domain below {(low - FIRST_PORT) // PORTS_PER_DOMAIN} is safe",
        )


def _pitfalls(environ: Mapping[str, str]) -> Iterator[Finding]:
    rmw = environ.get("RMW_IMPLEMENTATION", "")
    if rmw and rmw not in (*_DDS, "rmw_zenoh_cpp"):
        yield Finding(NOTE, f"nodes on {rmw} were never tested with this program")
    if environ.get("ROS_DISCOVERY_SERVER"):
        advice = "start those nodes without it, or with ROS_SUPER_CLIENT and a common network"
        yield Finding(WARNING, "Fast DDS nodes with ROS_DISCOVERY_SERVER are discovered only by their server", advice)
    if environ.get("FASTDDS_BUILTIN_TRANSPORTS", "").upper().startswith("SHM"):
        yield Finding(WARNING, "Fast DDS nodes that use only shared memory cannot be reached", "use UDPv4 or DEFAULT")
    yield from _security(environ)
    yield from cyclonedds_uri(environ.get("CYCLONEDDS_URI", ""))


def _security(environ: Mapping[str, str]) -> Iterator[Finding]:
    """Check the security files of the enclave ``/``, or of the enclave that ROS_SECURITY_ENCLAVE_OVERRIDE names."""
    warnings: list[str] = []
    try:
        security = find_security(environ, "/", warnings.append, is_supported=not uses_zenoh(environ))
    except SecurityError as error:
        yield Finding(BROKEN, str(error), public="the enclave is incomplete")
        return
    for text in warnings:
        yield Finding(WARNING, text, public="the settings of security do not enable it")
    if security is not None:
        yield Finding(OK, f"security is on, with the files in {security.folder}", public="security is on")


def cyclonedds_uri(value: str) -> Iterator[Finding]:
    """Check that the value of CYCLONEDDS_URI is XML, or a list of files with XML."""
    from xml.etree import ElementTree

    if not value.strip():
        return
    texts: dict[str, str] = {}
    if value.lstrip().startswith("<"):
        texts["CYCLONEDDS_URI"] = value
    else:
        for name in value.split(","):
            path = name.strip().removeprefix("file://")
            try:
                texts[path] = Path(path).read_text(encoding="utf-8", errors="replace")
            except OSError as error:
                yield Finding(BROKEN, f"CYCLONEDDS_URI names {path}: {error.strerror}", "correct or unset it")
    for place, text in texts.items():
        text = re.sub(r"<\?xml.*?\?>", "", text)  # allowed before each fragment
        try:
            ElementTree.fromstring(f"<all>{text}</all>" if place == "CYCLONEDDS_URI" else text)
        except ElementTree.ParseError as error:
            yield Finding(BROKEN, f"{place} is not well-formed XML: {error}", "correct or unset CYCLONEDDS_URI")


# -------------------------------------------------------------------------------------------------------------- limits


def socket_buffers(file: Path = Path("/proc/sys/net/core/rmem_max")) -> Iterator[Finding]:
    """Check the maximum size of socket buffers, which limits bursts of packets."""
    try:
        limit = int(file.read_text())
    except (OSError, ValueError):
        yield Finding(NOTE, "this system does not report the maximum size of socket buffers")
        return
    text = f"net.core.rmem_max is {limit}: socket buffers of {limit / (1 << 20):.1f} MiB"
    if limit >= ENOUGH_SOCKET_BYTES:
        yield Finding(OK, text, data={"rmem_max": limit})
    else:
        advice = "sudo sysctl -w net.core.rmem_max=33554432, and set it in /etc/sysctl.d"
        text += "; messages above 0.5 MB, such as images, may be slow or lost"
        yield Finding(WARNING, text, advice, data={"rmem_max": limit})
