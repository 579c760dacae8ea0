"""C library of Cyclone DDS, libddsc: its public functions, its configuration, the search for it, and what to install.

`CycloneApi` has the public C functions as Python callables, with prototypes, structures and return codes. This module
uses only what the headers of Cyclone promise; `private_layout.py` uses private structures. Handles and addresses are
plain integers. The Python classes of `cyclonedds` are not used: they do not report which reader triggered a WaitSet,
hold the GIL in write and take, and are never deleted if they are part of a reference cycle
(docs/internals/protocol.md 11.4).

`cyclone_xml` makes the configuration as XML text from the settings of a context.

`find_library` uses and loads once the first candidate that loads and has all of `REQUIRED_SYMBOLS`. If the process
loads another libddsc, each library has its own symbols; participants of the two libraries do not discover each other in
the process.

Source: docs/internals/dds.md 7, docs/internals/protocol.md 10.6, 11.6.
"""

from __future__ import annotations

import ctypes as ct
import ctypes.util
import os
import platform
import re
import signal
import struct
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.runtime.transport.api import BackendMissingError, DiscoveryRange, DomainSettings, TransportError
from rosidl_py_gen.runtime.transport.qos import DDS_POLICIES, Policy

_set_handler = import_module("_signal").signal
"""Function that sets a signal handler: `signal.signal` without its Python wrapper, which would cost 7 us for each
reply."""

TIMEOUT = -10
PRECONDITION_NOT_MET = -4
NOT_ALLOWED_BY_SECURITY = -13
SAMPLE_NOT_CONSUMED = frozenset({-3, -9, -12})
"""Return codes of `dds_writecdr` after which the caller still owns its reference to the sample and must release it."""
SAMPLE_WITH_DATA = 2
DCPS_PARTICIPANT = 0x7FFF0001
"""Fixed handle with which a reader of the builtin topic of participants is created; DCPS_PUBLICATION and
DCPS_SUBSCRIPTION are for endpoints."""
DCPS_PUBLICATION = 0x7FFF0003
DCPS_SUBSCRIPTION = 0x7FFF0004

_Loan = TypeVar("_Loan", bound=ct.Structure)
_is_windows = sys.platform == "win32"


class Iov(ct.Structure):
    """C structure ddsrt_iovec_t: address and size of a memory block."""

    _fields_ = (
        *((("size", ct.c_uint32),) if _is_windows else ()),
        ("base", ct.c_void_p),
        *(() if _is_windows else (("size", ct.c_size_t),)),
    )


def _windows_iov(address: int, size: int) -> bytes:
    return struct.pack("@IP", size, address)


pack_iov: Callable[[int, int], bytes] = _windows_iov if _is_windows else struct.Struct("@PN").pack
"""Return the bytes of an `Iov` with an address and a size, in a third of the time of its class.

The caller must keep the memory block alive.
"""
address_of = ct.PYFUNCTYPE(ct.c_void_p, ct.py_object)(("PyBytes_AsString", ct.pythonapi))
"""Return the address of the content of a bytes object, which the caller must keep alive."""


class DdsMatchedStatus(ct.Structure):
    """C structures dds_publication_matched_status_t and dds_subscription_matched_status_t; both have this layout."""

    _fields_ = (
        *(("total", ct.c_uint32), ("total_change", ct.c_int32)),
        *(("current", ct.c_uint32), ("current_change", ct.c_int32)),
        ("last", ct.c_uint64),
    )


class BuiltinParticipant(ct.Structure):
    """C structure dds_builtintopic_participant_t: a discovered participant."""

    _fields_ = (("key", ct.c_ubyte * 16), ("qos", ct.c_void_p))


class BuiltinEndpoint(ct.Structure):
    """C structure dds_builtintopic_endpoint_t: a discovered writer or reader."""

    _fields_ = (
        *(("key", ct.c_ubyte * 16), ("participant_key", ct.c_ubyte * 16), ("participant_handle", ct.c_uint64)),
        *(("topic_name", ct.c_char_p), ("type_name", ct.c_char_p), ("qos", ct.c_void_p)),
    )


def cast_loan(address: int, kind: type[_Loan]) -> _Loan:
    """Return the structure of type `kind` at an address that Cyclone returned."""
    return ct.cast(address, ct.POINTER(kind)).contents


class TopicDescriptor(ct.Structure):
    """C structure dds_topic_descriptor_t of Cyclone 0.10 and later."""

    _fields_ = (
        *((name, ct.c_uint32) for name in ("size", "align", "flags", "key_count")),
        *(("type_name", ct.c_char_p), ("keys", ct.c_void_p), ("op_count", ct.c_uint32), ("ops", ct.c_void_p)),
        *(("meta", ct.c_char_p), ("type_information", ct.c_void_p), ("type_information_size", ct.c_uint32)),
        *(("type_mapping", ct.c_void_p), ("type_mapping_size", ct.c_uint32), ("representations", ct.c_uint32)),
    )


_KINDS = dict(
    zip(
        "-iulhbpzs",
        (None, ct.c_int32, ct.c_uint32, ct.c_int64, ct.c_uint64, ct.c_bool, ct.c_void_p, ct.c_size_t, ct.c_char_p),
        strict=True,
    )
)
"""C types by letter of a function signature: `i:up` takes a uint32 and a pointer and returns an int32."""
_FUNCTIONS = {
    "i:us": "dds_create_domain",
    "i:upp": "dds_create_participant",
    "i:ipp": "dds_create_publisher dds_create_subscriber",
    "i:ipspp": "dds_create_topic",
    "i:ispppp": "dds_create_topic_sertype",
    "i:iipp": "dds_create_reader dds_create_writer",
    "p:p": "dds_create_listener ddsi_sertype_ref",
    "-:p": "dds_delete_listener dds_free dds_builtintopic_free_endpoint dds_entity_unpin dds_delete_qos"
    " ddsi_sertype_unref",
    "-:pp": "dds_copy_listener",
    "i:i": "dds_delete dds_assert_liveliness",
    "i:ip": "dds_writecdr dds_set_listener dds_get_guid dds_get_instance_handle dds_entity_pin"
    " dds_get_requested_deadline_missed_status dds_get_offered_deadline_missed_status"
    " dds_get_liveliness_changed_status dds_get_liveliness_lost_status dds_get_sample_lost_status"
    " dds_get_publication_matched_status dds_get_subscription_matched_status",
    "i:pppb": "dds_lset_data_available_arg dds_lset_subscription_matched_arg",
    "i:ippzu": "dds_take",
    "i:ippzuu": "dds_read_mask",
    "i:ipi": "dds_return_loan",
    "i:il": "dds_wait_for_acks",
    "i:ipz": "dds_get_matched_subscriptions dds_get_matched_publications",
    "p:ih": "dds_get_matched_subscription_data dds_get_matched_publication_data",
    "s:i": "dds_strretcode",
    "p:": "dds_create_qos",
    "-:psz": "dds_qset_userdata",
    "-:pi": "dds_qset_ignorelocal",
    "-:pliiiii": "dds_qset_durability_service",
    "-:pb": "dds_qset_writer_data_lifecycle",
    "-:pup": "dds_qset_data_representation",
    "-:pss": "dds_qset_prop",
    "b:ppp": "dds_qget_userdata",
    "b:psp": "dds_qget_prop",
}
"""C functions by signature in letters of `_KINDS`. Calls release the GIL, because a DDS call may block."""


def qos_letter(policy: Policy) -> str:
    """Return the letter of `_KINDS` for the value of a QoS policy in a QoS object."""
    return "l" if policy.is_period else "b" if policy.is_flag else "i"


MORE_QOS_VALUES = {"reliability": 0}
"""Values in nanoseconds of policies of DDS that are not policies of ROS: the maximum blocking time of a write.

It is 0, because the event loop must not block; `Publisher` waits instead. rmw_cyclonedds has infinity; the value does
not influence matching (docs/internals/protocol.md 7.3).
"""
for _name, _policies in DDS_POLICIES.items():
    _letters = "".join(map(qos_letter, _policies)) + ("l" if _name in MORE_QOS_VALUES else "")
    for _text, _function_name in (
        (f"-:p{_letters}", f"dds_qset_{_name}"),
        (f"b:p{'p' * len(_letters)}", f"dds_qget_{_name}"),
    ):
        _FUNCTIONS[_text] = f"{_FUNCTIONS.get(_text, '')} {_function_name}"
_WITH_GIL = {
    "p:pizpz": "ddsi_serdata_from_ser_iov",
    "p:pzzp": "ddsi_serdata_to_ser_ref",
    "-:p": "ddsi_serdata_unref",
    "-:pp": "ddsi_serdata_to_ser_unref",
    "u:p": "ddsi_serdata_size",
    "-:pzzp": "ddsi_serdata_to_ser",
}
"""C functions for samples by signature. Calls hold the GIL: they never block, and acquiring the GIL again would cost
more than the call."""
_WITHOUT_CONVERSION = ("dds_takecdr",)
_SYMBOLS = ("ddsi_sertype_v0", "ddsi_serdata_from_ser", "ddsi_sertype_derive_sertype")
_OPTIONAL = {"i:ip": "dds_get_entity_sertype", "-:pup": "dds_qset_psmx_instances", "-:pp": "dds_set_log_sink"}
"""C functions that not every version of Cyclone has: version 0.10 lacks the first two, version 11.0 the last."""
MIN_VERSION = "0.10"
"""First version of Cyclone DDS that has all of `REQUIRED_SYMBOLS`."""
REQUIRED_SYMBOLS = (*" ".join([*_FUNCTIONS.values(), *_WITH_GIL.values()]).split(), *_WITHOUT_CONVERSION, *_SYMBOLS)


def _function(library: ct.CDLL, name: str, text: str, make: Any = ct.CFUNCTYPE) -> Any:
    result, arguments = text.split(":")
    return make(_KINDS[result], *(_KINDS[kind] for kind in arguments))((name, library))


class CycloneApi:
    """C functions of libddsc as attributes without prefix ``dds_`` or ``ddsi_``; a missing optional one is None."""

    def __init__(self, library: ct.CDLL) -> None:
        self.library = library
        # Functions of every message have no argument converters, which are half of the cost of a call. Nothing checks
        # the arguments: C ints must be Python ints, everything else a ctypes object of the right type.
        self.bare_write: Callable[..., int] = library["dds_writecdr"]
        self.bare_take: Callable[..., int] = library["dds_takecdr"]
        self.bare_matched: Callable[..., int] = library["dds_get_publication_matched_status"]
        self.bare_copy: Callable[..., int | None] = _function(library, "ddsi_serdata_from_ser_iov", "p:", ct.PYFUNCTYPE)
        for table, make in ((_FUNCTIONS, ct.CFUNCTYPE), (_WITH_GIL, ct.PYFUNCTYPE), (_OPTIONAL, ct.CFUNCTYPE)):
            for text, names in table.items():
                for name in names.split():
                    is_missing = table is _OPTIONAL and not hasattr(library, name)
                    function = None if is_missing else _function(library, name, text, make)
                    setattr(self, name.removeprefix("dds_").removeprefix("ddsi_"), function)
        self.copy_large = _function(library, "ddsi_serdata_from_ser_iov", "p:pizpz")
        self.drop_large = _function(library, "ddsi_serdata_unref", "-:p")
        self.sertype_version: int = ct.cast(library["ddsi_sertype_v0"], ct.c_void_p).value or 0
        """Number that is the first entry of the function table of every sertype, Cyclone's object for a type."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Callable[..., Any]: ...

    def guid_of(self, entity: int) -> bytes:
        """Return the GUID of an entity in network order."""
        buffer = ct.create_string_buffer(16)
        self.check(self.get_guid(entity, buffer), "read a GUID")
        return buffer.raw

    @contextmanager
    def locked_entity(self, entity: int) -> Iterator[int]:
        """Yield the address of the structure of an entity, which cannot be deleted inside the block."""
        address = ct.c_void_p()
        self.check(self.entity_pin(entity, ct.byref(address)), "lock an entity")
        try:
            yield address.value or 0
        finally:
            self.entity_unpin(address)

    def counts(self, entity: int, status: str, number: int) -> tuple[int, ...]:
        """Return the first `number` counters of a DDS status of an entity, such as ``sample_lost``.

        All statuses begin with 32 bit numbers.
        """
        numbers = (ct.c_uint32 * 8)()
        self.check(getattr(self, f"get_{status}_status")(entity, numbers), f"read the status {status}")
        return tuple(numbers[:number])

    def disable_deletes(self) -> None:
        """Make `delete` do nothing: in a forked child it would wait for threads that do not exist there."""
        vars(self)["delete"] = lambda entity: 0

    def check(self, code: int, activity: str) -> int:
        """Return `code`, the result of a call of Cyclone, if it is a handle or count.

        Raises:
            TransportError: the code is negative; the text says that Cyclone could not do `activity`, and why.
        """
        if code < 0:
            reason = self.strretcode(code)
            raise TransportError(f"Cyclone DDS could not {activity}: {reason.decode()} ({code})")
        return code


def call_with_sigint_deferred(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of Cyclone that may call Python functions, and delay the handling of SIGINT until it has
    returned.

    Python runs signal handlers in the main thread, in the next Python function. If a handler raises in a function that
    C has called, C gets an undefined result.
    """
    if threading.current_thread() is not threading.main_thread():
        return function(*arguments)
    received: list[int] = []
    previous = _set_handler(signal.SIGINT, lambda number, _: received.append(number))
    try:
        return function(*arguments)
    finally:
        _set_handler(signal.SIGINT, signal.SIG_DFL if previous is None else previous)
        for number in received[:1]:
            signal.raise_signal(number)


# -------------------------------------------------------------------------------------------------------- configuration

MAX_PARTICIPANT_INDEX = 32
IGNORE_TYPE_INFORMATION = "IgnoreTypeInformation"
"""Name of a configuration element that Cyclone has from 11 on."""
OPTIONAL_ELEMENTS = frozenset(
    {"SocketReceiveBufferSize", "HeartbeatInterval", "NackDelay", IGNORE_TYPE_INFORMATION, "SPDPInterval"}
    | {"InitialLocatorPruneDelay", "SharedMemory"}
)
"""Configuration elements that are omitted if the loaded library does not know them.

Cyclone 0.10 lacks two; a build without iceoryx lacks ``SharedMemory``.
"""
DEFAULT_CONFIG = (
    '<Internal><SocketReceiveBufferSize max="32MiB"/><HeartbeatInterval>20ms</HeartbeatInterval>'
    "<NackDelay>20ms</NackDelay></Internal><Compatibility><IgnoreTypeInformation>"
    f"{','.join(f'1.{vendor}' for vendor in range(2, 33))}</IgnoreTypeInformation></Compatibility>"
)
"""Configuration, as XML inside ``<Domain>``, of every domain; elements of the user's CYCLONEDDS_URI override it.

- Receive buffer: the kernel grants at most net.core.rmem_max. With Cyclone's default of 1 MiB a fifth of 6 MB images
  was lost on loopback, with 4 MiB none.
- Heartbeat interval and NACK delay 20 ms (Cyclone's default: 100 ms): with 10 % packet loss, messages of 200 kB take
  1.5 ms instead of 200 ms (median). The same holds for a first request that is sent before the client is discovered.
  Unanswered heartbeats become rare as with the default.
- Type information of peers of all vendors is ignored, because endpoints of this package have no type information to
  compare it with. Cyclone considers definitions of arrays and sequences of Kilted's Fast DDS invalid when it receives a
  peer's request for them, and then ignores all endpoints of these types.
"""
_LOOPBACK_HOSTS = frozenset({"localhost", "127.0.0.1", "::1"})
_LOOPBACK_INTERFACE = '<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>'


def cyclone_xml(
    settings: DomainSettings, *, process_id: int, extra: str = "", last: str = "", unsupported: Collection[str] = ()
) -> str:
    """Return the configuration of a domain: this package's XML, then CYCLONEDDS_URI, whose elements override it.

    The result may be empty. `extra` and `last` are XML inside ``<Domain>`` before and after the user's XML.
    `unsupported` are the members of `OPTIONAL_ELEMENTS` to omit. In localhost and off mode multicast is disabled again
    at the end, so that a CYCLONEDDS_URI that was written for another mode cannot enable it.
    """
    fragments = []
    body = _domain_elements(settings, process_id, IGNORE_TYPE_INFORMATION not in unsupported) + extra
    # One element that the loaded library does not know makes the creation of the domain fail (docs/internals/dds.md 8).
    for name in unsupported:
        element = rf"<{name}\b[^>]*(/>|>.*?</{name}>)"
        body, last = re.sub(element, "", body), re.sub(element, "", last)
    if body:
        fragments.append(f'<CycloneDDS><Domain Id="any">{body}</Domain></CycloneDDS>')
    if settings.cyclonedds_uri:
        fragments.append(settings.cyclonedds_uri)
        if settings.discovery_range in (DiscoveryRange.LOCALHOST, DiscoveryRange.OFF):
            last = _general("") + last
        if last:
            fragments.append(f'<CycloneDDS><Domain Id="any">{last}</Domain></CycloneDDS>')
    return ",".join(fragments)


def _domain_elements(settings: DomainSettings, process_id: int, can_bind: bool) -> str:
    stays_on_host = "NetworkInterface" not in settings.cyclonedds_uri and _LOOPBACK_HOSTS.issuperset(
        settings.static_peers
    )
    match settings.discovery_range:
        case DiscoveryRange.SYSTEM_DEFAULT:
            return ""
        case DiscoveryRange.SUBNET:
            return _discovery(settings.static_peers)
        case DiscoveryRange.LOCALHOST:
            # Without multicast, discovery does not leave the host, but data may still go to an address that a peer
            # announces. A socket that is bound to 127.0.0.1 cannot send through another interface; rmw_cyclonedds of
            # Jazzy does not bind. ROS peers in LOCALHOST range bind to the first real interface, but are discovered:
            # their discovery packets go to `localhost`, Cyclone 11 replies through the interface of a packet, and
            # accepts loopback locators of a peer that announces no others.
            # Not with a static peer on another host or interfaces in CYCLONEDDS_URI, and not before Cyclone 11, which
            # replies through another interface and would not discover Fast DDS peers (docs/internals/dds.md 8).
            interfaces = _LOOPBACK_INTERFACE if stays_on_host and can_bind else ""
            return _general(interfaces) + _discovery(("localhost", *settings.static_peers))
        case DiscoveryRange.OFF:
            tag = f"ros_discovery_off_{process_id}"
            discovery = f"<Discovery><ParticipantIndex>none</ParticipantIndex><Tag>{tag}</Tag></Discovery>"
            return _general(_LOOPBACK_INTERFACE if stays_on_host else "") + discovery


def _general(interfaces: str) -> str:
    return f"<General>{interfaces}<AllowMulticast>false</AllowMulticast></General>"


def _attribute(text: str) -> str:
    # `xml.sax.saxutils.quoteattr` would import a web client.
    for char, entity in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ('"', "&quot;")):
        text = text.replace(char, entity)
    return f'"{text}"'


def _discovery(peers: tuple[str, ...]) -> str:
    """Return the ``<Discovery>`` element with the values that ROS peers expect, and with static `peers`.

    Cyclone 11 has other defaults than the Cyclone 0.10 of ROS.

    Cyclone announces a participant every 8 s to known participants, but to listed addresses without a known participant
    only once, at the start; after 30 s it removes them. A peer may start later and announce itself only by multicast,
    which is not received in localhost mode, and an announcement may be lost. So the interval is 3 s, as in Fast DDS.
    """
    elements = "".join(f"<Peer address={_attribute(peer)}/>" for peer in peers)
    return (
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{MAX_PARTICIPANT_INDEX}</MaxAutoParticipantIndex>"
        "<SPDPInterval>3s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
        f"{f'<Peers>{elements}</Peers>' if elements else ''}</Discovery>"
    )


# --------------------------------------------------------------------------------------------------------------- search

LIBRARY_VARIABLE = "ROSIDL_LIBDDSC"
_PATTERN = {"win32": "ddsc*.dll", "darwin": "libddsc*.dylib"}.get(sys.platform, "libddsc*.so*")
_NAMES = {"win32": ("ddsc.dll",), "darwin": ("libddsc.dylib",)}.get(
    sys.platform, ("libddsc.so.11", "libddsc.so.0", "libddsc.so.0debian", "libddsc.so")
)
"""Names of libddsc for the system's loader. The plain name exists only with the headers; Debian's has a suffix."""
_WHEELS = {
    "rosidl_libddsc": ("lib",),
    "cyclonedds": (".dylibs", "../cyclonedds.libs", "../cyclonedds_nightly.libs"),
}
"""Python packages that contain libddsc, and the folder of libddsc in each. cyclonedds has another copy, for compilers.
"""
LIBRARY_COMMAND = "rosidl-py-gen libddsc"
"""Command that installs libddsc from a wheel for another Python version."""
_DEBIAN = "apt install libddsc0debian (Debian from 12, Ubuntu from 24.04, Raspberry Pi OS)"
_SECURITY_SYMBOL = "DDS_Security_Exception_set"
"""Function of libddsc that exists only in builds with DDS Security."""


@dataclass(frozen=True, slots=True)
class LibraryWheel:
    """Wheel of cyclonedds on the package index that contains libddsc for a platform.

    The library works with every Python version, also with others than the version that the wheel is for.
    """

    platform: str
    """Platform tag in the file name of the wheel."""
    sha256: str
    """SHA-256 of the wheel, hexadecimal."""
    member: str
    """Path of libddsc in the wheel."""
    library: str
    """File name of libddsc after it was installed.

    On Windows the name has a version: code that loads ``ddsc.dll`` by name would get the library of this process.
    """

    VERSION: ClassVar[str] = "11.0.1"
    PYTHON: ClassVar[str] = "3.13"

    @property
    def abi(self) -> str:
        """ABI tag of the wheel for pip.

        Without it, pip would select wheels for free-threaded Python when it runs on such a Python.
        """
        return f"cp{self.PYTHON.replace('.', '')}"

    @property
    def file(self) -> str:
        """File name of the wheel."""
        return f"cyclonedds-{self.VERSION}-{self.abi}-{self.abi}-{self.platform}.whl"


_LINUX_LIBRARY, _MAC_LIBRARY = "libddsc-ad12c33a.so.11.0.1", "libddsc.11.0.1.dylib"
_LIBRARY_WHEELS = {
    ("linux", "x86_64"): LibraryWheel(
        "manylinux_2_17_x86_64.manylinux2014_x86_64",
        "fef1f6ce115a579e322f3156842e8b660883e4e8b0aa2f5e2a3df9d7959d1736",
        f"cyclonedds.libs/{_LINUX_LIBRARY}",
        _LINUX_LIBRARY,
    ),
    ("darwin", "arm64"): LibraryWheel(
        "macosx_11_0_arm64",
        "c3b899649685fd2606ea65620ea173b28d61e775adf8785861460ff91efbbbb8",
        f"cyclonedds/.dylibs/{_MAC_LIBRARY}",
        _MAC_LIBRARY,
    ),
    ("darwin", "x86_64"): LibraryWheel(
        "macosx_10_13_x86_64",
        "20b5f2b4c1e42bf3d217f45ba3664dc21a16b74803b8b457e91ea187b11fc7bd",
        f"cyclonedds/.dylibs/{_MAC_LIBRARY}",
        _MAC_LIBRARY,
    ),
    ("win32", "AMD64"): LibraryWheel(
        "win_amd64",
        "850d6624dad8c9f3e0e65423225bd8e4c14c85c2d53bd64e16c2569ea3b491db",
        "cyclonedds.libs/ddsc.dll",
        "ddsc-11.0.1.dll",
    ),
}
"""Wheels that contain libddsc by `sys.platform` and `platform.machine()`; pyproject.toml has the same platforms."""


@dataclass(frozen=True)
class DdscLibrary:
    """Loaded libddsc with all required symbols."""

    handle: ct.CDLL
    file: str
    """Real path of the library; the name that was loaded if the system does not report the path."""

    @property
    def version(self) -> str:
        """Version of Cyclone DDS from the file name, for people; no code depends on it."""
        match = re.search(r"(\d+\.\d+[\w.]*?)(\.dylib)?$", Path(self.file).name)
        return match[1] if match else "of unknown version"

    def __str__(self) -> str:
        return f"Cyclone DDS {self.version}, {self.file}"

    @property
    def has_security(self) -> bool:
        """True if the library was built with DDS Security."""
        return hasattr(self.handle, _SECURITY_SYMBOL)

    @cached_property
    def unsupported_elements(self) -> frozenset[str]:
        """Members of `OPTIONAL_ELEMENTS` that the library does not know.

        A configuration with one of them makes the creation of a domain fail.
        """
        missing, last = OPTIONAL_ELEMENTS, b""
        try:
            with open(self.file, "rb") as file:
                while missing and (block := file.read(1 << 20)):  # the whole file would take 8 ms
                    content = last + block
                    missing = frozenset(name for name in missing if name.encode() + b"\0" not in content)
                    last = block[-100:]  # a name may be in two blocks
        except OSError:
            return OPTIONAL_ELEMENTS
        return missing


def find_library() -> DdscLibrary:
    """Return the libddsc of this process; the first call searches and loads it.

    Raises:
        BackendMissingError: no usable libddsc was found; the text contains what was tried, and what to install.
    """
    library = _load_cached()
    if isinstance(library, str):
        raise BackendMissingError(library, name="cyclonedds")
    return library


def is_found() -> bool:
    """Return True if a usable libddsc was found; the first call searches and loads it."""
    return isinstance(_load_cached(), DdscLibrary)


@cache
def _load_cached() -> DdscLibrary | str:
    return load(os.environ)


def load(environ: Mapping[str, str]) -> DdscLibrary | str:
    """Load and return the first usable libddsc, or return the text of an error if none is usable.

    With ROS_SECURITY_ENABLE=true, a library with security is preferred.
    """
    tried, without_security = [], None
    for name in candidates(environ):
        try:
            library = ct.CDLL(name)
        except OSError as error:
            # Most candidates do not exist, and the loader has several texts for that.
            tried.append(f"{name}: {error}" if os.path.exists(name) else f"{name}: not found")
            continue
        missing = [symbol for symbol in REQUIRED_SYMBOLS if not hasattr(library, symbol)]
        if not missing:
            found = DdscLibrary(library, file_of(library, name))
            if found.has_security or environ.get("ROS_SECURITY_ENABLE") != "true":
                return found
            without_security = without_security or found
            continue
        reason = f"it lacks {missing[0]}, which Cyclone DDS has from {MIN_VERSION} on"
        tried.append(f"{name}: {'it is not a libddsc' if 'dds_create_participant' in missing else reason}")
    if without_security is not None:
        return without_security
    is_set = environ.get(LIBRARY_VARIABLE)
    only = f" {LIBRARY_VARIABLE} is set, so nothing else was tried." if is_set else ""
    fix = f"Correct {LIBRARY_VARIABLE}, or unset it" if is_set else f"To install it: {install_advice()}"
    return (
        f"DDS needs the C library of Cyclone DDS, libddsc, and none was found.{only} MemoryTransport works without it. "
        f"Tried: {'; '.join(tried)}. {fix}"
    )


def candidates(environ: Mapping[str, str]) -> Iterator[str]:
    """Yield paths of libddsc, and names for the system's loader, in the order in which they are tried."""
    if environ.get(LIBRARY_VARIABLE):
        yield environ[LIBRARY_VARIABLE]
        return
    for package, folders in _WHEELS.items():
        spec = find_spec(package)
        for path in (spec.submodule_search_locations or ()) if spec else ():
            yield from chain(*(_files(Path(path), folder) for folder in folders))
    installed = filter(None, environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    for prefix in chain(map(Path, installed), sorted(Path("/opt/ros").glob("*"))):
        yield from chain(*(_files(prefix, folder) for folder in ("lib", "lib/*", "bin")))
    yield from _NAMES
    if found := ctypes.util.find_library("ddsc"):  # slow: runs ldconfig or a compiler
        yield found


def _files(below: Path, folder: str) -> list[str]:
    return sorted(os.path.normpath(file) for file in below.glob(f"{folder}/{_PATTERN}"))


def file_of(library: ct.CDLL, name: str) -> str:
    """Return the real path of a loaded libddsc, or of the libddsc that a loaded library is linked to.

    Returns:
        `name` if the system does not report the path.
    """
    try:
        dladdr = ct.CDLL(None).dladdr
    except (AttributeError, OSError, TypeError):  # Windows
        return name
    info = (ct.c_char_p * 4)()  # Dl_info, which begins with the name of the file
    is_known = dladdr(ct.cast(library["dds_create_participant"], ct.c_void_p), info)
    return os.path.realpath(os.fsdecode(info[0])) if is_known and info[0] else name


def library_wheel() -> LibraryWheel | None:
    """Return the wheel that contains libddsc for this platform; None if there is no such wheel."""
    if sys.platform == "linux" and not _has_glibc():
        return None
    return _LIBRARY_WHEELS.get((sys.platform, platform.machine()))


def has_wheel() -> bool:
    """Return True if cyclonedds has a wheel for this Python and platform; pyproject.toml has the same markers."""
    is_supported = sys.version_info < (3, 14) and sys.implementation.name == "cpython"
    return is_supported and has_gil_build() and library_wheel() is not None


def _has_glibc() -> bool:
    """Return True if Linux uses glibc, which the wheels need, and not musl."""
    try:
        return (os.confstr("CS_GNU_LIBC_VERSION") or "").startswith("glibc")
    except (OSError, ValueError):
        return False


def has_gil_build() -> bool:
    """Return True unless this is a free-threaded Python, which has wheels of its own kind."""
    import sysconfig

    return not sysconfig.get_config_var("Py_GIL_DISABLED")


def security_advice() -> str:
    """Return advice for people on how to get a libddsc with DDS Security on this system."""
    if sys.platform == "linux":
        return (
            f"use a libddsc with security: {_DEBIAN}, then {LIBRARY_VARIABLE}=libddsc.so.0debian; or source a ROS "
            f"installation with rmw_cyclonedds; or name another one in {LIBRARY_VARIABLE}"
        )
    return f"build Cyclone DDS with OpenSSL (ENABLE_SECURITY), and name its library in {LIBRARY_VARIABLE}"


def install_advice() -> str:
    """Return the command that installs libddsc, or other advice for people on this system."""
    if has_wheel():
        return Extra("node").install_command()
    if library_wheel() is not None:
        return LIBRARY_COMMAND
    name_one = f"name a libddsc in {LIBRARY_VARIABLE}"
    if sys.platform != "linux":
        return f"build Cyclone DDS for this platform, which has no wheel of it, and {name_one}"
    if not _has_glibc():
        return f"build Cyclone DDS for this system, which does not use glibc, and {name_one}"
    return f"{_DEBIAN}, or source a ROS installation with rmw_cyclonedds, or {name_one}"
