"""Keys, certificates and signatures of a keystore; the only module that uses the package cryptography.

Keys are elliptic-curve keys on P-256, stored as PKCS #8 without a password, because nodes cannot ask for a password.
Source: DDS Security 1.1, 9.3.1 and 9.4.1.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING, Any, TypeAlias

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import pkcs7
from cryptography.x509.oid import NameOID

from rosidl_py_gen.command_support import CommandError

if TYPE_CHECKING:
    from pathlib import Path

PrivateKey: TypeAlias = "ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey"
CA_NAME = "sros2CA"
"""Common name of the certificate authority in a keystore, as in keystores of ROS."""
VALIDITY = timedelta(days=3650)
_MARGIN = timedelta(days=1)
"""Time before the creation of a certificate from which it is valid, because the clock of a peer may be behind."""


def new_key() -> ec.EllipticCurvePrivateKey:
    return ec.generate_private_key(ec.SECP256R1())


def key_pem(key: PrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def certificate_pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def ca_certificate(key: PrivateKey) -> x509.Certificate:
    """Return a certificate for a certificate authority with this key, signed with the same key."""
    name = _name(CA_NAME)
    return _certificate(name, name, key.public_key(), key, x509.BasicConstraints(ca=True, path_length=1))


def enclave_certificate(enclave: str, key: PrivateKey, ca: x509.Certificate, ca_key: PrivateKey) -> x509.Certificate:
    """Return a certificate for the key of an enclave, issued by the authority `ca`; its common name is `enclave`."""
    constraints = x509.BasicConstraints(ca=False, path_length=None)
    return _certificate(_name(enclave), ca.subject, key.public_key(), ca_key, constraints)


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _certificate(
    subject: x509.Name, issuer: x509.Name, public_key: Any, signing_key: PrivateKey, constraints: x509.BasicConstraints
) -> x509.Certificate:
    now = datetime.now(timezone.utc)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _MARGIN)
        .not_valid_after(now + VALIDITY)
        .add_extension(constraints, critical=constraints.ca)
    )
    return builder.sign(signing_key, hashes.SHA256())


def load_key(path: Path) -> PrivateKey:
    """Return the private key in a PEM file; raises `CommandError`, whose text contains nothing of the file."""
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), None)
    except TypeError:
        raise CommandError(f"{path}: the private key has a password; expected one without, as nodes need it") from None
    except (ValueError, UnsupportedAlgorithm):
        raise CommandError(f"{path}: not a private key; expected PEM (-----BEGIN PRIVATE KEY-----)") from None
    if not isinstance(key, ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey):
        raise CommandError(f"{path}: got a key of another kind; DDS Security needs an EC (P-256) or RSA key")
    return key


def load_certificate(path: Path) -> x509.Certificate:
    """Return the certificate in a PEM file. Raises `CommandError` if the file has none."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except (ValueError, UnsupportedAlgorithm) as error:
        reason = str(error).partition(".")[0]
        raise CommandError(f"{path}: not a certificate: {reason}; expected PEM (-----BEGIN CERTIFICATE-----)") from None


def is_key_of(key: PrivateKey, certificate: x509.Certificate) -> bool:
    return key.public_key() == certificate.public_key()


def is_issued_by(certificate: x509.Certificate, ca: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(ca)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        return False
    return True


def has_common_name(certificate: x509.Certificate, name: str) -> bool:
    return certificate.subject == _name(name)


def is_expired(certificate: x509.Certificate) -> bool:
    return certificate.not_valid_after_utc < datetime.now(timezone.utc)


def signed(document: str, certificate: x509.Certificate, key: PrivateKey) -> bytes:
    """Return a document as an S/MIME message with a detached signature, the form of governance and permissions."""
    builder = pkcs7.PKCS7SignatureBuilder().set_data(document.encode()).add_signer(certificate, key, hashes.SHA256())
    options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
    return builder.sign(serialization.Encoding.SMIME, options)
