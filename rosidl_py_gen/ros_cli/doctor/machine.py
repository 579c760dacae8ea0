"""Checks of what is installed and set: versions, interface packages, environment variables, limits of the kernel."""

from __future__ import annotations

import os
import platform
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen import __version__
from rosidl_py_gen.base.resources import install_command
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli.doctor.findings import BROKEN, NOTE, OK, REDACTED_VARIABLES, WARNING, Finding
from rosidl_py_gen.runtime import ENOUGH_SOCKET_BYTES, middleware, read_environment

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_SHOWN_VARIABLES = (
    *("ROS_DISTRO", "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY"),
    *("ROS_SECURITY_ENABLE", "RMW_IMPLEMENTATION", "FASTDDS_BUILTIN_TRANSPORTS", "AMENT_PREFIX_PATH"),
)
_DDS = ("rmw_cyclonedds_cpp", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_FIRST_PORT, _PORTS = 7400, 250
_ONLY_FOR = {"cyclonedds": "dds", "eclipse-zenoh": "zenoh"}


def on_zenoh(environ: Mapping[str, str]) -> bool:
    """Whether nodes are on Zenoh, to which nothing applies that is said of DDS."""
    return middleware(environ, lambda warning: None) == "zenoh"


# -------------------------------------------------------------------------------------------------------- installation


def python() -> Iterator[Finding]:
    """Which Python runs which version of this program, on which system."""
    system = f"{platform.system()} {platform.release()} {platform.machine()}"
    runs = f"{platform.python_implementation()} {platform.python_version()}"
    data = {"rosidl_py_gen": __version__, "python": runs, "system": system}
    yield Finding(OK, f"rosidl-py-gen {__version__}, {runs}, {system}", data=data)


def libraries() -> Iterator[Finding]:
    """What the extra brings, and what the base needs."""
    chosen, extra = ("zenoh", "zenoh") if on_zenoh(os.environ) else ("dds", "node")
    for name in (*_ONLY_FOR, "PyYAML", "rich", "numpy"):
        try:
            yield Finding(OK, f"{name} {version(name)}", data={name: version(name)})
        except PackageNotFoundError:
            if _ONLY_FOR.get(name, chosen) != chosen:
                continue
            # The library of Cyclone DDS comes with other packages, too; the self-test says whether there is one.
            level = NOTE if name == "cyclonedds" else BROKEN
            yield Finding(level, f"{name} is not installed", install_command(extra))


def interfaces(paths: tuple[str, ...]) -> Iterator[Finding]:
    """Which definitions there are, and from where."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if not Path(prefix).is_dir():
            yield Finding(
                WARNING, f"AMENT_PREFIX_PATH names {prefix}, which is no folder", "source the setup file again"
            )
    try:
        search = scan_search_path(paths)
    except RosidlError as error:
        yield Finding(BROKEN, str(error), "correct --path or AMENT_PREFIX_PATH")
        return
    for origin in search.searched:
        count = sum(package.origin == origin for package in search.packages.values())
        yield Finding(OK, f"{count} interface packages: {origin}", data={"origin": origin, "packages": count})
    for problem in search.refused.values():
        yield Finding(WARNING, str(problem))


# ------------------------------------------------------------------------------------------------------------ settings


def settings(environ: Mapping[str, str], domain_id: int | None, discovery: str | None) -> Iterator[Finding]:
    """Domain, discovery range, and variables that are set."""
    try:
        found = read_environment(environ, domain_id=domain_id, discovery=discovery)
    except RosidlError as error:
        yield Finding(BROKEN, str(error), "correct the variable or the option")
    else:
        text = f"domain {found.domain_id}, discovery range {found.discovery_range.name}"
        peers = f", static peers: {', '.join(found.static_peers)}" if found.static_peers else ""
        public = f"{text}, {len(found.static_peers)} static peers" if peers else ""
        data = {"domain": found.domain_id, "discovery": found.discovery_range.value}
        yield Finding(OK, text + peers, public=public, data=data)
        for sentence in found.warnings:
            yield Finding(WARNING, sentence)
        if not on_zenoh(environ):
            yield from discovery_ports(found.domain_id)
    for name in (*_SHOWN_VARIABLES, *REDACTED_VARIABLES):
        value = environ.get(name, "")
        if value:
            yield Finding(OK, f"{name}={value}", public=f"{name} is set" if name in REDACTED_VARIABLES else "")
    yield from _pitfalls(environ)


def discovery_ports(domain_id: int, file: Path = Path("/proc/sys/net/ipv4/ip_local_port_range")) -> Iterator[Finding]:
    """Whether Linux may give a port of the domain to any socket."""
    try:
        low, high = map(int, file.read_text().split())
    except (OSError, ValueError):  # not Linux, or hidden
        return
    first = _FIRST_PORT + _PORTS * domain_id
    if low <= first + _PORTS and first <= high:
        yield Finding(
            NOTE,
            f"the UDP ports of domain {domain_id} begin at {first}, where Linux also takes ports for other programs "
            f"({low} to {high}): sometimes one will be taken, or a node of another domain be found",
            f"a domain below {(low - _FIRST_PORT) // _PORTS} is safe",
        )


def _pitfalls(environ: Mapping[str, str]) -> Iterator[Finding]:
    rmw = environ.get("RMW_IMPLEMENTATION", "")
    if rmw and rmw not in (*_DDS, "rmw_zenoh_cpp"):
        yield Finding(NOTE, f"whether nodes on {rmw} and this program understand each other was never tried")
    if environ.get("ROS_DISCOVERY_SERVER"):
        advice = "start nodes that shall be seen here without it, or with ROS_SUPER_CLIENT and a common network"
        yield Finding(WARNING, "Fast DDS nodes with ROS_DISCOVERY_SERVER answer their server only", advice)
    if environ.get("FASTDDS_BUILTIN_TRANSPORTS", "").upper().startswith("SHM"):
        yield Finding(WARNING, "Fast DDS nodes with shared memory only cannot be reached", "use UDPv4 or DEFAULT")
    if environ.get("ROS_SECURITY_ENABLE") == "true":
        text = "secured nodes (ROS_SECURITY_ENABLE=true) are not found here: SROS 2 security is not supported"
        yield Finding(WARNING, text, "with ROS_SECURITY_STRATEGY=Enforce no node starts here, else unencrypted")
    yield from cyclonedds_uri(environ.get("CYCLONEDDS_URI", ""))


def cyclonedds_uri(value: str) -> Iterator[Finding]:
    """Whether the configuration can be read: XML, or files with XML, separated by commas."""
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
        text = re.sub(r"<\?xml.*?\?>", "", text)  # may be in front of each fragment
        try:
            ElementTree.fromstring(f"<all>{text}</all>" if place == "CYCLONEDDS_URI" else text)
        except ElementTree.ParseError as error:
            yield Finding(BROKEN, f"{place} is not well-formed XML: {error}", "correct or unset CYCLONEDDS_URI")


# -------------------------------------------------------------------------------------------------------------- limits


def socket_buffers(file: Path = Path("/proc/sys/net/core/rmem_max")) -> Iterator[Finding]:
    """How large a burst of packets the kernel keeps for us."""
    try:
        limit = int(file.read_text())
    except (OSError, ValueError):
        yield Finding(NOTE, "how large socket buffers may be is not told by this system")
        return
    text = f"net.core.rmem_max is {limit}: socket buffers of {limit / (1 << 20):.1f} MiB"
    if limit >= ENOUGH_SOCKET_BYTES:
        yield Finding(OK, text, data={"rmem_max": limit})
    else:
        advice = "sudo sysctl -w net.core.rmem_max=33554432, and in /etc/sysctl.d to keep it"
        said = f"{text}; messages above 0.5 MB, such as images, will be slow or lost"
        yield Finding(WARNING, said, advice, data={"rmem_max": limit})
