"""State of peers on Fast DDS, for tests without such a peer."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsInterop, FastDdsPeers, FastDdsSupport


def new_domain(support: FastDdsSupport | None = None) -> FastDdsInterop:
    """Return the state of a domain that does not exist; `support` is by default that of the loaded library."""
    from rosidl_py_gen.runtime.transport.cyclone import participant
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsInterop

    return FastDdsInterop(participant.FAST_DDS_SUPPORT if support is None else support)


def new_peers(domain: FastDdsInterop | None = None) -> FastDdsPeers:
    """Return the peers of a participant that does not exist, by default in a domain of its own."""
    from rosidl_py_gen.runtime.transport.cyclone import participant
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsPeers

    domain = new_domain() if domain is None else domain
    return FastDdsPeers(domain, participant.API.create_listener(None), is_local=True, is_secured=False)


def fast_dds_property(name: bytes) -> str:
    """Return a property of a discovered participant on Fast DDS."""
    return "SIMPLE" if name == b"PARTICIPANT_TYPE" else ""
