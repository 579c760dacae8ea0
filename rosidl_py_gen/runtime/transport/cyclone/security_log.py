"""Lines of Cyclone's log about security: causes of errors of this participant, and records of rejected peers.

A rejected peer repeats its attempt, and Cyclone logs each. Here a peer is recorded once. While secured participants
exist, a sink receives Cyclone's lines; those about other subjects are written to standard error, as without it.

Source: docs/internals/dds.md 11.
"""

from __future__ import annotations

import ctypes as ct
import os
import re
import threading
from collections import deque
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import printable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi

_MAX_PEERS = 100
"""Maximum number of rejected peers to record. A peer may have any subject, so their number has no other bound."""
_MAX_TEXT = 300
_SUBJECT = re.compile(r"; subject: (.*?)(?:\(code: \d+\))?$")
_OPENSSL = re.compile(r":?\s*(?<![0-9A-F])[0-9A-F]{8,}:error:.*")
"""Errors of OpenSSL, which contain an address that changes."""
_CODE = re.compile(r"\s*\(code: \d+\)\s*$")
_GUID = re.compile(r"\b[0-9a-f]{1,8}(?::[0-9a-f]{1,8}){3}\b")
_SECURITY_FILES = ("security", "handshake")
"""Parts of the names of Cyclone's source files that log about security."""
_EARLY_PEER = "Remote secure participant"
"""Line about a peer that was received before the participant of this process exists; the peer is discovered later."""
_FAST_DDS_HANDSHAKE = "Failed to convert octet sequence to ASN1 integer"
_EXPLANATIONS = (
    (
        _FAST_DDS_HANDSHAKE,
        "a limitation between Cyclone DDS and Fast DDS: they authenticate each other only if Cyclone DDS begins "
        "the handshake; a hash of the names of their enclaves decides that. Rename one of these enclaves",
    ),
    ("certificate has expired", "the certificate of the peer, or its CA, has expired"),
    ("certificate is not yet valid", "the certificate of the peer is not valid yet; check the clocks"),
    ("certificate revoked", "the certificate of the peer is revoked"),
    (
        "certificate signature failure|unable to get local issuer|self.signed certificate",
        "the certificate of the peer was issued by another CA",
    ),
)


class _LogData(ct.Structure):
    """dds_log_data_t."""

    _fields_ = (
        *(("kind", ct.c_uint32), ("domain_id", ct.c_uint32), ("file", ct.c_char_p), ("line", ct.c_uint32)),
        *(("function", ct.c_char_p), ("message", ct.c_void_p), ("size", ct.c_size_t), ("header_size", ct.c_size_t)),
    )


_Sink = ct.CFUNCTYPE(None, ct.c_void_p, ct.POINTER(_LogData))


class SecurityLog:
    """Sink of Cyclone's log; one object for the process. Without `dds_set_log_sink` it receives nothing."""

    def __init__(self, api: CycloneApi) -> None:
        self._api = api
        self._sink = _Sink(self._on_line)
        self._lock = threading.Lock()
        """Guards `_wakeups`; never held by the sink."""
        self._wakeups: tuple[Callable[[], None], ...] = ()
        """One function for each secured participant, which makes its loop call `new_records`."""
        self._captures: dict[int, list[str]] = {}
        """Lines by the thread that creates a participant."""
        self._peers: set[str] = set()
        self._records: deque[str] = deque()

    def open(self, wakeup: Callable[[], None]) -> None:
        """Receive lines, and call `wakeup` after a new record, until `close` with the same function."""
        with self._lock:
            if not self._wakeups:
                self._peers.clear()
                self._records.clear()
            if not self._wakeups and self._api.set_log_sink is not None:
                self._api.set_log_sink(self._sink, None)
            self._wakeups = (*self._wakeups, wakeup)

    def close(self, wakeup: Callable[[], None]) -> None:
        """Undo one `open`."""
        with self._lock:
            self._wakeups = tuple(one for one in self._wakeups if one != wakeup)
            if self._api.set_log_sink is not None:  # this also waits for a sink that still uses the old tuple
                self._api.set_log_sink(self._sink if self._wakeups else None, None)

    @contextmanager
    def captured(self) -> Iterator[list[str]]:
        """Yield a list of the lines that Cyclone logs in this thread."""
        thread_id = threading.get_ident()
        lines = self._captures[thread_id] = []
        try:
            yield lines
        finally:
            del self._captures[thread_id]

    def new_records(self) -> list[str]:
        """Return texts to log, each once."""
        return [self._records.popleft() for _ in range(len(self._records))]  # threads of Cyclone may append

    def _on_line(self, _: object, pointer: Any) -> None:
        """Called by Cyclone with a lock of its log held; must not raise, block or log."""
        try:
            data = pointer.contents
            text = ct.string_at(data.message, data.size).decode(errors="replace")
            lines = self._captures.get(threading.get_ident())
            if lines is not None:
                lines.append(text)
            elif _EARLY_PEER in text:
                return
            elif any(name in os.path.basename(data.file.decode(errors="replace")) for name in _SECURITY_FILES):
                self._record(text)
            else:
                os.write(2, ct.string_at(data.message - data.header_size, data.header_size + data.size + 1))
        except Exception:  # must not reach Cyclone; standard error may be closed
            return

    def _record(self, text: str) -> None:
        if len(self._peers) > _MAX_PEERS:
            return
        text = printable(_OPENSSL.sub("", " ".join(text.split())), _MAX_TEXT)
        key = _GUID.sub("", text)
        if key in self._peers:
            return
        self._peers.add(key)
        is_last = len(self._peers) > _MAX_PEERS
        self._records.append("further rejected peers are not logged" if is_last else _explain(text))
        for wakeup in self._wakeups:
            wakeup()


def _explain(text: str) -> str:
    """Return a record about a rejected peer, with its subject if Cyclone names it."""
    subject = _SUBJECT.search(text)
    name = f" with subject {subject[1].strip()}" if subject else ""
    reason = next((reason for pattern, reason in _EXPLANATIONS if re.search(pattern, text)), "")
    said = _CODE.sub("", text)
    return f"security: a peer{name} was rejected: {f'{reason}. Cyclone DDS reports: ' if reason else ''}{said}"
