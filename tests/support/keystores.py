"""Keystores in the layout of sros2, made with `cryptography`."""

from __future__ import annotations

import datetime
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat
from cryptography.x509.oid import NameOID

from rosidl_py_gen.security.certificates import CA_NAME, certificate_pem, key_pem, new_key, signed
from rosidl_py_gen.security.policy import governance_xml

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rosidl_py_gen.security.certificates import PrivateKey

_DAY = datetime.timedelta(days=1)
DISCOVERY_TOPIC = "ros_discovery_info"


def _now() -> datetime.datetime:
    return datetime.datetime.now(datetime.timezone.utc)


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def governance(domain_id: int, kinds: Mapping[str, str] | None = None) -> str:
    """The XML of the governance of a new keystore, with other kinds of protection."""
    text = governance_xml(domain_id)
    for name, kind in (kinds or {}).items():
        text, count = re.subn(rf"(<{name}_protection_kind>)\w+", rf"\g<1>{kind}", text)
        assert count == 1
    return text


def permissions(
    subject: str,
    domain_id: int,
    publish: Sequence[str],
    subscribe: Sequence[str],
    not_after: str = "2034-01-01T00:00:00",
) -> str:
    """The XML of a permissions file, with topics as DDS names them."""

    def criteria(kind: str, topics: Sequence[str]) -> str:
        inside = "".join(f"<topic>{topic}</topic>" for topic in topics)
        return f"<{kind}><topics>{inside}</topics></{kind}>" if topics else ""

    return f"""<?xml version="1.0" encoding="UTF-8"?>
<dds><permissions><grant name="{subject}">
<subject_name>CN={subject}</subject_name>
<validity><not_before>2020-01-01T00:00:00</not_before><not_after>{not_after}</not_after></validity>
<allow_rule><domains><id>{domain_id}</id></domains>
{criteria("publish", publish)}{criteria("subscribe", subscribe)}
</allow_rule>
<default>DENY</default>
</grant></permissions></dds>"""


class Authority:
    """A CA."""

    def __init__(self, name: str = CA_NAME) -> None:
        self.key = new_key()
        self.name = _name(name)
        self.certificate = self.issue(name, self.key, days=(-1, 3650), is_ca=True)

    def issue(
        self, name: str, key: PrivateKey, *, days: tuple[int, int] = (-1, 3650), is_ca: bool = False
    ) -> x509.Certificate:
        """A certificate, valid between these days from now."""
        builder = x509.CertificateBuilder(self.name, _name(name), key.public_key(), x509.random_serial_number())
        builder = builder.not_valid_before(_now() + days[0] * _DAY).not_valid_after(_now() + days[1] * _DAY)
        if is_ca:
            builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=1), critical=True)
        return builder.sign(self.key, SHA256())

    def revoke(self, certificate: x509.Certificate) -> bytes:
        """A list of revoked certificates with this one, as PEM."""
        one = x509.RevokedCertificateBuilder(certificate.serial_number, _now() - _DAY).build()
        builder = x509.CertificateRevocationListBuilder(self.name, _now() - _DAY, _now() + 3650 * _DAY)
        builder = builder.add_revoked_certificate(one)
        return builder.sign(self.key, SHA256()).public_bytes(Encoding.PEM)

    def encrypted_key(self) -> bytes:
        """The private key with a password, as PEM."""
        return self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret"))

    def sign(self, text: str) -> bytes:
        """The text as S/MIME."""
        return signed(text, self.certificate, self.key)


@dataclass
class Enclave:
    """An enclave of a keystore."""

    name: str
    folder: Path
    certificate: x509.Certificate


class Keystore:
    """A keystore below a folder, for one domain."""

    def __init__(self, folder: Path, domain_id: int, kinds: Mapping[str, str] | None = None) -> None:
        self.folder = folder
        self.domain_id = domain_id
        self.authority = Authority()
        (folder / "enclaves").mkdir(parents=True)
        self.write_governance(domain_id, kinds)

    def write_governance(self, domain_id: int, kinds: Mapping[str, str] | None = None) -> None:
        """Write governance.p7s."""
        (self.folder / "enclaves/governance.p7s").write_bytes(self.authority.sign(governance(domain_id, kinds)))

    def enclave(
        self,
        name: str,
        *,
        publish: Sequence[str] = ("*",),
        subscribe: Sequence[str] = ("*",),
        authority: Authority | None = None,
        days: tuple[int, int] = (-1, 3650),
        subject: str = "",
        not_after: str = "2034-01-01T00:00:00",
    ) -> Enclave:
        """Make an enclave that may use these topics, as DDS names them, and that of discovery.

        Args:
            authority: issuer of the certificate, and the CA that the enclave trusts.
            days: first and last day of the certificate from now.
            subject: of the permissions, if not the name.
            not_after: end of the permissions.
        """
        authority = authority or self.authority
        folder = self.folder / "enclaves" / name.lstrip("/")
        folder.mkdir(parents=True, exist_ok=True)
        key = new_key()
        certificate = authority.issue(name, key, days=days)
        (folder / "key.pem").write_bytes(key_pem(key))
        (folder / "key.pem").chmod(0o600)
        (folder / "cert.pem").write_bytes(certificate_pem(certificate))
        for ca in ("identity_ca", "permissions_ca"):
            (folder / f"{ca}.cert.pem").write_bytes(certificate_pem(authority.certificate))
        text = permissions(
            subject or name,
            self.domain_id,
            (*publish, DISCOVERY_TOPIC),
            (*subscribe, DISCOVERY_TOPIC),
            not_after=not_after,
        )
        (folder / "permissions.p7s").write_bytes(authority.sign(text))
        if authority is not self.authority:
            (folder / "governance.p7s").write_bytes(authority.sign(governance(self.domain_id)))
        elif folder != self.folder / "enclaves":
            (folder / "governance.p7s").symlink_to(self.folder / "enclaves/governance.p7s")
        return Enclave(name, folder, certificate)

    def environment(self, **more: str) -> dict[str, str]:
        """The variables that turn security on."""
        return {
            "ROS_SECURITY_ENABLE": "true",
            "ROS_SECURITY_STRATEGY": "Enforce",
            "ROS_SECURITY_KEYSTORE": str(self.folder),
            "ROSIDL_LIBDDSC": "libddsc.so.0debian",
            **more,
        }
