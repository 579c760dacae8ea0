"""DDS Security of a participant: plugins, properties, and errors with a cause.

Properties tell Cyclone DDS where the files of the enclave and the plugins are. The plugins call functions of the
library that loaded them. Plugins of another build end the process, so only those next to the library are used, and only
if they are linked to it.

Source: docs/internals/dds.md 10.
"""

from __future__ import annotations

import ctypes as ct
import os
import re
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.api import SecurityError
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.dds.names import topic_key_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rosidl_py_gen.runtime.transport.api import SecurityEnclave
    from rosidl_py_gen.runtime.transport.cyclone.library import DdscLibrary

CAPABILITY = "DDS Security (SROS 2)"
"""Name in `Context.library_capabilities`."""
_PLUGINS = {
    "auth": ("auth", "authentication"),
    "crypto": ("crypto", "crypto"),
    "access": ("ac", "access_control"),
}
"""Name of a plugin in properties, in its file, and in its functions."""
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
_MAX_REASON = 400


class _Cause(NamedTuple):
    """Cause of a failed creation of a participant.

    Attributes:
        pattern: part of Cyclone's line.
        text: cause and fix; ``{folder}`` is that of the enclave, ``{domain}`` the domain.
    """

    pattern: str
    text: str


_CAUSES = (
    _Cause(
        "certificate has expired",
        "the certificate of the enclave, {folder}/cert.pem, or of its CA, {folder}/identity_ca.cert.pem, has expired; "
        "renew it",
    ),
    _Cause(
        "certificate is not yet valid",
        "the certificate of the enclave, {folder}/cert.pem, is not valid yet; check the clock of this machine",
    ),
    _Cause(
        "certificate revoked",
        "the certificate of the enclave, {folder}/cert.pem, is revoked by {folder}/crl.pem; issue a new one",
    ),
    _Cause(
        "PKCS7|SMIME",
        "{folder}/governance.p7s or permissions.p7s was changed, or is not signed by the CA of "
        "{folder}/permissions_ca.cert.pem; create the enclave again",
    ),
    _Cause(
        "certificate signature failure|unable to get local issuer|self.signed certificate",
        "{folder}/cert.pem was not issued by the CA of {folder}/identity_ca.cert.pem; create the enclave again",
    ),
    _Cause(
        "Subject name is invalid",
        "{folder}/permissions.p7s has no grant for the subject of {folder}/cert.pem; create the permissions again",
    ),
    _Cause(
        r"Could not find domain \d+ in governance",
        "{folder}/governance.p7s has no rule for domain {domain}; add the domain, or use one that it has",
    ),
    _Cause(
        r"Could not find domain \d+ in permissions|domain .* permissions",
        "{folder}/permissions.p7s has no rule for domain {domain}; create the permissions for ROS_DOMAIN_ID={domain}",
    ),
    _Cause(
        "Permissions validity period",
        "the permissions in {folder}/permissions.p7s are outside of their validity; create them again",
    ),
    _Cause("Failed to read CRL", "{folder}/crl.pem is not a list of revoked certificates; create it again"),
    _Cause("Could not load", "the plugins of this library do not load; reinstall the package of the library"),
)


@cache
def find_plugins(ddsc: DdscLibrary) -> dict[str, str] | str:
    """Return the file of each plugin by its name in properties, or the reason why there are none."""
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
    """Yield names and values of the properties of a secured participant."""
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
    """Return the error of a participant that Cyclone refused, with the cause in the lines that it logged."""
    reasons = [printable(" ".join(line.split()), _MAX_REASON) for line in lines]
    causes = [
        cause.text.format(folder=enclave.folder, domain=domain)
        for cause in _CAUSES
        if any(re.search(cause.pattern, reason) for reason in reasons)
    ]
    said = f"Cyclone DDS reports: {'; '.join(reasons)}" if reasons else "Cyclone DDS printed the reason, if it has one"
    return SecurityError(
        f"the secured participant of enclave {enclave.name} cannot join domain {domain}: "
        f"{causes[0] if causes else f'a file in {enclave.folder} is wrong'}. {said} ({code_text})"
    )


def denied_error(enclave: SecurityEnclave, topic: str, *, is_writer: bool) -> SecurityError:
    """Return the error of an endpoint that permissions or governance deny."""
    key = topic_key_of(topic)
    kind = {"topic": "", "request": "requests of ", "reply": "replies of ", "unmangled": ""}[key.kind]
    activity = "publish to" if is_writer else "subscribe to"
    return SecurityError(
        f"enclave {enclave.name} must not {activity} {kind}{key.name} (DDS topic {topic}): the permissions in "
        f"{enclave.folder}/permissions.p7s do not allow it; add it to the policy, and create the permissions again"
    )
