"""Keystores in the layout of SROS2, which nodes of ROS and of this package read.

::

    public/   ca.cert.pem                identity_ca.cert.pem, permissions_ca.cert.pem are links to it
    private/  ca.key.pem                 identity_ca.key.pem, permissions_ca.key.pem are links to it
    enclaves/ governance.xml .p7s        and a folder for each enclave, such as robot/talker for /robot/talker:
              NAME/ key.pem cert.pem permissions.xml permissions.p7s
                    governance.p7s identity_ca.cert.pem permissions_ca.cert.pem are links

The enclave ``/`` is the folder ``enclaves`` itself. A command that was interrupted can be repeated: each file is
written completely or not at all, private files with mode 0600 from the beginning, and existing files are used. A
symbolic link in the place of a file is replaced, never followed.

Existing files and folders are used only if no other user can have created or changed them, because the authority signs
the governance, and keys in a folder of another user are not secret. New folders have mode 0700.
"""

from __future__ import annotations

import os
import re
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from rosidl_py_gen.base import folder_trust
from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.errors import DefinitionError, InvalidNameError
from rosidl_py_gen.security.files import is_readable_by_others, link, locked, write_file
from rosidl_py_gen.security.policy import PolicyEnclave, governance_xml, permissions_xml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from datetime import datetime

    from cryptography.x509 import Certificate


_IDENTITY, _PERMISSIONS = "identity_ca", "permissions_ca"
_NOT_RULES = re.compile(r"<(validity|domains)>.*?</\1>", re.DOTALL)
"""Regular expression for the parts of a permissions file that may differ although the rules are equal."""
_LINKED_CERTIFICATES = f"{_IDENTITY}.cert.pem", f"{_PERMISSIONS}.cert.pem"
_ENCLAVE_FILES = ("key.pem", "cert.pem", "permissions.xml", "permissions.p7s", "governance.p7s", *_LINKED_CERTIFICATES)


@dataclass(frozen=True, slots=True)
class Keystore:
    """SROS2 keystore in the folder `root`: keys, certificates and policies of enclaves.

    The function `note` prints what the user should know, such as a private key that others can read.
    """

    root: Path
    note: Callable[[str], None]
    _noted: set[Path] = field(default_factory=set)

    @property
    def public(self) -> Path:
        return self.root / "public"

    @property
    def private(self) -> Path:
        return self.root / "private"

    @property
    def enclaves(self) -> Path:
        return self.root / "enclaves"

    def missing_files(self) -> list[Path]:
        """Return the files of authority and governance that a keystore requires and that do not exist."""
        required = [self._certificate(role) for role in (_PERMISSIONS, _IDENTITY)]
        required += [self._key(role) for role in (_PERMISSIONS, _IDENTITY)]
        return [path for path in (*required, self.enclaves / "governance.p7s") if not path.is_file()]

    def require(self) -> None:
        """Raise `CommandError` if a required file of the keystore is missing."""
        if missing := self.missing_files():
            raise CommandError(
                f"{self.root}: not a keystore: {missing[0].relative_to(self.root)} is missing; create one with "
                f"`rosidl-py security create_keystore {quote(str(self.root))}`"
            )

    def enclave_folder(self, name: str) -> Path:
        """Return the folder of an enclave, which need not exist; raises `CommandError` if a link leads elsewhere."""
        folder = self.enclaves.joinpath(*name.split("/"))
        if not folder.resolve().is_relative_to(self.enclaves.resolve()):
            raise CommandError(
                f"{folder}: a symbolic link leads to {folder.resolve()}, outside the keystore; remove the link"
            )
        return folder

    @contextmanager
    def changing(self, domain_id: int) -> Iterator[Keystore]:
        """Lock the keystore against other commands, and yield it to a block that creates enclaves or permissions.

        A note reports a governance without the domain. Raises `CommandError` if a required file is missing, or another
        user may have changed the files of the authority.
        """
        self.require()
        with locked(self.root):
            self._require_own()
            yield self
        self._note_if_ungoverned(domain_id)

    # ---------------------------------------------------------------------------------------------------------- owners

    def _require_own(self) -> None:
        """Raise `CommandError` if another user may have created or changed folders or files of the authority."""
        parent = self.root.absolute().parent
        if parent not in self._noted and (reason := folder_trust.distrust_reason(parent)):
            self._noted.add(parent)
            cure = "correct it, or move the keystore into a folder of the user"
            self.note(f"warning: {reason}: another user can replace the keystore; {cure}")
        folders = os.path.realpath(self.root), self.public, self.private, self.enclaves
        self._require_trusted(self.root, is_folder=False)
        self._require_trusted(*folders)
        files = (*self.public.glob("*"), *self.private.glob("*"), *self.enclaves.glob("governance.*"))
        self._require_trusted(*files, is_folder=False)

    def _require_own_enclave(self, name: str) -> None:
        """Raise `CommandError` if another user may have created or changed the folder of an enclave, or a folder above
        it.
        """
        folder = self.enclave_folder(name)
        above = [one for one in folder.parents if one.is_relative_to(self.enclaves)]
        self._require_trusted(*reversed(above), folder)
        self._require_trusted(*(folder / file for file in _ENCLAVE_FILES), is_folder=False)

    def _require_trusted(self, *paths: str | Path, is_folder: bool = True) -> None:
        for path in paths:
            if reason := folder_trust.part_reason(path, is_folder=is_folder, root=os.path.realpath(self.root)):
                raise CommandError(
                    f"{self.root}: {reason}; expected folders and files that no other user can have changed; correct "
                    "the owner and the mode, or choose another folder"
                )

    def _make_folder(self, folder: Path) -> None:
        """Create a folder with mode 0700 unless it exists; raises `CommandError` if another user has created it."""
        try:
            folder_trust.make_folder(folder)
        except OSError as error:
            raise CommandError(f"{folder}: cannot be created: {error.strerror or error}") from None
        self._require_trusted(os.path.realpath(folder) if folder == self.root else folder)

    def _close(self, folder: Path) -> None:
        """Remove the access permissions of other users to a folder."""
        if os.name != "nt" and folder.stat().st_mode & 0o077:
            folder.chmod(folder_trust.PRIVATE)

    # ------------------------------------------------------------------------------------------------------- creation

    def create(self, domain_id: int) -> datetime:
        """Create the missing files of the keystore, and return the end of validity of its certificate authority.

        Raises `CommandError` if the keystore is complete, or a file that cannot be recreated is missing.
        """
        self._make_folder(self.root)
        with locked(self.root):
            self._require_own()
            if not self.missing_files():
                raise CommandError(
                    f"{self.root}: a keystore exists already; choose another folder, or delete this one to make all "
                    "its keys invalid"
                )
            for folder in (self.public, self.enclaves, self.private):
                self._make_folder(folder)
            self._close(self.private)
            self._create_authority()
            self._create_governance(domain_id)
        return self._authority(_PERMISSIONS).not_valid_after_utc

    def _certificate(self, role: str) -> Path:
        return self.public / f"{role}.cert.pem"

    def _key(self, role: str) -> Path:
        return self.private / f"{role}.key.pem"

    def _create_authority(self) -> None:
        roles = [
            role
            for role in (_IDENTITY, _PERMISSIONS)
            if not (self._certificate(role).is_file() and self._key(role).is_file())
        ]
        for role in roles:
            for path, other in ((self._certificate(role), self._key(role)), (self._key(role), self._certificate(role))):
                if path.is_file() and not path.is_symlink():
                    raise self._incomplete(other, path)
        if roles:
            self._create_shared_authority()
        for role in roles:
            link(self._certificate(role), self._certificate("ca"))
            link(self._key(role), self._key("ca"))

    def _create_shared_authority(self) -> None:
        from rosidl_py_gen.security import certificates

        certificate_path, key_path = self._certificate("ca"), self._key("ca")
        if key_path.is_file():
            key = certificates.load_key(key_path)
            if certificate_path.is_file():
                self._require_matching(key_path, certificate_path)
                return
        elif certificate_path.is_file():
            raise self._incomplete(key_path, certificate_path)
        else:
            key = certificates.new_key()
            write_file(key_path, certificates.key_pem(key), is_private=True)
        write_file(certificate_path, certificates.certificate_pem(certificates.ca_certificate(key)))

    def _incomplete(self, missing: Path, other: Path) -> CommandError:
        return CommandError(
            f"{missing} is missing, but {other} exists; restore it, or delete {self.root} and create a keystore with "
            "new keys"
        )

    def _require_matching(self, key_path: Path, certificate_path: Path) -> None:
        from rosidl_py_gen.security import certificates

        if not certificates.is_key_of(certificates.load_key(key_path), certificates.load_certificate(certificate_path)):
            raise CommandError(f"{key_path} is not the key of {certificate_path}; restore the one that was replaced")

    def _create_governance(self, domain_id: int) -> None:
        document, signature = self.enclaves / "governance.xml", self.enclaves / "governance.p7s"
        if not document.is_file():
            write_file(document, governance_xml(domain_id).encode())
        if not signature.is_file():
            XmlElement.read(str(document))  # an edited file may be damaged
            self._sign(document.read_text(encoding="utf-8"), signature)

    def _sign(self, text: str, path: Path) -> None:
        from rosidl_py_gen.security import certificates

        certificate, key = self._authority(_PERMISSIONS), certificates.load_key(self._key(_PERMISSIONS))
        write_file(path, certificates.signed(text, certificate, key))

    def _authority(self, role: str) -> Certificate:
        """Return the certificate of an authority (`role`). Raises `CommandError` if certificate or key cannot sign."""
        from rosidl_py_gen.security import certificates

        path, key_path = self._certificate(role), self._key(role)
        certificate = certificates.load_certificate(path)
        self._require_matching(key_path, path)
        if certificates.is_expired(certificate):
            raise CommandError(f"{path}: the certificate has expired; create a keystore with new keys")
        self._note_if_readable(key_path)
        return certificate

    def _note_if_readable(self, path: Path) -> None:
        path = path.resolve()
        if path not in self._noted and is_readable_by_others(path):
            self._noted.add(path)
            self.note(f"warning: {path}: other users can read this private key; run `chmod 600 {quote(str(path))}`")

    # -------------------------------------------------------------------------------------------------------- enclaves

    def create_enclave(self, name: str) -> Certificate:
        """Create key, certificate and links of an enclave unless they exist, and return the certificate."""
        from rosidl_py_gen.security import certificates

        folder = self.enclave_folder(name)
        self._require_own_enclave(name)
        self._make_folder(folder)
        for linked in _LINKED_CERTIFICATES:
            link(folder / linked, self.public / linked)
        if folder != self.enclaves:
            link(folder / "governance.p7s", self.enclaves / "governance.p7s")
        certificate_path, key_path = folder / "cert.pem", folder / "key.pem"
        if certificate_path.is_file() and key_path.is_file():
            self._require_own_files(folder)
            return self.enclave_certificate(name)
        authority, key = self._authority(_IDENTITY), certificates.new_key()
        authority_key = certificates.load_key(self._key(_IDENTITY))
        certificate = certificates.enclave_certificate(name, key, authority, authority_key)
        certificate_path.unlink(missing_ok=True)  # an interrupted command must not leave one of another key
        write_file(key_path, certificates.key_pem(key), is_private=True)
        write_file(certificate_path, certificates.certificate_pem(certificate))
        return certificate

    def _require_own_files(self, folder: Path) -> None:
        self._note_if_readable(folder / "key.pem")
        self._require_matching(folder / "key.pem", folder / "cert.pem")

    def enclave_certificate(self, name: str) -> Certificate:
        """Return the certificate of an existing enclave. Raises `CommandError` if nodes would refuse it."""
        from rosidl_py_gen.security import certificates

        path = self.enclave_folder(name) / "cert.pem"
        self._require_own_enclave(name)
        if not path.is_file():
            raise CommandError(
                f"{path}: enclave {name} has no certificate; create it with `rosidl-py security create_enclave "
                f"{quote(str(self.root))} {name}`"
            )
        certificate = certificates.load_certificate(path)
        cure = f"delete {path} and key.pem next to it, and create the enclave again"
        if not certificates.has_common_name(certificate, name):
            subject = certificate.subject.rfc4514_string()
            raise CommandError(f"{path}: got the subject {subject!r:.200}; expected 'CN={name}'; {cure}")
        if not certificates.is_issued_by(certificate, certificates.load_certificate(self._certificate(_IDENTITY))):
            raise CommandError(f"{path}: not issued by {self._certificate(_IDENTITY)}; {cure}")
        if certificates.is_expired(certificate):
            raise CommandError(f"{path}: the certificate has expired; {cure}")
        return certificate

    def write_permissions(self, enclave: PolicyEnclave, certificate: Certificate, domain_id: int) -> Path:
        """Write and sign the permissions of an enclave, and return the path of permissions.xml."""
        folder = self.enclave_folder(enclave.name)
        text = permissions_xml(enclave, domain_id, certificate.not_valid_before_utc, certificate.not_valid_after_utc)
        if enclave.allows_everything and self._have_changed(folder / "permissions.xml", text):
            self.note(f"{folder / 'permissions.xml'}: replaced; enclave {enclave.name} may use all topics")
        # In this order an interrupted command leaves the former permissions valid.
        write_file(folder / "permissions.xml", text.encode())
        self._sign(text, folder / "permissions.p7s")
        return folder / "permissions.xml"

    def _have_changed(self, path: Path, text: str) -> bool:
        """Return True if a file of permissions exists and has other rules than a new text."""
        try:
            former = path.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            return False
        return _NOT_RULES.sub("", former).split() != _NOT_RULES.sub("", text).split()

    def _note_if_ungoverned(self, domain_id: int) -> None:
        """Print a note if the governance lacks a domain, in which nodes then cannot start."""
        path = self.enclaves / "governance.xml"
        try:
            root = XmlElement.read(str(path))
        except DefinitionError:  # a keystore that is not made here needs no governance.xml
            return
        rules = [rule for rules in root.elements for rule in rules.elements]
        elements = [element for rule in rules for element in rule.elements if element.tag == "domains"]
        domains = [domain for element in elements for domain in element.elements]
        if domains and not any(_has_domain(one, domain_id) for one in domains):
            self.note(
                f"warning: {path} does not have domain {domain_id} of ROS_DOMAIN_ID, so nodes in this domain cannot "
                "start; correct the file, delete governance.p7s, and repeat `rosidl-py security create_keystore "
                f"{quote(str(self.root))}`"
            )

    def list_enclaves(self) -> list[str]:
        """Return the sorted names of the enclaves; a note reports folders whose names are invalid."""
        names = []
        for folder, folders, files in os.walk(self.enclaves):
            folders.sort()
            if "key.pem" not in files:
                continue
            relative = os.path.relpath(folder, self.enclaves).replace(os.sep, "/")
            name = "/" if relative == "." else f"/{relative}"
            try:
                PolicyEnclave.check_name(name)
            except InvalidNameError as error:
                self.note(f"skipped {folder}: {str(error).partition(chr(10))[0]}")
            else:
                names.append(name)
        return sorted(names)


def _has_domain(element: XmlElement, domain_id: int) -> bool:
    """Return True if an ``<id>`` or ``<id_range>`` element of a governance contains the domain."""

    def number(text: str, default: int) -> int:
        return int(text) if text.strip().isdecimal() else default

    if element.tag == "id":
        return number(element.text, -1) == domain_id
    bounds = {child.tag: child.text for child in element.elements}
    return number(bounds.get("min", ""), 0) <= domain_id <= number(bounds.get("max", ""), 1 << 32)
