"""DDS domains of this process, their topics, and the type objects (sertypes) of Cyclone that topics share.

A domain is configured once and shared by its participants. There is one type object for each domain and type while the
domain is open.
"""

from __future__ import annotations

import ctypes as ct
import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import ClassVar, NamedTuple

from rosidl_py_gen.runtime.logs import get_root_logger
from rosidl_py_gen.runtime.transport.api import SecurityError, TransportError
from rosidl_py_gen.runtime.transport.cyclone import library, private_layout
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsInterop, FastDdsSupport
from rosidl_py_gen.runtime.transport.cyclone.library import MAX_PARTICIPANT_INDEX, CycloneApi, TopicDescriptor

_MAX_TYPE_CHARS = 255
"""Maximum length of the name of a type in DDS; earlier versions of Cyclone, and perhaps peers, have this limit."""
# One opaque type represents every ROS type (docs/internals/dds.md 1). A true description of a PointCloud2 takes 3 ms to
# build, does not exist for wstrings, and makes Cyclone drop invalid samples (bool 2, missing NUL) silently. Opaque
# samples arrive and are counted.
_OPS = (ct.c_uint32 * 3)(0x01010000, 0, 0)
"""Serializer program of Cyclone for ``struct opaque { octet data; }``: an octet at offset 0, then the end."""


class Sertype(NamedTuple):
    """Type object (sertype) of Cyclone for one type in one domain, given by its address in memory."""

    address: int
    payload_offset: int | None
    """Offset of the serialized message in a sample of Cyclone in memory; None if Cyclone must copy the message out of a
    sample."""


class Sertypes:
    """Type objects of one domain; `prepare` is called with each new type object and the DDS name of its type."""

    def __init__(self, api: CycloneApi, prepare: Callable[[Sertype, str], None]) -> None:
        self._api = api
        self._prepare = prepare
        self._lock = threading.Lock()
        self._known: dict[str, Sertype] = {}

    def create_topic(self, participant: int, topic: str, dds_type: str) -> int:
        """Create a topic entity of Cyclone and return its handle; topics of one type share one type object.

        Raises:
            TransportError: the type name is too long, Cyclone refused, or the type object was not found.
        """
        if len(dds_type) > _MAX_TYPE_CHARS:
            raise TransportError(
                f"DDS type {dds_type[:60]}...: expected at most {_MAX_TYPE_CHARS} characters, got {len(dds_type)}"
            )
        api = self._api
        activity = f"create topic {topic} ({dds_type})"
        with self._lock:
            # A second type object would have the same hash but not be equal where vtables are replaced; Cyclone's hash
            # table grows without end if some dozens of equal hashes collide (docs/internals/dds.md 1).
            known = self._known.get(dds_type)
            if known is not None:
                reference = ct.c_void_p(api.sertype_ref(known.address))  # which the call consumes
                code = api.create_topic_sertype(participant, topic.encode(), ct.byref(reference), None, None, None)
                return api.check(code, activity)
            descriptor = TopicDescriptor(
                size=1, align=1, type_name=dds_type.encode(), op_count=len(_OPS), ops=ct.addressof(_OPS)
            )  # which Cyclone copies
            code = api.create_topic(participant, ct.byref(descriptor), topic.encode(), None, None)
            entity = api.check(code, activity)
            address = self._type_of(entity, dds_type)
            if address is None:
                raise TransportError(
                    f"Cyclone DDS could not {activity}: the library has no dds_get_entity_sertype, and the type was "
                    "not found in the topic; use another libddsc"
                )
            # Before `prepare` replaces functions that the probe calls (docs/internals/cyclone_memory.md 2).
            payload_offset = private_layout.probe_payload_offset(api, address)
            known = self._known[dds_type] = Sertype(api.sertype_ref(address), payload_offset)
            self._prepare(known, dds_type)
            return entity

    def _type_of(self, topic: int, dds_type: str) -> int | None:
        api = self._api
        if api.get_entity_sertype is None:  # an older library: docs/internals/cyclone_memory.md 3
            with api.locked_entity(topic) as address:
                return private_layout.probe_sertype(address, dds_type.encode(), api.sertype_version)
        address = ct.c_void_p()
        api.check(api.get_entity_sertype(topic, ct.byref(address)), f"find the type {dds_type}")
        return address.value

    def __getitem__(self, dds_type: str) -> Sertype:
        """Return the type object of a DDS type; `create_topic` must have created a topic of this type."""
        return self._known[dds_type]

    def close(self) -> None:
        """Release all type objects. Called before the domain is deleted."""
        with self._lock:
            for known in self._known.values():
                self._api.sertype_unref(known.address)
            self._known.clear()


# -------------------------------------------------------------------------------------------------------------- domains

_CLOSE_TIMEOUT_S = 5.0
"""Maximum time in seconds that `wait_for_others` waits for other threads."""
_CLOSE_POLL_INTERVAL_S = 0.001
"""Interval in seconds in which `wait_for_others` checks for other threads; a notification by each write would cost more
than the write."""
_FIRST_PORT = 7400
_PORTS_PER_DOMAIN = 250
_FIRST_UNICAST_PORT = 10
_PORTS_PER_INDEX = 2


def wait_for_others(threads: list[int]) -> None:
    """Wait until a list of thread ids contains no id of another thread, or the maximum time has passed.

    The id of the calling thread does not count: a signal handler may close a context while its own thread is writing,
    and this write never ends while the handler waits.
    """
    end_s, thread_id = time.monotonic() + _CLOSE_TIMEOUT_S, threading.get_ident()
    while any(other != thread_id for other in tuple(threads)) and time.monotonic() < end_s:
        time.sleep(_CLOSE_POLL_INTERVAL_S)


class Domain:
    """DDS domain in this process, with its configuration; it exists while a participant of the process uses it."""

    _open: ClassVar[dict[int, Domain]] = {}
    _lock: ClassVar[threading.Lock] = threading.Lock()
    _forked: ClassVar[bool] = False

    def __init__(
        self, api: library.CycloneApi, support: FastDdsSupport, domain_id: int, xml: str, enclave_folder: str
    ) -> None:
        self._api = api
        self._domain_id = domain_id
        self._xml = xml
        self._enclave_folder = enclave_folder
        self._users = 0
        self.is_closing = False
        """True when no participant uses the domain any more; the domain is deleted as soon as no thread writes."""
        self.writing: list[int] = []
        """Ids of the threads that are writing a sample or deleting an endpoint, which use types and memory of the
        domain."""
        self._end_lock = threading.Lock()
        self._has_ended = False
        self.fast_dds = FastDdsInterop(support)
        self.types = Sertypes(api, self.fast_dds.prepare)
        code = api.create_domain(domain_id, xml.encode())
        self._handle = 0 if code == library.PRECONDITION_NOT_MET else code
        if self._handle == 0:  # another user of the same libddsc has created the domain
            get_root_logger().warning(
                f"domain {domain_id} was configured by other code of this process: discovery range, static peers and "
                "CYCLONEDDS_URI have no effect here"
            )
        elif code < 0:  # Cyclone returns "Error" for all causes, and prints details to stderr
            reason = api.strretcode(code).decode()
            raise TransportError(
                f"Cyclone DDS could not configure domain {domain_id}: {reason} ({code}). "
                f"{_diagnose_failure(domain_id, xml)}"
            )

    @classmethod
    def join(
        cls, api: library.CycloneApi, support: FastDdsSupport, domain_id: int, xml: str, enclave_folder: str
    ) -> Domain:
        """Open the domain with the configuration `xml`, unless it is open already, and return it.

        Every `join` needs a `leave`.

        Raises:
            SecurityError: the domain is open with another enclave, or only one of the open domain and this call is
                secured.
            TransportError: the domain is open with another configuration or cannot be configured, or this process was
                forked from one that has a domain open.
        """
        with cls._lock:
            if cls._forked:
                raise TransportError(
                    "this process was forked from one that uses DDS, whose threads do not exist here; start it with "
                    'multiprocessing\'s "spawn" method, or fork before the first node is created'
                )
            domain = cls._open.get(domain_id)
            if domain is None:
                domain = cls._open[domain_id] = cls(api, support, domain_id, xml, enclave_folder)
            elif domain._xml != xml:
                raise TransportError(
                    f"domain {domain_id} is open in this process with another configuration, and DDS has one for each "
                    "domain of a process. Use the same discovery range, static peers and CYCLONEDDS_URI, close the "
                    f"first context, or use another domain. Open: {domain._xml!r}; requested: {xml!r}"
                )
            if domain._enclave_folder != enclave_folder:
                # Cyclone would apply the permissions of the first enclave, refuse an unsecured participant without a
                # reason, or crash when an earlier unsecured one is deleted (docs/internals/dds.md 10).
                folders = domain._enclave_folder, enclave_folder
                used, got = (f"the enclave in {folder}" if folder else "no security" for folder in folders)
                raise SecurityError(
                    f"domain {domain_id} is used by this process with {used}, and Cyclone DDS permits one enclave for "
                    f"each domain of a process; got {got}. Use one enclave, or two processes"
                )
            domain._users += 1
            return domain

    def leave(self) -> None:
        """Undo one call of `join`; the last call waits for other threads that write, and deletes the domain."""
        with Domain._lock:
            self._users -= 1
            if self._users == 0:
                del self._open[self._domain_id]
                self.is_closing = True
                # A write of this thread deletes the domain at its end.
                wait_for_others(self.writing)
                self.end_if_unused()

    def end_if_unused(self) -> None:
        """Delete the domain if no thread writes. Called after the last `leave` and after each later write."""
        with self._end_lock:
            if self.writing or self._has_ended:
                return
            self._has_ended = True
        self.types.close()
        if self._handle:
            self._api.delete(self._handle)
        self.fast_dds.close()

    @classmethod
    def detach_after_fork(cls) -> None:
        """Refuse to use DDS in this forked child if a domain was inherited."""
        cls._lock = threading.Lock()  # another thread of the parent may have held it during the fork
        for domain in cls._open.values():
            # The threads that serve the domain do not exist here. Tried with 11.0.1: a participant of the same domain
            # can be created, discovers no peer, and its deletion never returns. If all contexts were closed before the
            # fork, no domain is open, and DDS works in the child.
            cls._forked = True
            domain._api.disable_deletes()
        cls._open.clear()


def _diagnose_failure(domain_id: int, xml: str) -> str:
    """Return a text with the probable reason why Cyclone cannot configure a domain, and the fix."""
    if not has_free_index(domain_id):
        return (
            f"All {MAX_PARTICIPANT_INDEX} participant indexes of the domain are taken on this machine: end some of its "
            "processes, or use another ROS_DOMAIN_ID"
        )
    uri = os.environ.get("CYCLONEDDS_URI", "")
    if uri:
        return (
            f"CYCLONEDDS_URI is set to {uri!r}: probably its XML is not valid, its file does not exist, or it names "
            "an interface that does not. Cyclone DDS printed the details; correct the variable or unset it"
        )
    return f"Cyclone DDS printed the reason; probably no network interface is usable. The configuration was {xml!r}"


def has_free_index(domain_id: int) -> bool:
    """Return True if this machine has a free participant index in a domain: one of its UDP ports can be bound."""
    # Source: docs/internals/protocol.md 10.6.
    first = _FIRST_PORT + _PORTS_PER_DOMAIN * domain_id + _FIRST_UNICAST_PORT
    for index in range(MAX_PARTICIPANT_INDEX):
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("", first + _PORTS_PER_INDEX * index))
            return True
    return False
