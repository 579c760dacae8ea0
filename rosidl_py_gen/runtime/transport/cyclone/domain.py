"""DDS domains of this process: configured once, shared by its participants, and not usable after a fork.

Decides what is refused because Cyclone would do something else than was asked, or hang, and what to tell the user when
a domain cannot be configured. Cyclone itself answers "Error" to every trouble and prints the details on stderr.

Why not after a fork: the child inherits the open domain, but not the threads that serve it. Tried with 11.0.1: a
participant of the same domain is created, discovers nobody, and its deletion waits for ever. When all contexts were
closed before the fork nothing is inherited, and DDS works in the child.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from typing import TYPE_CHECKING, ClassVar

from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone import c_api
from rosidl_py_gen.runtime.transport.cyclone.config import MAX_PARTICIPANT_INDEX
from rosidl_py_gen.runtime.transport.cyclone.topics import Sertypes

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import FastDdsInterop

_CLOSE_TIMEOUT_S = 5.0
_CLOSE_POLL_INTERVAL_S = 0.001
"""How long `leave` waits for writes, and how often it looks: to be told of each would cost more than they do."""
_FIRST_PORT, _PORTS_PER_DOMAIN, _FIRST_UNICAST, _PORTS_PER_INDEX = 7400, 250, 10, 2


class Domain:
    """A configured domain; lives as long as a participant of ours uses it."""

    _open: ClassVar[dict[int, Domain]] = {}
    _lock: ClassVar[threading.Lock] = threading.Lock()
    _forked: ClassVar[bool] = False

    def __init__(self, api: c_api.CycloneApi, fast_dds: FastDdsInterop, domain_id: int, xml: str) -> None:
        self._api = api
        self._domain_id = domain_id
        self._xml = xml
        self._users = 0
        self.is_closing = False
        """Nobody uses it any more, and it ends as soon as nobody writes."""
        self.writing: list[int] = []
        """Threads that make a sample or write it just now: types and memory of the domain are in use there."""
        self._end_lock = threading.Lock()
        self._has_ended = False
        self.types = Sertypes(api, fast_dds.prepare)
        code = api.create_domain(domain_id, xml.encode())
        self._handle = 0 if code == c_api.PRECONDITION_NOT_MET else code
        if self._handle == 0:
            # Another user of the same libddsc made the domain already.
            get_root_logger().warning(
                f"domain {domain_id} was configured by other code of this process: discovery range, static peers and "
                "CYCLONEDDS_URI have no effect here"
            )
        elif code < 0:
            reason = api.strretcode(code).decode()
            raise TransportError(
                f"Cyclone DDS could not configure domain {domain_id}: {reason} ({code}). "
                f"{_diagnose_failure(domain_id, xml)}"
            )

    @classmethod
    def join(cls, api: c_api.CycloneApi, fast_dds: FastDdsInterop, domain_id: int, xml: str) -> Domain:
        """The domain with that configuration. Every `join` needs a `leave`.

        Raises:
            TransportError: it is open with another configuration, or cannot be configured, or this process was forked
                from one that has a domain open.
        """
        with cls._lock:
            if cls._forked:
                raise TransportError(
                    "this process was forked from one that uses DDS, whose threads did not come along; start it with "
                    'multiprocessing\'s "spawn" method, or fork before the first node is made'
                )
            domain = cls._open.get(domain_id)
            if domain is None:
                domain = cls._open[domain_id] = cls(api, fast_dds, domain_id, xml)
            elif domain._xml != xml:
                raise TransportError(
                    f"domain {domain_id} is open in this process with another configuration, and DDS has one for each "
                    "domain of a process. Use the same discovery range, static peers and CYCLONEDDS_URI, close the "
                    f"first context, or take another domain. Open: {domain._xml!r}; asked for: {xml!r}"
                )
            domain._users += 1
            return domain

    def leave(self) -> None:
        """Undo one `join`; the last one waits for other threads that write. Where it is called in a signal handler that
        interrupted a write, the domain ends with that.
        """
        with Domain._lock:
            self._users -= 1
            if self._users == 0:
                del self._open[self._domain_id]
                self.is_closing = True
                end_s, here = time.monotonic() + _CLOSE_TIMEOUT_S, threading.get_ident()
                while any(one != here for one in tuple(self.writing)) and time.monotonic() < end_s:
                    time.sleep(_CLOSE_POLL_INTERVAL_S)
                self.end_if_unused()

    def end_if_unused(self) -> None:
        """After `leave`, and after each write from then on."""
        with self._end_lock:
            if self.writing or self._has_ended:
                return
            self._has_ended = True
        self.types.close()
        if self._handle:
            self._api.delete(self._handle)

    @classmethod
    def detach_after_fork(cls) -> None:
        """In a forked child: leave what was inherited alone, and remember that it is there."""
        cls._lock = threading.Lock()
        for domain in cls._open.values():
            cls._forked = True
            domain._api.disable_deletes()
        cls._open.clear()


def _diagnose_failure(domain_id: int, xml: str) -> str:
    """What is wrong, as far as can be told from outside, and what to do."""
    if not _has_free_index(domain_id):
        return (
            f"All {MAX_PARTICIPANT_INDEX} participant indexes of the domain are taken on this machine, so that many "
            "processes are in it already: end some, or use another ROS_DOMAIN_ID"
        )
    uri = os.environ.get("CYCLONEDDS_URI", "")
    if uri:
        return (
            f"CYCLONEDDS_URI is set to {uri!r}: most likely its XML is not valid, its file does not exist, or it names "
            "an interface that does not. Cyclone printed what it stumbled over; correct the variable or unset it"
        )
    return f"Cyclone printed why; most likely no network interface can be used. The configuration was {xml!r}"


def _has_free_index(domain_id: int) -> bool:
    """Whether one of the UDP ports that participants of this machine share can be bound.

    Source: docs/internals/protocol.md 10.6.
    """
    first = _FIRST_PORT + _PORTS_PER_DOMAIN * domain_id + _FIRST_UNICAST
    return any(_is_free(first + _PORTS_PER_INDEX * index) for index in range(MAX_PARTICIPANT_INDEX))


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
        return True
