"""Public C functions of Cyclone DDS as Python callables: prototypes, structures and return codes.

This module uses only what the headers of Cyclone promise; `private_layout.py` uses private structures. Handles and
addresses are plain integers.

The Python classes of `cyclonedds` are not used: they do not report which reader triggered a WaitSet, hold the GIL in
write and take, and are never deleted if they are part of a reference cycle (docs/internals/protocol.md 11.4).
"""

from __future__ import annotations

import ctypes as ct
import signal
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.runtime.transport.api import TransportError

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
    "-:pii": "dds_qset_history",
    "-:pi": "dds_qset_durability dds_qset_ignorelocal",
    "-:pliiiii": "dds_qset_durability_service",
    "-:pil": "dds_qset_reliability dds_qset_liveliness",
    "-:pl": "dds_qset_lifespan dds_qset_deadline",
    "-:pb": "dds_qset_writer_data_lifecycle",
    "-:pup": "dds_qset_data_representation",
    "-:pss": "dds_qset_prop",
    "b:ppp": "dds_qget_userdata dds_qget_history dds_qget_reliability dds_qget_liveliness",
    "b:psp": "dds_qget_prop",
    "b:pp": "dds_qget_durability dds_qget_lifespan dds_qget_deadline",
}
"""C functions by signature in letters of `_KINDS`. Calls release the GIL, because a DDS call may block."""
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
