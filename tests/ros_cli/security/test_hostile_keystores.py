"""Keystores that are damaged or prepared by others: nothing outside is written, and no private key is printed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ed25519

from rosidl_py_gen.ros_cli.security import certificates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NAMES = [
    "",
    "a",
    "//",
    "/a/",
    "/a//b",
    "/..",
    "/../../outside",
    "/a/../../outside",
    "/./a",
    "/.new-x",
    "/a b",
    "/a\nb",
    "/a\n",
    "/a\x1b[31m",
    "/a\x00b",
    "/<a>",
    '/a"&amp;',
    "/a&b",
    "/a,CN=/b",
    "/a*",
    "/1a",
    "/a/1",
    "/\u00e9",
    "/" + "a" * 64,
    "/" + "a/" * 200 + "a",
    "C:\\a",
    "/governance.p7s",
    "~",
    "/~a",
    "/{x}",
]


def tree(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*")}


@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_names_that_no_enclave_has(keystore: Path, fail: Callable[..., str], tmp_path: Path, name: str) -> None:
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


def test_the_longest_name(keystore: Path, succeed: Callable[..., str], fail: Callable[..., str]) -> None:
    succeed("create_enclave", str(keystore), "/" + "a" * 63)
    assert "has 65 characters; the common name of a certificate has at most 64" in fail(
        "create_enclave", str(keystore), "/" + "a" * 64
    )


@pytest.mark.skipif(os.name == "nt", reason="symbolic links of POSIX")
def test_links_of_folders_do_not_lead_out(
    keystore: Path, succeed: Callable[..., str], fail: Callable[..., str], tmp_path: Path
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
def test_links_of_files_are_replaced_not_followed(
    keystore: Path, tmp_path: Path, run_here: Callable[..., Any], dangling: bool
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


def test_a_folder_in_the_place_of_a_file(keystore: Path, fail: Callable[..., str]) -> None:
    for name in ("key.pem", "governance.p7s", "permissions.xml"):
        folder = keystore / "enclaves" / name.partition(".")[0]
        (folder / name).mkdir(parents=True)
        error = fail("create_enclave", str(keystore), f"/{folder.name}")
        assert f"{folder / name}" in error and "directory" in error.lower()
    assert not [*keystore.rglob(".new-*")]


def test_a_file_in_the_place_of_a_folder(
    keystore: Path, tmp_path: Path, fail: Callable[..., str], run_here: Callable[..., Any]
) -> None:
    (keystore / "enclaves/a").write_text("")
    assert "enclaves/a" in fail("create_enclave", str(keystore), "/a")
    assert "enclaves/a" in fail("create_enclave", str(keystore), "/a/b")
    code, _, err = run_here("security", "create_keystore", str(keystore / "enclaves/a"))
    assert code == 2 and "is a file" in err
    assert "Not a directory" in fail("create_keystore", str(keystore / "enclaves/a/b"))


DAMAGE = {
    "public/ca.cert.pem": [b"", b"text", b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"],
    "private/ca.key.pem": [b"", b"text", b"-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n"],
}


@pytest.mark.parametrize(("name", "data"), [(name, data) for name, all_data in DAMAGE.items() for data in all_data])
def test_damaged_files_of_the_authority(keystore: Path, fail: Callable[..., str], name: str, data: bytes) -> None:
    (keystore / name).write_bytes(data)
    error = fail("create_enclave", str(keystore), "/a")
    assert "not a private key; expected PEM" in error or "not a certificate: " in error


def test_keys_with_a_password_or_of_another_kind(keystore: Path, fail: Callable[..., str]) -> None:
    path = keystore / "private/ca.key.pem"
    encryption = serialization.BestAvailableEncryption(b"word")
    form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    path.write_bytes(certificates.new_key().private_bytes(*form, encryption))
    assert "the private key has a password; expected one without" in fail("create_enclave", str(keystore), "/a")
    path.write_bytes(ed25519.Ed25519PrivateKey.generate().private_bytes(*form, serialization.NoEncryption()))
    assert "got a key of another kind; DDS Security needs" in fail("create_enclave", str(keystore), "/a")
    path.write_bytes(certificates.key_pem(certificates.new_key()))
    assert "is not the key of " in fail("create_enclave", str(keystore), "/a")


def test_private_keys_are_never_printed(keystore: Path, run_here: Callable[..., Any], golden: Path) -> None:
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


def test_folders_with_strange_names_are_skipped(keystore: Path, run_here: Callable[..., Any]) -> None:
    for name in ("good", "a b", "new\nline", "esc\x1b[31m", "1digit"):
        (keystore / "enclaves" / name).mkdir()
        (keystore / "enclaves" / name / "key.pem").touch()
    code, out, err = run_here("security", "list_enclaves", str(keystore))
    assert (code, out) == (0, "/good\n")
    assert err.count("skipped ") == 4 == err.count("\n") and "\x1b" not in err


def test_a_damaged_governance(keystore: Path, fail: Callable[..., str]) -> None:
    (keystore / "enclaves/governance.xml").write_text("<dds>\n<domain_access_rules></dds>")
    (keystore / "enclaves/governance.p7s").unlink()
    assert "governance.xml:2:24: not XML: mismatched tag" in fail("create_keystore", str(keystore))


@pytest.fixture
def readable_keystore(keystore: Path, succeed: Callable[..., str]) -> Iterator[Path]:
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
def test_folders_that_the_user_may_not_write(readable_keystore: Path, run_here: Callable[..., Any], words: str) -> None:
    before = tree(readable_keystore)
    os.seteuid(65534)
    try:
        code, out, err = run_here("security", *words.format(root=readable_keystore).split())
    finally:
        os.seteuid(0)
    assert (code, out) == (1, "") and "Permission denied" in err.splitlines()[-1], err
    assert tree(readable_keystore) == before


def test_commands_at_the_same_time_make_one_enclave(keystore: Path) -> None:
    def create(_: int) -> None:
        command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "security", "create_enclave", str(keystore), "/a"]
        subprocess.run(command, check=True, capture_output=True)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(create, range(4)))
    folder = keystore / "enclaves/a"
    key, certificate = (certificates.load_key(folder / "key.pem"), certificates.load_certificate(folder / "cert.pem"))
    assert certificates.is_key_of(key, certificate)
    assert not [*keystore.rglob(".new-*")]


def test_without_cryptography_the_hint_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fail: Callable[..., str]
) -> None:
    for name in [one for one in sys.modules if re.match(r"cryptography\b|rosidl_py_gen\.ros_cli\.security\.cert", one)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cryptography", None)
    import rosidl_py_gen.ros_cli.security as package

    monkeypatch.delattr(package, "certificates")
    error = fail("create_keystore", str(tmp_path / "keystore"))
    assert "this needs cryptography, which is not installed: " in error and "[security]" in error
