"""Security of a context (SROS 2): the enclave that the environment selects, and its files.

The rules are those of rcl and rmw_cyclonedds. Where rcl remains unsecured silently, a warning is logged.

Source: docs/internals/dds.md 10.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.api import SecurityEnclave, SecurityError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

SECURITY_FILES = {
    "identity_ca.cert.pem": "certificate of the CA that issues the certificates of all peers",
    "cert.pem": "certificate of the enclave",
    "key.pem": "private key of the enclave",
    "permissions_ca.cert.pem": "certificate of the CA that signs governance and permissions",
    "governance.p7s": "signed rules of the domain",
    "permissions.p7s": "signed permissions of the enclave",
}
"""Purpose of each file of an enclave."""
_DISABLED = ("", "false", "0", "no", "off")
_MAX_LISTED_ENCLAVES = 5
_MAX_FOLDERS = 1000
"""Maximum number of folders of a keystore to search for the enclaves that an error lists."""
_UNENCRYPTED = "this process communicates unencrypted, and does not find secured nodes"


def find_security(
    environ: Mapping[str, str], enclave: str, warn: Callable[[str], None], *, is_supported: bool = True
) -> SecurityEnclave | None:
    """Return the enclave with its files; None if the context is not secured.

    Args:
        enclave: name of the context's enclave.
        is_supported: False if the transport has no security.

    Raises:
        SecurityError: security is enforced, and something is missing.
    """
    enable = environ.get("ROS_SECURITY_ENABLE", "")
    if enable != "true":
        if enable.lower() not in _DISABLED:
            warn(f"ROS_SECURITY_ENABLE={enable!r:.100} does not enable security, only 'true' does; {_UNENCRYPTED}")
        elif not enable and environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
            warn(f"ROS_SECURITY_STRATEGY=Enforce has no effect without ROS_SECURITY_ENABLE=true; {_UNENCRYPTED}")
        return None
    strategy = environ.get("ROS_SECURITY_STRATEGY", "")
    is_enforced = strategy == "Enforce"
    if not is_enforced and strategy.lower() not in ("", "permissive"):
        warn(
            f"ROS_SECURITY_STRATEGY={strategy!r:.100} does not enforce security, only 'Enforce' does: nodes start "
            "unsecured if the enclave is incomplete"
        )
    try:
        problem, found = _find_folder(environ, enclave) if is_supported else ("this transport has no security", None)
    except OSError as error:  # a folder that this user may not enter, a name that is too long
        problem, found = f"{error.filename} cannot be read: {error.strerror}", None
    if found is None:
        if is_enforced:
            raise SecurityError(f"ROS_SECURITY_STRATEGY=Enforce requires a secured context, but {problem}")
        warn(
            f"ROS_SECURITY_ENABLE=true, but {problem}; {_UNENCRYPTED}. With ROS_SECURITY_STRATEGY=Enforce this is an "
            "error"
        )
        return None
    return SecurityEnclave(enclave, str(found), is_enforced)


def _find_folder(environ: Mapping[str, str], enclave: str) -> tuple[str, Path | None]:
    """Return the reason why there is no complete enclave, and the folder of a complete one."""
    keystore = environ.get("ROS_SECURITY_KEYSTORE", "")
    if not keystore:
        return "ROS_SECURITY_KEYSTORE is not set; expected the folder of a keystore", None
    override = environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE", "")
    root = Path(keystore) / "enclaves"
    folder = Path(f"{root}/{(override or enclave)[1:]}")  # rcl drops the first character of an override, whatever it is
    if override and not override.startswith("/"):
        origin = f"ROS_SECURITY_ENCLAVE_OVERRIDE={override!r:.300}, which must begin with '/'"
    else:
        origin = "ROS_SECURITY_ENCLAVE_OVERRIDE" if override else f"enclave {enclave}"
    if not folder.is_dir():
        return f"there is no folder {folder} ({origin}){_known_enclaves(root)}", None
    if not any((folder / name).exists() for name in ("cert.pem", "key.pem")):  # such as the root, which contains others
        return f"there is no enclave in {folder} ({origin}){_known_enclaves(root)}", None
    missing = [f"{name} ({purpose})" for name, purpose in SECURITY_FILES.items() if not (folder / name).is_file()]
    if missing:
        return f"{folder} ({origin}) lacks {', '.join(missing)}; create the enclave again", None
    for name, purpose in SECURITY_FILES.items():
        _check_file(folder / name, purpose)
    _check_certificates(folder)
    return "", folder


def _check_file(file: Path, purpose: str) -> None:
    """Raise `SecurityError` if a file cannot be read or is of another kind; also rcl fails then with any strategy."""
    try:
        with file.open("rb") as content:
            head = content.read(1 << 20)
    except OSError as error:
        raise SecurityError(f"{file} ({purpose}) cannot be read: {error.strerror}") from None
    expected = b"MIME-Version:" if file.suffix == ".p7s" else b"-----BEGIN "
    if expected not in head:
        kind = "S/MIME" if file.suffix == ".p7s" else "PEM"
        raise SecurityError(f"{file} ({purpose}) is not a file in {kind} format: {expected.decode()!r} is missing")


def _check_certificates(folder: Path) -> None:
    """Raise `SecurityError` if a certificate or the key is damaged, or if the key is not that of the certificate.

    Cyclone DDS accepts a key of another certificate, and then finds no peer.
    """
    try:
        import ssl
    except ImportError:  # a Python without OpenSSL; Cyclone DDS finds most of these faults
        return
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    certificate, key = folder / "cert.pem", folder / "key.pem"
    try:
        for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem", "cert.pem"):
            damaged = f"{folder / name} ({SECURITY_FILES[name]}) is damaged"
            ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(folder / name)
        damaged = f"{key} ({SECURITY_FILES['key.pem']}) is damaged, has a password, or is not the key of {certificate}"
        context.load_cert_chain(certificate, key, password=lambda: "")
    except (ssl.SSLError, OSError, ValueError) as error:
        reason = getattr(error, "reason", "") or error
        raise SecurityError(f"{damaged}: {reason}; create the enclave again") from None


def _known_enclaves(root: Path) -> str:
    """Return a text about the enclaves that a keystore has."""
    if not root.is_dir():
        return f"; ROS_SECURITY_KEYSTORE={str(root.parent)!r} is not a keystore, as it has no folder enclaves"
    found: list[str] = []
    for number, (folder, _, files) in enumerate(os.walk(root)):
        if number > _MAX_FOLDERS or len(found) > _MAX_LISTED_ENCLAVES:
            break
        if "key.pem" in files:
            found.append("/" + Path(folder).relative_to(root).as_posix().strip("."))
    listed = ", ".join(sorted(found)[:_MAX_LISTED_ENCLAVES]) + (", ..." if len(found) > _MAX_LISTED_ENCLAVES else "")
    select = "select one with --enclave or ROS_SECURITY_ENCLAVE_OVERRIDE, or create this one"
    return f"; the keystore has the enclaves {listed}; {select}" if found else "; the keystore has no enclave"
