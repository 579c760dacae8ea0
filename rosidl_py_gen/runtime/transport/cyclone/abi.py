"""Cyclone's C functions as typed Python callables.

Decides prototypes, structures and return codes; what they are used for is `participant.py`'s business. This file gets
the library handle as an argument and imports nothing of `cyclonedds`, whose Python entity classes we do not use: they
hide which reader woke a WaitSet, hold the GIL in write and take, cost a dataclass per sample, and are never deleted
when part of a reference cycle (docs/internals/protocol.md 11.4). Plain handles have none of these troubles.

Every function releases the GIL for its duration (ctypes.CFUNCTYPE), so that a DDS call may block.
"""

from __future__ import annotations

import ctypes as ct
import signal
import threading
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.transport.port import TransportError

if TYPE_CHECKING:
    from collections.abc import Callable

_set_handler = import_module("_signal").signal
"""`signal.signal` without its Python wrapper, which looks for an enum member: 7 us, on the way of each reply."""

TIMEOUT = -10
PRECONDITION_NOT_MET = -4
INFINITE = 2**63 - 1

DCPS_PARTICIPANT = 0x7FFF0001
DCPS_PUBLICATION = 0x7FFF0003
DCPS_SUBSCRIPTION = 0x7FFF0004
"""Pseudo handles of the builtin topics."""


class Container(ct.Structure):
    """A sample of the Python sertype: a pointer to the serialized bytes, header included, and their number."""

    _fields_ = (("data", ct.c_char_p), ("size", ct.c_size_t))


class MatchedStatus(ct.Structure):
    """dds_publication_matched_status_t, and that of subscriptions."""

    _fields_ = (
        ("total", ct.c_uint32),
        ("total_change", ct.c_int32),
        ("current", ct.c_uint32),
        ("current_change", ct.c_int32),
        ("last", ct.c_uint64),
    )


class BuiltinParticipant(ct.Structure):
    """dds_builtintopic_participant_t."""

    _fields_ = (("key", ct.c_ubyte * 16), ("qos", ct.c_void_p))


class BuiltinEndpoint(ct.Structure):
    """dds_builtintopic_endpoint_t."""

    _fields_ = (
        ("key", ct.c_ubyte * 16),
        ("participant_key", ct.c_ubyte * 16),
        ("participant_handle", ct.c_uint64),
        ("topic_name", ct.c_char_p),
        ("type_name", ct.c_char_p),
        ("qos", ct.c_void_p),
    )


_int, _i32, _u32, _i64, _ptr, _size, _text = (
    ct.c_int,
    ct.c_int32,
    ct.c_uint32,
    ct.c_int64,
    ct.c_void_p,
    ct.c_size_t,
    ct.c_char_p,
)
_bool, _u64p = ct.c_bool, ct.POINTER(ct.c_uint64)

_PROTOTYPES: dict[str, tuple[Any, ...]] = {
    "dds_create_domain": (_i32, _u32, _text),
    "dds_create_participant": (_i32, _u32, _ptr, _ptr),
    "dds_create_publisher": (_i32, _i32, _ptr, _ptr),
    "dds_create_subscriber": (_i32, _i32, _ptr, _ptr),
    "dds_create_reader": (_i32, _i32, _i32, _ptr, _ptr),
    "dds_create_writer": (_i32, _i32, _i32, _ptr, _ptr),
    "dds_create_listener": (_ptr, _ptr),
    "dds_delete_listener": (None, _ptr),
    "dds_copy_listener": (None, _ptr, _ptr),
    "dds_set_listener": (_int, _i32, _ptr),
    "dds_lset_data_available_arg": (_int, _ptr, _ptr, _ptr, _bool),
    "dds_lset_subscription_matched_arg": (_int, _ptr, _ptr, _ptr, _bool),
    "dds_delete": (_int, _i32),
    "dds_get_guid": (_int, _i32, _ptr),
    "dds_get_instance_handle": (_int, _i32, _u64p),
    "dds_write": (_int, _i32, _ptr),
    "dds_take": (_int, _i32, _ptr, _ptr, _size, _u32),
    "dds_read_mask": (_int, _i32, _ptr, _ptr, _size, _u32, _u32),
    "dds_return_loan": (_int, _i32, _ptr, _i32),
    "dds_free": (None, _ptr),
    "dds_wait_for_acks": (_int, _i32, _i64),
    "dds_assert_liveliness": (_int, _i32),
    "dds_get_matched_subscriptions": (_int, _i32, _ptr, _size),
    "dds_get_matched_publications": (_int, _i32, _ptr, _size),
    "dds_get_matched_subscription_data": (_ptr, _i32, ct.c_uint64),
    "dds_get_matched_publication_data": (_ptr, _i32, ct.c_uint64),
    "dds_builtintopic_free_endpoint": (None, _ptr),
    "dds_get_requested_deadline_missed_status": (_int, _i32, _ptr),
    "dds_get_offered_deadline_missed_status": (_int, _i32, _ptr),
    "dds_get_liveliness_changed_status": (_int, _i32, _ptr),
    "dds_get_liveliness_lost_status": (_int, _i32, _ptr),
    "dds_get_sample_lost_status": (_int, _i32, _ptr),
    "dds_strretcode": (_text, _int),
    "dds_entity_pin": (_int, _i32, _ptr),
    "dds_entity_unpin": (None, _ptr),
    "dds_get_entity_sertype": (_int, _i32, _ptr),
    "dds_create_topic_sertype": (_i32, _i32, _text, _ptr, _ptr, _ptr, _ptr),
    "ddsi_sertype_ref": (_ptr, _ptr),
    "ddsi_sertype_unref": (None, _ptr),
    "dds_create_qos": (_ptr,),
    "dds_delete_qos": (None, _ptr),
    "dds_qset_userdata": (None, _ptr, _text, _size),
    "dds_qset_history": (None, _ptr, _int, _i32),
    "dds_qset_durability": (None, _ptr, _int),
    "dds_qset_durability_service": (None, _ptr, _i64, _int, _i32, _i32, _i32, _i32),
    "dds_qset_reliability": (None, _ptr, _int, _i64),
    "dds_qset_lifespan": (None, _ptr, _i64),
    "dds_qset_deadline": (None, _ptr, _i64),
    "dds_qset_liveliness": (None, _ptr, _int, _i64),
    "dds_qset_writer_data_lifecycle": (None, _ptr, _bool),
    "dds_qset_ignorelocal": (None, _ptr, _int),
    "dds_qset_data_representation": (None, _ptr, _u32, _ptr),
    "dds_qget_userdata": (_bool, _ptr, _ptr, _ptr),
    "dds_qget_prop": (_bool, _ptr, _text, _ptr),
    "dds_qget_history": (_bool, _ptr, _ptr, _ptr),
    "dds_qget_durability": (_bool, _ptr, _ptr),
    "dds_qget_reliability": (_bool, _ptr, _ptr, _ptr),
    "dds_qget_lifespan": (_bool, _ptr, _ptr),
    "dds_qget_deadline": (_bool, _ptr, _ptr),
    "dds_qget_liveliness": (_bool, _ptr, _ptr, _ptr),
}


class Api:
    """The functions of `_PROTOTYPES` as attributes, without their ``dds_`` or ``ddsi_`` prefix."""

    def __init__(self, library: ct.CDLL) -> None:
        # The calls of every message, without argument converters, which would be half of what a call costs.
        # Nothing checks what is passed: C ints as Python ints, everything else as a ctypes object of the right type.
        self.bare_write: Callable[[int, Any], int] = library["dds_write"]
        self.bare_take: Callable[[int, Any, Any, ct.c_size_t, int], int] = library["dds_take"]
        self.bare_matched: Callable[[int, Any], int] = library["dds_get_publication_matched_status"]
        self.bare_free: Callable[[int], None] = ct.PYFUNCTYPE(None, ct.c_void_p)(("dds_free", library))
        """`free` of something small, for which letting go of the GIL would take longer than the call."""
        for name, (result, *arguments) in _PROTOTYPES.items():
            function = ct.CFUNCTYPE(result, *arguments)((name, library))
            setattr(self, name.removeprefix("dds_").removeprefix("ddsi_"), function)
        self.sertype_version = ct.cast(library["ddsi_sertype_v0"], ct.c_void_p).value
        """What stands first in the function table of a type object."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Callable[..., Any]: ...

    def counts(self, entity: int, status: str, number: int) -> tuple[int, ...]:
        """The first counts of a status, such as ``sample_lost``: all of them begin with 32 bit numbers."""
        found = (ct.c_uint32 * 8)()
        self.check(getattr(self, f"get_{status}_status")(entity, found), f"read the status {status}")
        return tuple(found[:number])

    def delete_nothing(self) -> None:
        """In a forked child: deleting an inherited entity would wait for threads that are not there."""
        vars(self)["delete"] = lambda entity: 0

    def check(self, code: int, doing: str) -> int:
        """Pass a handle or a count through; raise `TransportError` for a negative code."""
        if code < 0:
            reason = self.strretcode(code)
            raise TransportError(f"Cyclone DDS could not {doing}: {reason.decode()} ({code})")
        return code


def undisturbed(function: Callable[..., Any], *arguments: Any) -> Any:
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
