"""Keystores and permissions compared with keystores of SROS2; keystores damaged or prepared by other users."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta, timezone
from email import message_from_bytes
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import click
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.hazmat.primitives.serialization import pkcs7
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.ros_cli.security import create_permission
from rosidl_py_gen.security import certificates
from rosidl_py_gen.security.policy import PolicyEnclave, PolicyRule, expand_name, permissions_xml

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Run = Callable[..., str]


VALIDITY = re.compile(r"<(not_before|not_after)>(.+?)<")


def described(path: Path) -> Any:
    """Return the contents that interchangeable keystores have in common, without random numbers and times."""
    if path.is_symlink():
        return os.readlink(path)
    data = path.read_bytes()
    if path.name.endswith("cert.pem"):
        certificate = x509.load_pem_x509_certificate(data)
        assert isinstance(certificate.signature_hash_algorithm, hashes.SHA256)
        return (
            certificate.version,
            certificate.subject.rfc4514_string(),
            certificate.issuer.rfc4514_string(),
            [(one.oid.dotted_string, one.critical, one.value) for one in certificate.extensions],
            certificate.not_valid_after_utc - certificate.not_valid_before_utc,
        )
    if path.suffix == ".pem":
        assert data.startswith(b"-----BEGIN PRIVATE KEY-----\n")
        key = serialization.load_pem_private_key(data, None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        return key.curve.name
    if path.suffix == ".p7s":
        message = message_from_bytes(data)
        document, signature = message.get_payload()
        kinds = message.get_content_type(), message["micalg"], signature.get_content_type()
        return (*kinds, plain(document.get_payload()))
    return plain(data.decode())


def plain(text: str) -> list[str]:
    return VALIDITY.sub(r"<\1><", text).split()


def files(root: Path) -> dict[str, Any]:
    found = (path for path in sorted(root.rglob("*")) if path.is_symlink() or path.is_file())
    return {str(path.relative_to(root)): described(path) for path in found}


def create_like_sros2(root: Path, succeed: Run) -> None:
    succeed("create_keystore", str(root))
    for name in ("/", "/talker", "/listener", "/robot/arm"):
        succeed("create_enclave", str(root), name)


def test_new_keystore_equals_keystore_made_by_sros2(tmp_path: Path, sros2_keystore: Path, succeed: Run) -> None:
    create_like_sros2(tmp_path / "made", succeed)
    assert files(tmp_path / "made") == files(sros2_keystore)


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_private_keys_are_never_readable_by_other_users(tmp_path: Path, monkeypatch: Any, succeed: Run) -> None:
    """The data is written to files that were opened with mode 0600."""
    modes, fsync = set[int](), os.fsync
    monkeypatch.setattr(os, "fsync", lambda file: (modes.add(stat.S_IMODE(os.fstat(file).st_mode)), fsync(file)))
    umask = os.umask(0)
    try:
        create_like_sros2(tmp_path / "made", succeed)
    finally:
        os.umask(umask)
    assert modes == {0o600}
    for path in (tmp_path / "made").rglob("*"):
        mode = stat.S_IMODE(path.stat().st_mode)
        assert mode == (0o600 if path.name.endswith("key.pem") else 0o700 if path.is_dir() else 0o644), path
        assert not path.name.startswith(".new-")


def test_signatures_verify_and_permissions_have_validity_of_certificate(keystore: Path, succeed: Run) -> None:
    succeed("create_enclave", str(keystore), "/robot/arm")
    folder = keystore / "enclaves/robot/arm"
    certificate = x509.load_pem_x509_certificate((folder / "cert.pem").read_bytes())
    certificate.verify_directly_issued_by(
        x509.load_pem_x509_certificate((folder / "identity_ca.cert.pem").read_bytes())
    )
    assert abs(certificate.not_valid_before_utc - datetime.now(timezone.utc) + timedelta(days=1)) < timedelta(minutes=5)
    assert dict(VALIDITY.findall((folder / "permissions.xml").read_text())) == {
        "not_before": certificate.not_valid_before_utc.replace(tzinfo=None).isoformat(),
        "not_after": certificate.not_valid_after_utc.replace(tzinfo=None).isoformat(),
    }
    if shutil.which("openssl") is None:
        pytest.skip("needs the program openssl")
    for name, document in (
        ("permissions", folder / "permissions.xml"),
        ("governance", folder / "../../governance.xml"),
    ):
        words = ["openssl", "smime", "-verify", "-text", "-in", f"{name}.p7s", "-CAfile", "permissions_ca.cert.pem"]
        done = subprocess.run([*words, "-purpose", "any"], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert done.stdout.replace("\r", "").split() == document.read_text().split()


def signed_with(path: Path, ca: x509.Certificate) -> None:
    part = message_from_bytes(path.read_bytes()).get_payload()[1]
    found = pkcs7.load_der_pkcs7_certificates(base64.b64decode(part.get_payload()))
    assert found == [ca]


def test_commands_extend_keystore_made_by_sros2(
    sros2_keystore: Path, golden: Path, succeed: Run, run_here: Any
) -> None:
    assert succeed("list_enclaves", str(sros2_keystore)).split() == ["/", "/listener", "/robot/arm", "/talker"]
    code, out, err = run_here("security", "create_enclave", str(sros2_keystore), "/new")
    key = (sros2_keystore / "private/identity_ca.key.pem").resolve()
    assert code == 0 and "created enclave /new" in out
    assert err == f"warning: {key}: other users can read this private key; run `chmod 600 {key}`\n"
    for path in sros2_keystore.rglob("*key.pem"):
        path.chmod(0o600)
    succeed("create_enclave", str(sros2_keystore), "/new")
    policy = str(golden / "policies/fleet.xml")
    code, out, err = run_here("security", "create_permission", str(sros2_keystore), "/", policy)
    assert (code, err) == (0, "") and "wrote and signed" in out
    ca = x509.load_pem_x509_certificate((sros2_keystore / "public/ca.cert.pem").read_bytes())
    x509.load_pem_x509_certificate((sros2_keystore / "enclaves/new/cert.pem").read_bytes()).verify_directly_issued_by(
        ca
    )


def test_governance_and_permissions_use_ros_domain_id(
    tmp_path: Path, monkeypatch: Any, fail: Run, run_here: Any
) -> None:
    root = tmp_path / "keystore"
    monkeypatch.setenv("ROS_DOMAIN_ID", "233")
    assert "ROS_DOMAIN_ID must be a whole number from 0 to 232" in fail("create_keystore", str(root))
    assert not root.exists()
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert run_here("security", "create_keystore", str(root))[0] == 0
    assert "<id>42</id>" in (root / "enclaves/governance.xml").read_text()
    monkeypatch.setenv("ROS_DOMAIN_ID", "43")
    code, _, err = run_here("security", "create_enclave", str(root), "/a")
    assert code == 0
    assert "governance.xml does not have domain 43 of ROS_DOMAIN_ID, so nodes in this domain cannot start" in err
    assert (root / "enclaves/a/permissions.xml").read_text().count("<id>43</id>") == 2
    governance = root / "enclaves/governance.xml"
    governance.write_text(governance.read_text().replace("<id>42</id>", "<id_range><min>40</min></id_range>"))
    (root / "enclaves/governance.p7s").unlink()
    assert run_here("security", "create_keystore", str(root))[0] == 0
    assert b"<id_range>" in (root / "enclaves/governance.p7s").read_bytes()
    assert run_here("security", "create_enclave", str(root), "/b")[::2] == (0, "")


def test_each_command_prints_its_result_as_json(tmp_path: Path, golden: Path, succeed: Run) -> None:
    root = str(tmp_path / "keystore")
    made = json.loads(succeed("create_keystore", root, "--json"))
    assert made.items() >= {"keystore": root, "domain_id": 0}.items()
    made = json.loads(succeed("create_enclave", root, "/two_grants", "--json"))
    assert made.items() >= {"enclave": "/two_grants", "folder": f"{root}/enclaves/two_grants"}.items()
    assert datetime.fromisoformat(made["valid_until"]) > datetime.now(timezone.utc)
    policy = str(golden / "policies/two_grants.xml")
    made = json.loads(succeed("create_permission", root, "/two_grants", policy, "--json"))
    assert made["permissions"] == f"{root}/enclaves/two_grants/permissions.xml"
    rows = [{"name": "/two_grants", "folder": f"{root}/enclaves/two_grants"}]
    assert json.loads(succeed("list_enclaves", root, "--json")) == rows
    rows = [{"name": "/other", "folder": f"{root}/enclaves/other"}]
    assert json.loads(succeed("generate_artifacts", "-k", root, "-e", "/other", "--json")) == rows


# ---------------------------------------------------------------------------------------------- repeated and incomplete


def test_create_keystore_refuses_existing_keystore(keystore: Path, fail: Run) -> None:
    before = (keystore / "private/ca.key.pem").read_bytes()
    assert "a keystore exists already; choose another folder" in fail("create_keystore", str(keystore))
    assert (keystore / "private/ca.key.pem").read_bytes() == before


@pytest.mark.parametrize("lost", ["key.pem", "cert.pem", None])
def test_repeated_create_enclave_keeps_files_unless_key_or_certificate_is_missing(
    keystore: Path, succeed: Run, lost: str | None
) -> None:
    folder, names = keystore / "enclaves/a", ("key.pem", "cert.pem", "permissions.xml")
    succeed("create_enclave", str(keystore), "/a")
    before = [(folder / name).read_bytes() for name in names]
    if lost is not None:
        (folder / lost).unlink()
    for _ in range(2):
        succeed("create_enclave", str(keystore), "/a")
    assert ([(folder / name).read_bytes() for name in names] == before) == (lost is None)


@pytest.mark.parametrize(
    "lost",
    [
        *("public/permissions_ca.cert.pem", "private/identity_ca.key.pem", "public/ca.cert.pem"),
        "public/identity_ca.cert.pem private/permissions_ca.key.pem",
        *("enclaves/governance.p7s", "enclaves/governance.xml enclaves/governance.p7s"),
    ],
)
def test_create_keystore_completes_incomplete_keystore_without_replacing_ca_key(
    keystore: Path, succeed: Run, fail: Run, lost: str
) -> None:
    succeed("create_enclave", str(keystore), "/a")
    key = (keystore / "private/ca.key.pem").read_bytes()
    for name in lost.split():
        (keystore / name).unlink()
    assert "not a keystore: " in fail("create_enclave", str(keystore), "/b")
    succeed("create_keystore", str(keystore))
    assert (keystore / "private/ca.key.pem").read_bytes() == key
    succeed("create_enclave", str(keystore), "/a")
    succeed("create_enclave", str(keystore), "/b")


@pytest.mark.parametrize("separate", [False, True])
def test_missing_ca_key_is_an_error_and_is_not_replaced(keystore: Path, fail: Run, separate: bool) -> None:
    """A new authority would make all certificates of the enclaves invalid."""
    lost = "private/ca.key.pem"
    if separate:
        lost = "private/permissions_ca.key.pem"
        certificate = keystore / "public/permissions_ca.cert.pem"
        data = certificate.read_bytes()
        certificate.unlink()
        certificate.write_bytes(data)
    (keystore / lost).unlink()
    error = fail("create_keystore", str(keystore))
    assert f"{lost} is missing, but {keystore}/public/" in error and "restore it, or delete" in error
    assert "is missing; create one with `rosidl-py security create_keystore" in fail("list_enclaves", str(keystore))


def test_identity_and_permissions_authorities_may_differ(keystore: Path, succeed: Run) -> None:
    key = certificates.new_key()
    for path, data in (
        (keystore / "private/permissions_ca.key.pem", certificates.key_pem(key)),
        (keystore / "public/permissions_ca.cert.pem", certificates.certificate_pem(certificates.ca_certificate(key))),
    ):
        path.unlink()
        path.write_bytes(data)
        path.chmod(0o600)
    (keystore / "enclaves/governance.p7s").unlink()
    succeed("create_keystore", str(keystore))
    succeed("create_enclave", str(keystore), "/a")
    folder = keystore / "enclaves/a"
    ca = x509.load_pem_x509_certificate((folder / "permissions_ca.cert.pem").read_bytes())
    signed_with(folder / "permissions.p7s", ca)
    identity = x509.load_pem_x509_certificate((folder / "identity_ca.cert.pem").read_bytes())
    x509.load_pem_x509_certificate((folder / "cert.pem").read_bytes()).verify_directly_issued_by(identity)
    assert identity != ca


def test_enclave_certificate_not_matching_name_issuer_or_key_is_refused(
    keystore: Path, succeed: Run, fail: Run
) -> None:
    succeed("create_enclave", str(keystore), "/a")
    path = keystore / "enclaves/a/cert.pem"
    key, new = certificates.load_key(keystore / "enclaves/a/key.pem"), certificates.new_key()
    ca = certificates.load_certificate(keystore / "public/ca.cert.pem")
    ca_key = certificates.load_key(keystore / "private/ca.key.pem")
    make = certificates.enclave_certificate
    for made, reason in (
        (certificates.ca_certificate(key), "got the subject 'CN=sros2CA'; expected 'CN=/a'"),
        (make("/a", key, certificates.ca_certificate(new), new), "not issued by"),
        (make("/a", new, ca, ca_key), "is not the key of"),
    ):
        path.write_bytes(certificates.certificate_pem(made))
        assert reason in fail("create_enclave", str(keystore), "/a")
    path.write_bytes(certificates.certificate_pem(make("/a", key, ca, ca_key)))
    succeed("create_enclave", str(keystore), "/a")


def test_expired_certificates_are_refused(
    keystore: Path, monkeypatch: Any, succeed: Run, fail: Run, tmp_path: Path
) -> None:
    monkeypatch.setattr(certificates, "VALIDITY", timedelta(seconds=-10))
    succeed("create_enclave", str(keystore), "/a")
    error = fail("create_enclave", str(keystore), "/a")
    assert "cert.pem: the certificate has expired; delete" in error and "create the enclave again" in error
    root = str(tmp_path / "old")
    assert "ca.cert.pem: the certificate has expired; create a keystore with new keys" in fail("create_keystore", root)


def test_create_enclave_reports_replaced_permissions(keystore: Path, golden: Path, succeed: Run, run_here: Any) -> None:
    succeed("create_enclave", str(keystore), "/two_grants")
    succeed("create_permission", str(keystore), "/two_grants", str(golden / "policies/two_grants.xml"))
    code, _, err = run_here("security", "create_enclave", str(keystore), "/two_grants")
    assert code == 0
    assert err.endswith("/permissions.xml: replaced; enclave /two_grants may use all topics\n")


@pytest.mark.parametrize("step", range(12))
def test_an_interrupted_command_can_be_repeated(tmp_path: Path, monkeypatch: Any, run_here: Any, step: int) -> None:
    """The command is interrupted before its n-th file, and repeated until it succeeds."""
    replace, count = os.replace, 0

    def interrupted(source: str, target: Path) -> None:
        nonlocal count
        count += 1
        if count == step + 1:
            raise KeyboardInterrupt
        replace(source, target)

    root = tmp_path / "keystore"
    words = "security", "generate_artifacts", "-k", str(root), "-e", "/a", "/"
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", interrupted)
        assert run_here(*words)[0] == 130
    assert not [*root.rglob(".new-*")]
    assert run_here(*words)[0] == 0
    before = files(root)
    assert run_here(*words)[::2] == (0, "")
    assert files(root) == before
    for name in ("a", ""):
        folder = root / "enclaves" / name
        certificate = certificates.load_certificate(folder / "cert.pem")
        assert certificates.is_key_of(certificates.load_key(folder / "key.pem"), certificate)
        assert certificates.is_issued_by(certificate, certificates.load_certificate(folder / "identity_ca.cert.pem"))
        signed_with(folder / "permissions.p7s", certificates.load_certificate(folder / "permissions_ca.cert.pem"))


_NAMES = "a // /a/ /a//b /.. /../../outside /a/../../outside /./a /.new-x /<a> /a&b /a,CN=/b /a* /1a /a/1 ~ /~a /{x}"
NAMES = [
    *_NAMES.split(),
    *("", "/a b", "/a\nb", "/a\n", "/a\x1b[31m", "/a\x00b", '/a"&amp;', "/\u00e9", "C:\\a", "/governance.p7s"),
    *("/" + "a" * 64, "/" + "a/" * 200 + "a"),
]


def tree(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*")}


@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_commands_refuse_invalid_enclave_names(keystore: Path, fail: Run, tmp_path: Path, name: str) -> None:
    before = tree(tmp_path)
    for words in (
        ("create_enclave", str(keystore), name),
        ("create_permission", str(keystore), name, "policy.xml"),
        ("generate_artifacts", "-k", str(keystore), "-e", name),
    ):
        error = fail(*words)
        assert "invalid enclave name " in error
        assert len(error.split("\n    ")) in (1, 3) and "\x1b" not in error and "\x00" not in error
    assert tree(tmp_path) == before


def test_enclave_name_longer_than_64_characters_is_refused(keystore: Path, succeed: Run, fail: Run) -> None:
    succeed("create_enclave", str(keystore), "/" + "a" * 63)
    error = fail("create_enclave", str(keystore), "/" + "a" * 64)
    assert "has 65 characters; the common name of a certificate has at most 64" in error


@pytest.mark.skipif(os.name == "nt", reason="symbolic links of POSIX")
def test_enclave_folder_links_leading_outside_keystore_are_refused(
    keystore: Path, succeed: Run, fail: Run, tmp_path: Path
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (keystore / "enclaves/a").symlink_to("../../outside")
    (keystore / "enclaves/b").symlink_to("../../missing")
    for name in ("/a", "/a/deep", "/b", "/b/deep"):
        error = fail("create_enclave", str(keystore), name)
        assert "a symbolic link leads to " in error and "outside the keystore; remove the link" in error
    assert not [*outside.iterdir()] and not (tmp_path / "missing").exists()
    (outside / "key.pem").write_text("x")
    assert succeed("list_enclaves", str(keystore)) == ""


@pytest.mark.skipif(os.name == "nt", reason="symbolic links of POSIX")
@pytest.mark.parametrize("dangling", [True, False])
def test_file_links_in_enclave_are_replaced_and_targets_are_untouched(
    keystore: Path, tmp_path: Path, run_here: Any, dangling: bool
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    folder = keystore / "enclaves/a"
    folder.mkdir()
    for name in ("key.pem", "permissions.xml", "permissions.p7s", "governance.p7s"):
        if not dangling:
            (outside / name).write_text("untouched")
        (folder / name).symlink_to(f"../../../outside/{name}")
    code, _, err = run_here("security", "create_enclave", str(keystore), "/a")
    assert code == 0 and err.count("\n") == (not dangling)  # the permissions were others
    if dangling:
        assert not [*outside.iterdir()]
    else:
        assert {path.read_text() for path in outside.iterdir()} == {"untouched"}
    assert not (folder / "key.pem").is_symlink() and (folder / "key.pem").stat().st_mode & 0o777 == 0o600


def test_folder_instead_of_enclave_file_is_an_error(keystore: Path, fail: Run) -> None:
    for name in ("key.pem", "governance.p7s", "permissions.xml"):
        folder = keystore / "enclaves" / name.partition(".")[0]
        (folder / name).mkdir(parents=True)
        error = fail("create_enclave", str(keystore), f"/{folder.name}")
        assert f"{folder / name}" in error and "directory" in error.lower()
    assert not [*keystore.rglob(".new-*")]


def test_file_instead_of_keystore_or_enclave_folder_is_an_error(
    keystore: Path, tmp_path: Path, fail: Run, run_here: Any
) -> None:
    (keystore / "enclaves/a").write_text("")
    assert "enclaves/a" in fail("create_enclave", str(keystore), "/a")
    assert "enclaves/a" in fail("create_enclave", str(keystore), "/a/b")
    code, _, err = run_here("security", "create_keystore", str(keystore / "enclaves/a"))
    assert code == 2 and "is a file" in err
    assert "Not a directory" in fail("create_keystore", str(keystore / "enclaves/a/b"))


def _pem(kind: str) -> bytes:
    return f"-----BEGIN {kind}-----\nAAAA\n-----END {kind}-----\n".encode()


def test_unusable_ca_key_or_certificate_is_an_error(keystore: Path, fail: Run) -> None:
    form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    encrypted = certificates.new_key().private_bytes(*form, serialization.BestAvailableEncryption(b"word"))
    foreign = ed25519.Ed25519PrivateKey.generate().private_bytes(*form, serialization.NoEncryption())
    certificate, key = keystore / "public/ca.cert.pem", keystore / "private/ca.key.pem"
    for path, data, reason in (
        *((key, data, "not a private key; expected PEM") for data in (b"", b"text", _pem("PRIVATE KEY"))),
        (key, encrypted, "the private key has a password; expected one without"),
        (key, foreign, "got a key of another kind; DDS Security needs"),
        (key, certificates.key_pem(certificates.new_key()), "is not the key of "),
        *((certificate, data, "not a certificate: ") for data in (b"", b"text", _pem("CERTIFICATE"))),
    ):
        path.write_bytes(data)
        assert reason in fail("create_enclave", str(keystore), "/a"), data


def test_private_keys_are_never_printed(keystore: Path, run_here: Any, golden: Path) -> None:
    root = str(keystore)
    texts = []
    for words in (
        ("create_enclave", root, "/a"),
        ("create_enclave", root, "/a", "--json"),
        ("list_enclaves", root, "--json"),
        ("create_permission", root, "/a", str(golden / "policies/fleet.xml")),
        ("create_permission", root, "/a", str(keystore / "private/ca.key.pem")),
        ("create_permission", root, "/a", str(keystore / "enclaves/a/key.pem")),
        ("generate_artifacts", "-k", root, "-e", "/b"),
    ):
        _, out, err = run_here("security", *words)
        texts.append(out + err)
    secrets = [line for path in keystore.rglob("*key.pem") for line in path.read_text().splitlines()[1:-1]]
    assert len(secrets) > 5
    assert not [line for line in secrets for text in texts if line in text]


def test_list_enclaves_skips_folders_with_invalid_names(keystore: Path, run_here: Any) -> None:
    for name in ("good", "a b", "new\nline", "esc\x1b[31m", "1digit"):
        (keystore / "enclaves" / name).mkdir()
        (keystore / "enclaves" / name / "key.pem").touch()
    code, out, err = run_here("security", "list_enclaves", str(keystore))
    assert (code, out) == (0, "/good\n")
    assert err.count("skipped ") == 4 == err.count("\n") and "\x1b" not in err


def test_malformed_governance_is_reported_with_line(keystore: Path, fail: Run) -> None:
    (keystore / "enclaves/governance.xml").write_text("<dds>\n<domain_access_rules></dds>")
    (keystore / "enclaves/governance.p7s").unlink()
    assert "governance.xml:2:24: not XML: mismatched tag" in fail("create_keystore", str(keystore))


@pytest.fixture
def readable_keystore(keystore: Path, succeed: Run) -> Iterator[Path]:
    """A keystore in a folder that other users can enter; they can read everything in it."""
    succeed("create_enclave", str(keystore), "/a")
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        root = Path(folder) / "keystore"
        shutil.copytree(keystore, root, symlinks=True)
        for path in (root, *root.rglob("*")):
            if not path.is_symlink():
                path.chmod(0o755 if path.is_dir() else 0o644)
        yield root


@pytest.mark.skipif(os.name == "nt" or os.geteuid() != 0, reason="root may become another user")
@pytest.mark.parametrize(
    "words", ["create_keystore {root}/new", "create_enclave {root} /new", "create_enclave {root} /a"]
)
def test_read_only_keystore_fails_with_permission_denied_and_is_unchanged(
    readable_keystore: Path, run_here: Any, words: str
) -> None:
    before = tree(readable_keystore)
    os.seteuid(65534)
    try:
        code, out, err = run_here("security", *words.format(root=readable_keystore).split())
    finally:
        os.seteuid(0)
    assert (code, out) == (1, "") and "Permission denied" in err.splitlines()[-1], err
    assert tree(readable_keystore) == before


LAX = 0o777, 0o757, 0o707, 0o1777
"""Modes with which other users can write."""
needs_modes = pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
needs_root = pytest.mark.skipif(os.name == "nt" or os.geteuid() != 0, reason="only root can change owners")


@needs_modes
@pytest.mark.parametrize("mask", [0, 0o022, 0o077, 0o777])
def test_keystore_folders_are_private_with_any_umask(tmp_path: Path, mask: int, succeed: Run) -> None:
    umask = os.umask(mask)
    try:
        create_like_sros2(tmp_path / "new/made", succeed)
        succeed("create_enclave", str(tmp_path / "new/made"), "/robot/hand")
    finally:
        os.umask(umask)
    modes = {stat.S_IMODE(one.stat().st_mode) for one in (tmp_path / "new").rglob("*") if one.is_dir()}
    assert modes == {0o700}
    keys = [*(tmp_path / "new").rglob("key.pem"), *(tmp_path / "new").rglob("*.xml")]
    assert all(stat.S_IMODE(one.stat().st_mode) & 0o622 == 0o600 for one in keys)


def planted_folder(root: Path, name: str) -> Path:
    """Return a folder of a keystore that does not exist yet."""
    (root / name).mkdir(parents=True, mode=0o755)
    return root / name


@needs_modes
@pytest.mark.parametrize("mode", LAX)
@pytest.mark.parametrize("name", [".", "public", "private", "enclaves"])
def test_create_keystore_refuses_folders_that_other_users_can_write(
    tmp_path: Path, name: str, mode: int, fail: Run
) -> None:
    folder = planted_folder(tmp_path / "new", name)
    folder.chmod(mode)
    error = fail("create_keystore", str(tmp_path / "new"))
    assert f"other users can write into {folder} (mode {mode:04o}); expected" in error and error.count("\n") == 1
    assert not [one for one in (tmp_path / "new").rglob("*") if one.is_file()]


@needs_modes
@pytest.mark.parametrize("name", ["public", "private", "enclaves"])
def test_create_keystore_refuses_links_instead_of_folders(tmp_path: Path, name: str, fail: Run) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / name).symlink_to(tmp_path / "elsewhere")
    assert f"{tmp_path / 'new' / name} is a symbolic link" in fail("create_keystore", str(tmp_path / "new"))
    assert not [*(tmp_path / "elsewhere").iterdir()]


@needs_modes
@pytest.mark.parametrize("name", ["enclaves/governance.xml", "private/ca.key.pem", "public/ca.cert.pem"])
def test_create_keystore_refuses_existing_files_that_other_users_can_write(
    tmp_path: Path, name: str, keystore: Path, fail: Run
) -> None:
    place = planted_folder(tmp_path / "new", os.path.dirname(name)) / os.path.basename(name)
    shutil.copy(keystore / name, place)
    place.chmod(0o666)
    error = fail("create_keystore", str(tmp_path / "new"))
    assert f"other users can write into {place} (mode 0666)" in error
    assert not [*(tmp_path / "new").rglob("*.p7s")]


@needs_modes
def test_create_keystore_makes_existing_private_folder_accessible_to_owner_only(tmp_path: Path, succeed: Run) -> None:
    folder = planted_folder(tmp_path / "new", "private")
    succeed("create_keystore", str(tmp_path / "new"))
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


CHANGING = "create_enclave {} /a", "create_permission {} /a {}", "generate_artifacts -k {} -e /a"


@needs_modes
@pytest.mark.parametrize("words", CHANGING)
@pytest.mark.parametrize(
    "name",
    [".", "public", "private", "private/ca.key.pem", "enclaves", "enclaves/governance.p7s", "enclaves/a/key.pem"],
)
def test_no_command_writes_into_a_keystore_that_other_users_can_write(
    name: str, words: str, tmp_path: Path, keystore: Path, succeed: Run, fail: Run
) -> None:
    succeed("create_enclave", str(keystore), "/a")
    policy = tmp_path / "policy.xml"
    policy.write_text(
        '<policy version="0.2.0"><enclaves><enclave path="/a"><profiles><profile node="a" ns="/"/></profiles>'
        "</enclave></enclaves></policy>"
    )
    command = words.format(keystore, policy).split()
    succeed(*command)
    before = tree(keystore)
    (keystore / name).chmod(0o777)
    assert f"other users can write into {keystore / name} " in fail(*command)
    assert tree(keystore) == before


@needs_modes
@pytest.mark.parametrize("name", ["a", "a/b"])
def test_no_enclave_is_created_below_a_writable_folder_or_a_link(
    name: str, keystore: Path, tmp_path: Path, fail: Run
) -> None:
    folder = planted_folder(keystore / "enclaves", name)
    folder.chmod(0o777)
    assert f"other users can write into {folder} " in fail("create_enclave", str(keystore), "/a/b/c")
    folder.rmdir()
    planted_folder(keystore / "enclaves", "other")
    folder.symlink_to(keystore / "enclaves/other")
    assert f"{folder} is a symbolic link" in fail("create_enclave", str(keystore), "/a/b/c")
    assert not [*(keystore / "enclaves/other").iterdir()]


@needs_modes
def test_a_keystore_in_a_folder_that_other_users_can_write_is_a_warning(tmp_path: Path, run_here: Any) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    code, _, err = run_here("security", "generate_artifacts", "-k", str(tmp_path / "open/keystore"), "-e", "/a")
    text = f"warning: other users can write into {tmp_path / 'open'} (mode 0777): another user can replace the keystore"
    assert code == 0 and text in err


@needs_root
@pytest.mark.parametrize("name", [".", "public", "private", "enclaves", "enclaves/governance.xml"])
def test_create_keystore_refuses_files_and_folders_of_another_user(
    tmp_path: Path, name: str, keystore: Path, fail: Run
) -> None:
    if name.endswith(".xml"):
        place = planted_folder(tmp_path / "new", "enclaves") / "governance.xml"
        shutil.copy(keystore / name, place)
    else:
        place = planted_folder(tmp_path / "new", name)
    os.chown(place, 65534, 65534)
    assert f"{place} belongs to user " in fail("create_keystore", str(tmp_path / "new"))


@needs_root
def test_create_keystore_refuses_link_of_another_user(tmp_path: Path, fail: Run) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "own")
    os.lchown(tmp_path / "link", 65534, 65534)
    assert "is a link of user " in fail("create_keystore", str(tmp_path / "link"))
    assert not [*(tmp_path / "own").iterdir()]


@needs_root
@pytest.mark.parametrize("name", ["a", "a/key.pem", "a/cert.pem", "a/permissions.xml"])
def test_create_enclave_refuses_existing_files_of_another_user(
    name: str, keystore: Path, succeed: Run, fail: Run
) -> None:
    succeed("create_enclave", str(keystore), "/a")
    os.chown(keystore / "enclaves" / name, 65534, 65534)
    assert f"{keystore / 'enclaves' / name} belongs to user " in fail("create_enclave", str(keystore), "/a")


@needs_root
def test_root_does_not_change_keystore_of_another_user(tmp_path: Path, run_here: Any, fail: Run) -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.chown(folder, 65534, 65534)
        os.seteuid(65534)
        try:
            assert run_here("security", "create_keystore", f"{folder}/keystore")[0] == 0
        finally:
            os.seteuid(0)
        assert f"{folder}/keystore belongs to user " in fail("create_enclave", f"{folder}/keystore", "/a")


def test_concurrent_create_enclave_commands_make_one_consistent_enclave(keystore: Path) -> None:
    def create(_: int) -> None:
        command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "security", "create_enclave", str(keystore), "/a"]
        subprocess.run(command, check=True, capture_output=True)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(create, range(4)))
    folder = keystore / "enclaves/a"
    key, certificate = (certificates.load_key(folder / "key.pem"), certificates.load_certificate(folder / "cert.pem"))
    assert certificates.is_key_of(key, certificate)
    assert not [*keystore.rglob(".new-*")]


ENCLAVES = "/fleet/camera", "/fleet/planner", "/two_grants", "/idle", "/"


def without_times(path: Path) -> str:
    return VALIDITY.sub(r"<\1><", path.read_text())


def test_generate_artifacts_creates_keystore_enclaves_and_permissions(
    tmp_path: Path, golden: Path, monkeypatch: Any, run_here: Any
) -> None:
    root = tmp_path / "deep/keystore"
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(root))
    words = ["-e", "/extra", "/idle", "-p", str(golden / "policies/fleet.xml")]
    code, out, err = run_here("security", "generate_artifacts", *words)
    assert (code, err) == (0, f"created keystore {root} for domain 0\n")
    assert out.split() == ["/extra", "/idle", "/fleet/camera", "/fleet/planner", "/two_grants", "/"]
    for name in ENCLAVES:
        recorded = golden / "permissions" / f"{name[1:].replace('/', '.') or 'root'}.xml"
        assert without_times(root / f"enclaves{name}/permissions.xml") == without_times(recorded)
    assert "<topic>rt/*</topic>" in (root / "enclaves/extra/permissions.xml").read_text()
    key = (root / "enclaves/idle/key.pem").read_bytes()
    assert run_here("security", "generate_artifacts", *words)[::2] == (0, "")
    assert (root / "enclaves/idle/key.pem").read_bytes() == key


def test_generate_artifacts_writes_no_files_if_an_argument_is_invalid(tmp_path: Path, golden: Path, fail: Run) -> None:
    root, wrong = tmp_path / "keystore", tmp_path / "wrong.xml"
    wrong.write_text("<policy version='0.2.0'><enclaves/></policy>")
    fleet = str(golden / "policies/fleet.xml")
    error = fail("generate_artifacts", "-k", str(root), "-p", fleet, str(wrong))
    assert "wrong.xml:1:25: <enclaves> is empty; expected at least one <enclave>" in error
    assert not root.exists()
    error = fail("generate_artifacts", "-k", str(root), "-p", fleet, str(golden / "policies/two_grants.xml"))
    assert "enclave /two_grants is in " in error and "expected it in one policy" in error
    assert "invalid enclave name '/a b'" in fail("generate_artifacts", "-k", str(root), "-e", "/ok", "/a b")
    assert not root.exists()
    assert "no keystore: ROS_SECURITY_KEYSTORE is not set; expected -k ROOT" in fail("generate_artifacts", "-e", "/a")


def test_create_permission_requires_existing_enclave_and_policy(
    keystore: Path, golden: Path, succeed: Run, fail: Run, tmp_path: Path
) -> None:
    policy = str(golden / "policies/fleet.xml")
    error = fail("create_permission", str(keystore), "/idle", policy)
    assert (
        f"enclave /idle has no certificate; create it with `rosidl-py security create_enclave {keystore} /idle`"
        in error
    )
    succeed("create_enclave", str(keystore), "/idel")
    assert 'has no enclave /idel; did you mean "/idle"?' in fail("create_permission", str(keystore), "/idel", policy)
    missing = fail("create_permission", str(keystore), "/idle", str(tmp_path / "none.xml"))
    assert "none.xml: cannot be read: No such file or directory" in missing


def test_completion_offers_the_enclaves_of_the_keystore(keystore: Path, succeed: Run) -> None:
    succeed("create_enclave", str(keystore), "/robot/arm")
    context = click.Context(create_permission)
    context.params["root"] = keystore
    name = next(one for one in create_permission.params if one.name == "name")
    assert [item.value for item in name.shell_complete(context, "/r")] == ["/robot/arm"]
    assert name.shell_complete(context, "/x") == []
    context.params.clear()
    assert name.shell_complete(context, "") == []


@pytest.mark.parametrize(
    ("expression", "namespace", "expected"),
    [
        ("chatter", "/", "/chatter"),
        ("chatter", "/a/b", "/a/b/chatter"),
        ("chatter", "/a/", "/a/chatter"),
        ("/chatter", "/a", "/chatter"),
        ("~", "/a", "/a/node"),
        ("~/x", "/a", "/a/node/x"),
        ("~/x", "/", "/node/x"),
        ("*", "/a", "/a/*"),
    ],
)
def test_policy_names_are_expanded_with_namespace_and_node(expression: str, namespace: str, expected: str) -> None:
    assert expand_name(expression, namespace, "node") == expected


TOPICS = st.sampled_from(["a", "b", "/c", "~/d", "*", "/*"])
BLOCKS = st.lists(
    st.tuples(
        st.sampled_from(
            [("topics", "publish", "subscribe"), ("services", "request", "reply"), ("actions", "call", "execute")]
        ),
        st.sampled_from([None, "ALLOW", "DENY"]),
        st.sampled_from(["ALLOW", "DENY"]),
        st.lists(TOPICS, min_size=1, max_size=4),
    ),
    max_size=6,
)


@given(BLOCKS)
def test_deny_rules_are_complete_and_precede_allow_rules(blocks: list[Any]) -> None:
    """Regardless of the order of blocks, denied topics are in the deny rule of the right direction."""
    rules = []
    expected: dict[tuple[str, str], set[str]] = {}
    for (kind, first, second), one, other, names in blocks:
        access = {first: one, second: other} if one else {second: other}
        full = tuple(expand_name(name, "/ns", "node") for name in names)
        rules.append(PolicyRule(kind, access, full))
        for name in full:
            for attribute, qualifier in access.items():
                for direction, topic in directions(attribute, name):
                    expected.setdefault((qualifier, direction), set()).add(topic)
    enclave = PolicyEnclave("/e", (tuple(rules),), XmlElement("enclave"))
    text = permissions_xml(enclave, 7, datetime(2020, 1, 1), datetime(2030, 1, 1))
    found: dict[tuple[str, str], set[str]] = {}
    tags = []
    for rule in ElementTree.fromstring(text).iterfind("permissions/grant/*"):
        tags.append(rule.tag)
        for direction in ("publish", "subscribe"):
            topics = [str(topic.text) for topic in rule.iterfind(f"{direction}/topics/topic")]
            assert len(set(topics)) == len(topics)
            if topics not in ([], ["ros_discovery_info"]):
                found[{"deny_rule": "DENY", "allow_rule": "ALLOW"}[rule.tag], direction] = set(topics)
    assert found == expected
    rules_in_order = [tag for tag in tags if tag.endswith("_rule")]
    assert rules_in_order == sorted(rules_in_order, reverse=True) and rules_in_order[-1] == "allow_rule"
    assert tags[-1] == "default"


def directions(attribute: str, name: str) -> list[tuple[str, str]]:
    """Direction and DDS topic for each topic of a name, written as a table."""
    services = [f"{name}/_action/{part}" for part in ("send_goal", "cancel_goal", "get_result")]
    feedback = [f"rt{name}/_action/{part}" for part in ("feedback", "status")]
    match attribute:
        case "publish" | "subscribe":
            return [(attribute, f"rt{name}")]
        case "request":
            return [("publish", f"rq{name}Request"), ("subscribe", f"rr{name}Reply")]
        case "reply":
            return [("subscribe", f"rq{name}Request"), ("publish", f"rr{name}Reply")]
        case "call":
            return [pair for one in services for pair in directions("request", one)] + [
                ("subscribe", one) for one in feedback
            ]
        case _:
            return [pair for one in services for pair in directions("reply", one)] + [
                ("publish", one) for one in feedback
            ]
