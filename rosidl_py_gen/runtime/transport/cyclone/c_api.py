"""The public C functions of Cyclone DDS as Python callables.

Decides prototypes, public structures and return codes; what they are used for is others' business. This file gets the
library as an argument and knows nothing that its headers do not promise: that is in `structures.py`.

Handles and addresses are plain integers. The Python classes of `cyclonedds` are not used: they hide which reader woke a
WaitSet, hold the GIL in write and take, and are never deleted when part of a reference cycle
(docs/internals/protocol.md 11.4).
"""

from __future__ import annotations

import ctypes as ct
import signal
import struct
import sys
import threading
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.runtime.transport.api import TransportError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_set_handler = import_module("_signal").signal
"""`signal.signal` without its Python wrapper, which looks for an enum member: 7 us, on the way of each reply."""

TIMEOUT = -10
PRECONDITION_NOT_MET = -4
SAMPLE_NOT_CONSUMED = frozenset({-3, -9, -12})
"""What `dds_writecdr` answers when it never came to the writer, and left the reference to the sample with us."""
SAMPLE_WITH_DATA = 2
DCPS_PARTICIPANT, DCPS_PUBLICATION, DCPS_SUBSCRIPTION = 0x7FFF0001, 0x7FFF0003, 0x7FFF0004
"""Pseudo handles of the builtin topics."""


_Lent = TypeVar("_Lent", bound=ct.Structure)
_is_windows = sys.platform == "win32"


class Iov(ct.Structure):
    """ddsrt_iovec_t: where bytes lie, and how many."""

    _fields_ = (
        *((("size", ct.c_uint32),) if _is_windows else ()),
        ("base", ct.c_void_p),
        *(() if _is_windows else (("size", ct.c_size_t),)),
    )


def _windows_iov(address: int, size: int) -> bytes:
    return struct.pack("@IP", size, address)


pack_iov: Callable[[int, int], bytes] = _windows_iov if _is_windows else struct.Struct("@PN").pack
"""One `Iov` as bytes, in a third of the time. Whoever passes it on keeps the bytes that it names."""
address_of = ct.PYFUNCTYPE(ct.c_void_p, ct.py_object)(("PyBytes_AsString", ct.pythonapi))
"""Where the content of a bytes object lies."""


class DdsMatchedStatus(ct.Structure):
    """dds_publication_matched_status_t, and that of subscriptions."""

    _fields_ = (
        *(("total", ct.c_uint32), ("total_change", ct.c_int32)),
        *(("current", ct.c_uint32), ("current_change", ct.c_int32)),
        ("last", ct.c_uint64),
    )


class BuiltinParticipant(ct.Structure):
    """dds_builtintopic_participant_t."""

    _fields_ = (("key", ct.c_ubyte * 16), ("qos", ct.c_void_p))


class BuiltinEndpoint(ct.Structure):
    """dds_builtintopic_endpoint_t."""

    _fields_ = (
        *(("key", ct.c_ubyte * 16), ("participant_key", ct.c_ubyte * 16), ("participant_handle", ct.c_uint64)),
        *(("topic_name", ct.c_char_p), ("type_name", ct.c_char_p), ("qos", ct.c_void_p)),
    )


def cast_loan(address: int, kind: type[_Lent]) -> _Lent:
    """What a reader of a builtin topic has lent, or a writer or reader was asked for."""
    return ct.cast(address, ct.POINTER(kind)).contents


class TopicDescriptor(ct.Structure):
    """dds_topic_descriptor_t, from 0.10 on."""

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
    "b:ppp": "dds_qget_userdata dds_qget_history dds_qget_reliability dds_qget_liveliness",
    "b:psp": "dds_qget_prop",
    "b:pp": "dds_qget_durability dds_qget_lifespan dds_qget_deadline",
}
"""By result and arguments. They let go of the GIL, because a DDS call may block."""
_SHORT = {
    "p:pizpz": "ddsi_serdata_from_ser_iov",
    "p:pzzp": "ddsi_serdata_to_ser_ref",
    "-:p": "ddsi_serdata_unref",
    "-:pp": "ddsi_serdata_to_ser_unref",
    "u:p": "ddsi_serdata_size",
    "-:pzzp": "ddsi_serdata_to_ser",
}
"""Of samples. They keep the GIL, which is dearer to get back than what they do, and wait for nobody."""
_BARE = ("dds_takecdr",)
_OTHERS = ("ddsi_sertype_v0", "ddsi_serdata_from_ser", "ddsi_sertype_derive_sertype")
_OPTIONAL = {"i:ip": "dds_get_entity_sertype", "-:pup": "dds_qset_psmx_instances"}
"""Which 0.10 does not have."""
OLDEST = "0.10"
"""The first version that has all of the following."""
NEEDED = (*" ".join([*_FUNCTIONS.values(), *_SHORT.values()]).split(), *_BARE, *_OTHERS)


def _function(library: ct.CDLL, name: str, text: str, make: Any = ct.CFUNCTYPE) -> Any:
    result, arguments = text.split(":")
    return make(_KINDS[result], *(_KINDS[kind] for kind in arguments))((name, library))


class CycloneApi:
    """The functions as attributes, without their ``dds_`` or ``ddsi_`` prefix; optional ones are None where missing."""

    def __init__(self, library: ct.CDLL) -> None:
        self.library = library
        # The calls of every message, without argument converters, which would be half of what a call costs.
        # Nothing checks what is passed: C ints as Python ints, everything else as a ctypes object of the right type.
        self.bare_write: Callable[..., int] = library["dds_writecdr"]
        self.bare_take: Callable[..., int] = library["dds_takecdr"]
        self.bare_matched: Callable[..., int] = library["dds_get_publication_matched_status"]
        self.bare_copy: Callable[..., int | None] = _function(library, "ddsi_serdata_from_ser_iov", "p:", ct.PYFUNCTYPE)
        for table, make in ((_FUNCTIONS, ct.CFUNCTYPE), (_SHORT, ct.PYFUNCTYPE), (_OPTIONAL, ct.CFUNCTYPE)):
            for text, names in table.items():
                for name in names.split():
                    is_there = table is not _OPTIONAL or hasattr(library, name)
                    function = _function(library, name, text, make) if is_there else None
                    setattr(self, name.removeprefix("dds_").removeprefix("ddsi_"), function)
        self.copy_large = _function(library, "ddsi_serdata_from_ser_iov", "p:pizpz")
        self.drop_large = _function(library, "ddsi_serdata_unref", "-:p")
        self.sertype_version: int = ct.cast(library["ddsi_sertype_v0"], ct.c_void_p).value or 0
        """What stands first in the function table of a type object."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Callable[..., Any]: ...

    def guid_of(self, entity: int) -> bytes:
        """The entity's GUID in network order."""
        buffer = ct.create_string_buffer(16)
        self.check(self.get_guid(entity, buffer), "read a GUID")
        return buffer.raw

    @contextmanager
    def locked_entity(self, entity: int) -> Iterator[int]:
        """The address of an entity, which stays there for as long."""
        found = ct.c_void_p()
        self.check(self.entity_pin(entity, ct.byref(found)), "look at an entity")
        try:
            yield found.value or 0
        finally:
            self.entity_unpin(found)

    def counts(self, entity: int, status: str, number: int) -> tuple[int, ...]:
        """The first counts of a status, such as ``sample_lost``: all of them begin with 32 bit numbers."""
        found = (ct.c_uint32 * 8)()
        self.check(getattr(self, f"get_{status}_status")(entity, found), f"read the status {status}")
        return tuple(found[:number])

    def disable_deletes(self) -> None:
        """In a forked child: deleting an inherited entity would wait for threads that are not there."""
        vars(self)["delete"] = lambda entity: 0

    def check(self, code: int, doing: str) -> int:
        """Pass a handle or a count through; raise `TransportError` for a negative code."""
        if code < 0:
            reason = self.strretcode(code)
            raise TransportError(f"Cyclone DDS could not {doing}: {reason.decode()} ({code})")
        return code


def call_with_sigint_deferred(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call into Cyclone, from where it may call functions of ours, and let Ctrl-C wait until it is back.

    Python runs signal handlers in the main thread, in whatever Python function is next. One that raises in a function
    that C has called leaves C with a result that nobody made.
    """
    if threading.current_thread() is not threading.main_thread():
        return function(*arguments)
    noted: list[int] = []
    before = _set_handler(signal.SIGINT, lambda number, _: noted.append(number))
    try:
        return function(*arguments)
    finally:
        _set_handler(signal.SIGINT, signal.SIG_DFL if before is None else before)
        for number in noted[:1]:
            signal.raise_signal(number)
