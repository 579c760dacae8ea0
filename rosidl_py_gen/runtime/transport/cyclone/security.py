"""DDS Security of a participant: plugins, properties, explained errors, governance rules, and rejected peers.

The properties of a participant contain the locations of the enclave's files and of the plugins. While secured
participants exist, a log sink receives the lines of Cyclone's log. Patterns are texts, which `re` compiles when a
secured participant needs them.

Source: docs/internals/dds.md 10 to 12.
"""

from __future__ import annotations

import ctypes as ct
import os
import re
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.api import SecurityEnclave, SecurityError
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.library import CycloneApi, DdscLibrary
from rosidl_py_gen.runtime.transport.dds.names import topic_key_of

CAPABILITY = "DDS Security (SROS 2)"
"""Name of DDS Security in `Context.library_capabilities`."""
_PLUGINS = {"auth": ("auth", "authentication"), "crypto": ("crypto", "crypto"), "access": ("ac", "access_control")}
"""Names of each security plugin: in properties, in the name of its file, and in the names of its functions."""
_FILE = {"win32": "dds_security_{}.dll", "darwin": "libdds_security_{}.dylib"}.get(
    sys.platform, "libdds_security_{}.so"
)
_FILES = {
    "dds.sec.auth.identity_ca": "identity_ca.cert.pem",
    "dds.sec.auth.identity_certificate": "cert.pem",
    "dds.sec.auth.private_key": "key.pem",
    "dds.sec.access.permissions_ca": "permissions_ca.cert.pem",
    "dds.sec.access.governance": "governance.p7s",
    "dds.sec.access.permissions": "permissions.p7s",
}
_REVOKED = "crl.pem"
_MAX_REASON_CHARS = 400

_CAUSES = {
    "certificate has expired": (
        "the certificate of the enclave, {folder}/cert.pem, or of its CA, {folder}/identity_ca.cert.pem, has expired;"
        " renew it"
    ),
    "certificate is not yet valid": (
        "the certificate of the enclave, {folder}/cert.pem, is not valid yet; check the clock of this machine"
    ),
    "certificate revoked": (
        "the certificate of the enclave, {folder}/cert.pem, is revoked by {folder}/crl.pem; issue a new one"
    ),
    "PKCS7|SMIME": (
        "{folder}/governance.p7s or permissions.p7s was changed, or is not signed by the CA of "
        "{folder}/permissions_ca.cert.pem; create the enclave again"
    ),
    "certificate signature failure|unable to get local issuer|self.signed certificate": (
        "{folder}/cert.pem was not issued by the CA of {folder}/identity_ca.cert.pem; create the enclave again"
    ),
    "Subject name is invalid": (
        "{folder}/permissions.p7s has no grant for the subject of {folder}/cert.pem; create the permissions again"
    ),
    r"Could not find domain \d+ in governance": (
        "{folder}/governance.p7s has no rule for domain {domain}; add the domain, or use one that it has"
    ),
    r"Could not find domain \d+ in permissions|domain .* permissions": (
        "{folder}/permissions.p7s has no rule for domain {domain}; create the permissions for ROS_DOMAIN_ID={domain}"
    ),
    "Permissions validity period": (
        "the permissions in {folder}/permissions.p7s are outside of their validity; create them again"
    ),
    "Failed to read CRL": "{folder}/crl.pem is not a list of revoked certificates; create it again",
    "Could not load": "the plugins of this library do not load; reinstall the package of the library",
}
"""Causes of the failed creation of a secured participant with their fixes, by pattern of a line that Cyclone logs.

``{folder}`` stands for the folder of the enclave.
"""


@cache
def find_plugins(ddsc: DdscLibrary) -> dict[str, str] | str:
    """Return the file of each security plugin, by the plugin's name in properties.

    If there are no plugins, the result is a text with the reason.
    """
    if not ddsc.has_security:
        return f"{ddsc} was built without security; {library.security_advice()}"
    folder = Path(ddsc.file).parent
    for candidate in (folder, *sorted(folder.glob(f"{Path(ddsc.file).name.split('.')[0]}*"))):
        files = {name: candidate / _FILE.format(file) for name, (file, _) in _PLUGINS.items()}
        if all(file.is_file() for file in files.values()):
            break
    else:
        expected = _FILE.format("auth")
        return f"{ddsc} has security, but its plugins ({expected} and two more) are not in {folder}; install them"
    # The plugins call functions of the library that loaded them. Plugins of another build end the process, so only
    # plugins next to the library are used, and only if they are linked to it.
    for file in files.values():
        try:
            linked = library.file_of(ct.CDLL(str(file)), "")
        except (OSError, AttributeError) as error:
            return f"the plugin {file} does not load: {error}"
        if linked != ddsc.file and linked:
            return (
                f"the plugin {file} belongs to another library, {linked}; the two would crash. "
                f"{library.security_advice()}"
            )
    return {name: str(file) for name, file in files.items()}


def security_properties(enclave: SecurityEnclave, plugins: dict[str, str]) -> Iterator[tuple[bytes, bytes]]:
    """Yield names and values of the properties of a secured participant.

    Raises:
        SecurityError: the list of revoked certificates is a link to a missing file.
    """
    folder = Path(enclave.folder)
    properties = {name: f"file:{folder / file}" for name, file in _FILES.items()}
    for name, (_, function) in _PLUGINS.items():
        properties |= {
            f"dds.sec.{name}.library.path": plugins[name],
            f"dds.sec.{name}.library.init": f"init_{function}",
            f"dds.sec.{name}.library.finalize": f"finalize_{function}",
        }
    if (folder / _REVOKED).is_symlink() and not (folder / _REVOKED).exists():
        raise SecurityError(f"{folder / _REVOKED} (revoked certificates) is a link to a file that does not exist")
    if (folder / _REVOKED).is_file():
        properties["org.eclipse.cyclonedds.sec.auth.crl"] = f"file:{folder / _REVOKED}"
    for name, value in properties.items():
        yield name.encode(), os.fsencode(value)


def creation_error(enclave: SecurityEnclave, domain: int, code_text: str, lines: Iterable[str]) -> SecurityError:
    """Return the error about a secured participant that Cyclone refused; the cause is found in its log `lines`."""
    reasons = [printable(" ".join(line.split()), _MAX_REASON_CHARS) for line in lines]
    causes = [text for pattern, text in _CAUSES.items() if any(re.search(pattern, reason) for reason in reasons)]
    cause = causes[0].format(folder=enclave.folder, domain=domain) if causes else f"a file in {enclave.folder} is wrong"
    said = f"Cyclone DDS reports: {'; '.join(reasons)}" if reasons else "Cyclone DDS printed the reason, if it has one"
    return SecurityError(
        f"the secured participant of enclave {enclave.name} cannot join domain {domain}: {cause}. {said} ({code_text})"
    )


def denied_error(enclave: SecurityEnclave, topic: str, *, is_writer: bool) -> SecurityError:
    """Return the error about a writer or reader of a DDS topic that the enclave's permissions or governance deny."""
    key = topic_key_of(topic)
    kind = {"topic": "", "request": "requests of ", "reply": "replies of ", "unmangled": ""}[key.kind]
    activity = "publish to" if is_writer else "subscribe to"
    return SecurityError(
        f"enclave {enclave.name} must not {activity} {kind}{key.name} (DDS topic {topic}): the permissions in "
        f"{enclave.folder}/permissions.p7s do not allow it; add it to the policy, and create the permissions again"
    )


# ---------------------------------------------------------------------------------------------------------- governance


_MAX_GOVERNANCE_BYTES = 1 << 20
_COMMENT = r"(?s)<!--.*?-->"
_DOMAIN_RULE = r"(?s)<domain_rule>(.*?)</domain_rule>"
_ID = r"<id>\s*(\d{1,9})\s*</id>"
_RANGE = r"(?s)<id_range>(.*?)</id_range>"
_MIN, _MAX = (rf"<{name}>\s*(\d{{1,9}})\s*</{name}>" for name in ("min", "max"))
_TOPIC_RULE = r"(?s)<topic_rule>(.*?)</topic_rule>"
_EXPRESSION = r"(?s)<topic_expression>\s*(.*?)\s*</topic_expression>"
_PROTECTED_DATA = r"<data_protection_kind>\s*(?:SIGN|ENCRYPT)\s*<"
_PLAIN_METADATA = r"<metadata_protection_kind>\s*NONE\s*<"


class Governance:
    """Topic rules of one domain in the governance file of an enclave.

    The file is S/MIME with readable XML. Cyclone has verified its signature.
    """

    def __init__(self, folder: str, domain_id: int) -> None:
        text = ""
        with suppress(OSError), (Path(folder) / "governance.p7s").open("rb") as content:
            text = re.sub(_COMMENT, "", content.read(_MAX_GOVERNANCE_BYTES).decode(errors="replace"))
        rules = (rule for rule in re.findall(_DOMAIN_RULE, text) if _has_domain(rule, domain_id))
        self._rules = [
            (expression[1], bool(re.search(_PROTECTED_DATA, rule) and re.search(_PLAIN_METADATA, rule)))
            for rule in re.findall(_TOPIC_RULE, next(rules, ""))
            if (expression := re.search(_EXPRESSION, rule))
        ]
        """Topic expression of each rule, and True if the rule protects the data of a topic, but not the metadata."""

    def only_data_reason(self, topic: str = "") -> str:
        """Return the reason why Fast DDS peers receive no data of a DDS topic: its rule protects only the data.

        Without a topic, the reason is about the first such rule. The reason is empty if no such rule applies.
        """
        rules = (rule for rule in self._rules if (fnmatchcase(topic, rule[0]) if topic else rule[1]))
        expression, is_only_data = next(rules, ("", False))
        if not is_only_data:
            return ""
        return (
            f"the governance rule {expression!r:.100} protects data but not metadata, and then Cyclone DDS and Fast "
            "DDS do not understand each other; use metadata_protection_kind SIGN or ENCRYPT, or data_protection_kind "
            "NONE"
        )


def _has_domain(rule: str, domain_id: int) -> bool:
    domains = rule.partition("</domains>")[0]
    if any(int(number) == domain_id for number in re.findall(_ID, domains)):
        return True
    for bounds in re.findall(_RANGE, domains):
        low, high = re.search(_MIN, bounds), re.search(_MAX, bounds)
        if (low is None or int(low[1]) <= domain_id) and (high is None or domain_id <= int(high[1])):
            return True
    return False


# ------------------------------------------------------------------------------------------------------ rejected peers


_MAX_PEERS = 100
"""Maximum number of rejected peers to record. A peer may have any subject, so their number has no other bound."""
_MAX_RECORD_CHARS = 300
_SUBJECT = r"; subject: (.*?)(?:\(code: \d+\))?$"
_OPENSSL = r":?\s*(?<![0-9A-F])[0-9A-F]{8,}:error:.*"
"""Regular expression for texts of OpenSSL errors, which contain an address that changes."""
_CODE = r"\s*\(code: \d+\)\s*$"
_GUID = r"\b[0-9a-f]{1,8}(?::[0-9a-f]{1,8}){3}\b"
_SECURITY_FILES = ("security", "handshake")
"""Parts of the names of those source files of Cyclone that log about security."""
_EARLY_PEER = "Remote secure participant"
"""Text in a log line about a peer that was received before the participant of this process exists.

The line is ignored, because the peer is discovered later.
"""
_EXPLANATIONS = {
    "Failed to convert octet sequence to ASN1 integer": (
        "a limitation between Cyclone DDS and Fast DDS: they authenticate each other only if Cyclone DDS begins the "
        "handshake; a hash of the names of their enclaves decides that. Rename one of these enclaves"
    ),
    "certificate has expired": "the certificate of the peer, or its CA, has expired",
    "certificate is not yet valid": "the certificate of the peer is not valid yet; check the clocks",
    "certificate revoked": "the certificate of the peer is revoked",
    "certificate signature failure|unable to get local issuer|self.signed certificate": (
        "the certificate of the peer was issued by another CA"
    ),
}
"""Reasons why a secured peer was rejected, by pattern of a line that Cyclone logs."""


class LogData(ct.Structure):
    """C structure dds_log_data_t: one line of Cyclone's log."""

    _fields_ = (
        *(("kind", ct.c_uint32), ("domain_id", ct.c_uint32), ("file", ct.c_char_p), ("line", ct.c_uint32)),
        *(("function", ct.c_char_p), ("message", ct.c_void_p), ("size", ct.c_size_t), ("header_size", ct.c_size_t)),
    )


_Sink = ct.CFUNCTYPE(None, ct.c_void_p, ct.POINTER(LogData))


class SecurityLog:
    """Receiver of Cyclone's log lines about security; one object for the process.

    If the library has no `dds_set_log_sink`, no lines are received.
    """

    def __init__(self, api: CycloneApi) -> None:
        self._api = api
        self._sink = _Sink(self._on_line)
        self._lock = threading.Lock()
        """Lock of `_wakeups`; never held by the log sink."""
        self._wakeups: tuple[Callable[[], None], ...] = ()
        """Functions, one for each secured participant, that make the participant's loop call `new_records`."""
        self._captures: dict[int, list[str]] = {}
        """Log lines of threads that are creating a participant, by the id of the thread."""
        self._peers: set[str] = set()
        self._records: deque[str] = deque()

    def open(self, wakeup: Callable[[], None]) -> None:
        """Receive Cyclone's log lines until `close` is called with the same function.

        Call `wakeup` after each new record.
        """
        with self._lock:
            if not self._wakeups:
                self._peers.clear()
                self._records.clear()
            if not self._wakeups and self._api.set_log_sink is not None:
                self._api.set_log_sink(self._sink, None)
            self._wakeups = (*self._wakeups, wakeup)

    def close(self, wakeup: Callable[[], None]) -> None:
        """Undo a call of `open` with the same function; after the last `close`, no lines are received."""
        with self._lock:
            self._wakeups = tuple(one for one in self._wakeups if one != wakeup)
            if self._api.set_log_sink is not None:  # this also waits for a sink that still uses the old tuple
                self._api.set_log_sink(self._sink if self._wakeups else None, None)

    @contextmanager
    def captured(self) -> Iterator[list[str]]:
        """Yield a list to which the lines are added that Cyclone logs in this thread inside the block."""
        thread_id = threading.get_ident()
        lines = self._captures[thread_id] = []
        try:
            yield lines
        finally:
            del self._captures[thread_id]

    def new_records(self) -> list[str]:
        """Return the new texts about rejected peers, each once."""
        records = []
        for _ in range(len(self._records)):  # threads of Cyclone may append, and other participants read
            with suppress(IndexError):
                records.append(self._records.popleft())
        return records

    def _on_line(self, _: object, pointer: Any) -> None:
        """Process a line of Cyclone's log: capture, record, ignore or print it.

        Called by Cyclone with a lock of its log held; must not raise, block or log.
        """
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
            else:  # another subject: standard error, where Cyclone writes without a sink
                os.write(2, ct.string_at(data.message - data.header_size, data.header_size + data.size + 1))
        except Exception:  # must not reach Cyclone; standard error may be closed
            return

    def _record(self, text: str) -> None:
        if len(self._peers) > _MAX_PEERS:
            return
        text = printable(re.sub(_OPENSSL, "", " ".join(text.split())), _MAX_RECORD_CHARS)
        # A rejected peer repeats its attempt, and Cyclone logs each. Lines that differ only in a GUID count once.
        key = re.sub(_GUID, "", text)
        if key in self._peers:
            return
        self._peers.add(key)
        is_last = len(self._peers) > _MAX_PEERS
        self._records.append("further rejected peers are not logged" if is_last else _explain(text))
        for wakeup in self._wakeups:
            wakeup()


def _explain(text: str) -> str:
    """Return a text for people about a rejected peer, from a log line of Cyclone."""
    subject = re.search(_SUBJECT, text)
    name = f" with subject {subject[1].strip()}" if subject else ""
    reason = next((reason for pattern, reason in _EXPLANATIONS.items() if re.search(pattern, text)), "")
    said = re.sub(_CODE, "", text)
    return f"security: a peer{name} was rejected: {f'{reason}. Cyclone DDS reports: ' if reason else ''}{said}"
