"""DDS domains and a Zenoh router of the test process; a fixture keeps every test on the loopback interface."""

from __future__ import annotations

import atexit
import functools
import os
import sys
from typing import TYPE_CHECKING, Any

import pytest
import zenoh

from rosidl_py_gen.runtime import Context
from rosidl_py_gen.runtime.transport.cyclone import library
from support.machine_locks import holds, lock

if TYPE_CHECKING:
    from collections.abc import Iterator

FIRST_DOMAIN, DOMAINS = 10, 45
"""Twice as many as `DOMAINS`, and none above 100: no other socket is given their ports (docs/howto/network.md)."""
_LOCAL_ENDPOINTS = ("tcp/127.0.0.1:", "tls/127.0.0.1:", "tcp/localhost:", "tls/localhost:", "tcp/[::1]:")
_open_session = zenoh.open
_domains: dict[int, int] = {}
"""Domain IDs locked by this test process, with the lock's descriptor."""


def new_domain_id() -> int:
    """Return a domain that neither another test process of this machine nor this one uses."""
    start = os.getpid() * 7
    all_of_them = (FIRST_DOMAIN + (start + offset) % DOMAINS for offset in range(DOMAINS))
    for number in all_of_them:
        held = lock(f"domain-{number}", wait=False)
        if held is not None:
            _domains[number] = held
            return number
    raise LookupError("other test processes have all domains")


@functools.cache
def domain_id() -> int:
    """Return the domain of this test process, so that parallel runs do not discover each other."""
    return new_domain_id()


def second_domain_id() -> int:
    """Return a second domain that only this test process uses."""
    return domain_id() + DOMAINS


@functools.cache
def zenoh_router() -> str:
    from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

    router = ZenohRouter({}, print, listen=["tcp/127.0.0.1:0"])
    atexit.register(router.close)
    return router.endpoints[0]


def zenoh_environment() -> dict[str, str]:
    """Return the variables of nodes and peers that use the router of this process on the loopback interface."""
    endpoints = f'connect/endpoints=["{zenoh_router()}"];listen/endpoints=["tcp/127.0.0.1:0"]'
    return {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": endpoints}


@pytest.fixture(autouse=True)
def only_loopback(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Force discovery onto localhost; any other participant fails the test."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id()))
    for name in ("CYCLONEDDS_URI", "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY"):
        monkeypatch.delenv(name, raising=False)
    for name in ("RMW_IMPLEMENTATION", *(name for name in os.environ if "ZENOH_" in name)):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", "off")
    monkeypatch.setattr(sys, "argv", ["test"])
    if library.is_found():
        _guard_dds(monkeypatch)
    monkeypatch.setattr(zenoh, "open", guarded_open)
    yield
    Context.close_default()
    lost = [number for number, held in _domains.items() if not holds(held, f"domain-{number}")]
    assert not lost, f"something closed the locks of the domains {lost}, which are another's descriptors"


def _guard_dds(monkeypatch: pytest.MonkeyPatch) -> None:
    from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone

    original = cyclone.Domain.join

    def guarded(api: Any, support: Any, number: int, xml: str, enclave_folder: str) -> cyclone.Domain:
        # Cyclone before 11 is not bound, and told by "localhost" alone where to look (docs/internals/dds.md 8).
        assert 'address="127.0.0.1"' in xml or support.loopback_refusal, f"not bound to loopback: {xml}"
        assert '<Peer address="localhost"/>' in xml or "ros_discovery_off" in xml, xml
        assert xml.count("<AllowMulticast>false</AllowMulticast>") > 0, f"multicast is on: {xml}"
        assert number in _domains or number - DOMAINS in _domains, f"domain {number} is not this test run's"
        return original(api, support, number, xml, enclave_folder)

    monkeypatch.setattr(cyclone.Domain, "join", guarded)


def guarded_open(config: Any) -> Any:
    """Open a session of Zenoh that cannot be reached from elsewhere."""
    from rosidl_py_gen.runtime.transport.zenoh.participant import configured_endpoints

    for what in ("listen", "connect"):
        strange = [one for one in configured_endpoints(config, what) if not one.startswith(_LOCAL_ENDPOINTS)]
        assert not strange, f"not bound to loopback: {what} {strange}"
    assert config.get_json("scouting/multicast/enabled") == "false"
    return _open_session(config)
