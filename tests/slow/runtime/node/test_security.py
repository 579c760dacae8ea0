"""The enclave of a context: docs/internals/dds.md 10."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from support.keystores import Authority, Keystore

from rosidl_py_gen.errors import ClosedError, InvalidNameError
from rosidl_py_gen.runtime import Context, MemoryTransport, QoSProfile, RosArgumentError, SecurityError, find_security
from rosidl_py_gen.runtime.node import context as node_context
from rosidl_py_gen.runtime.node.context import core_of
from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey

if TYPE_CHECKING:
    from pathlib import Path

REASON = "permissions deny the topic of the graph"
FILES = (
    *("identity_ca.cert.pem", "cert.pem", "key.pem"),
    *("permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"),
)


@pytest.fixture(scope="module")
def keystore(tmp_path_factory: pytest.TempPathFactory) -> Keystore:
    made = Keystore(tmp_path_factory.mktemp("security") / "keystore", 0)
    for name in ("/", "/a", "/a/b", "/only/below"):
        made.enclave(name)
    return made


def find_folder(environ: dict[str, str], enclave: str = "/", **options: Any) -> tuple[str, list[str]]:
    """Return the folder, relative to the keystore, and the warnings."""
    warnings: list[str] = []
    security = find_security(environ, enclave, warnings.append, **options)
    folder = "" if security is None else security.folder.removeprefix(environ["ROS_SECURITY_KEYSTORE"])
    return folder, warnings


def test_security_folder_is_selected_by_enclave_or_override(keystore: Keystore) -> None:
    environ = keystore.environment()
    for enclave, folder in (("/", "/enclaves"), ("/a", "/enclaves/a"), ("/a/b", "/enclaves/a/b")):
        assert find_folder(environ, enclave) == (folder, [])
    override = {**environ, "ROS_SECURITY_ENCLAVE_OVERRIDE": "/a/b"}
    assert find_folder(override, "/nowhere") == ("/enclaves/a/b", [])
    assert find_folder({**override, "ROS_SECURITY_ENCLAVE_OVERRIDE": ""}, "/a") == ("/enclaves/a", [])
    assert find_folder({**override, "ROS_SECURITY_ENCLAVE_OVERRIDE": "xa"}) == ("/enclaves/a", [])  # as in rcl


@pytest.mark.parametrize(
    ("enable", "strategy", "warning"),
    [
        ("", "Enforce", "ROS_SECURITY_STRATEGY=Enforce has no effect without ROS_SECURITY_ENABLE=true"),
        ("false", "Enforce", ""),
        ("0", "Enforce", ""),
        ("1", "Enforce", "ROS_SECURITY_ENABLE='1' does not enable security, only 'true' does"),
        ("True", "Enforce", "ROS_SECURITY_ENABLE='True' does not"),
        ("true", "enforce", "ROS_SECURITY_STRATEGY='enforce' does not enforce security, only 'Enforce' does"),
        ("true", "Enforced", "ROS_SECURITY_STRATEGY='Enforced' does not"),
        ("true", "Permissive", ""),
        ("true", "", ""),
        ("true", "Enforce", ""),
    ],
)
def test_security_variables_are_compared_like_rcl(keystore: Keystore, enable: str, strategy: str, warning: str) -> None:
    environ = keystore.environment(ROS_SECURITY_ENABLE=enable, ROS_SECURITY_STRATEGY=strategy)
    folder, warnings = find_folder(environ, "/a")
    assert folder == ("/enclaves/a" if enable == "true" else "")
    assert len(warnings) == bool(warning) and all(warning in text for text in warnings)


@pytest.mark.parametrize(
    ("changes", "enclave", "text"),
    [
        ({"ROS_SECURITY_KEYSTORE": ""}, "/", "ROS_SECURITY_KEYSTORE is not set; expected the folder of a keystore"),
        ({"ROS_SECURITY_KEYSTORE": "/no"}, "/", "ROS_SECURITY_KEYSTORE='/no' is not a keystore, as it has no folder"),
        ({}, "/c", "enclaves/c (enclave /c); the keystore has the enclaves /, /a, /a/b, /only/below; select one with"),
        ({}, "/only", "there is no enclave in "),
        (
            {"ROS_SECURITY_ENCLAVE_OVERRIDE": "bad"},
            "/",
            "ROS_SECURITY_ENCLAVE_OVERRIDE='bad', which must begin with '/'",
        ),
        ({}, "/A", "there is no folder"),
    ],
)
def test_missing_security_setup_is_error_if_enforced_and_warning_otherwise(
    keystore: Keystore, changes: dict[str, str], enclave: str, text: str
) -> None:
    environ = {**keystore.environment(), **changes}
    with pytest.raises(SecurityError) as error:
        find_folder(environ, enclave)
    assert text in str(error.value) and str(error.value).startswith("ROS_SECURITY_STRATEGY=Enforce requires")
    folder, (warning,) = find_folder({**environ, "ROS_SECURITY_STRATEGY": ""}, enclave)
    assert folder == "" and text in warning and "communicates unencrypted" in warning


@pytest.mark.parametrize("name", FILES)
def test_missing_or_invalid_security_file_is_named_in_error(tmp_path: Path, name: str) -> None:
    keystore = Keystore(tmp_path / "keystore", 0)
    file = keystore.enclave("/a").folder / name
    environ, permissive = keystore.environment(), keystore.environment(ROS_SECURITY_STRATEGY="")
    content = file.read_bytes()
    file.unlink()
    with pytest.raises(SecurityError, match=rf"enclaves/a \(enclave /a\) lacks {name} \([\w ]+\); create the enclave"):
        find_folder(environ, "/a")
    assert f"lacks {name}" in find_folder(permissive, "/a")[1][0]
    file.mkdir()
    with pytest.raises(SecurityError, match=f"lacks {name}"):
        find_folder(environ, "/a")
    file.rmdir()
    # An invalid file is an error even if security is not enforced, as in rcl.
    wrong = [b"", b"junk", b"-----BEGIN \n"] + [content[: len(content) // 2]] * name.endswith("pem")
    for text in wrong if name.endswith("pem") else wrong[:2]:
        file.write_bytes(text)
        with pytest.raises(SecurityError, match=f"enclaves/a/{name}"):
            find_folder(permissive, "/a")


def test_key_of_another_certificate_or_with_password_is_refused(tmp_path: Path) -> None:
    keystore = Keystore(tmp_path / "keystore", 0)
    one, two = keystore.enclave("/one").folder, keystore.enclave("/two").folder
    (one / "key.pem").write_bytes((two / "key.pem").read_bytes())
    with pytest.raises(SecurityError, match=r"is not the key of .*one/cert.pem: KEY_VALUES_MISMATCH"):
        find_folder(keystore.environment(), "/one")
    (two / "key.pem").write_bytes(Authority().encrypted_key())
    with pytest.raises(SecurityError, match=r"two/key.pem .* has a password"):
        find_folder(keystore.environment(), "/two")


@pytest.mark.parametrize("enclave", ["", "a", "/a/", "//a", "/1a", "/a b", "/ä", "/a;b"])
def test_invalid_enclave_names_are_refused(enclave: str) -> None:
    with pytest.raises(InvalidNameError, match="invalid enclave"):
        Context(transport=MemoryTransport(), args=["x"], enclave=enclave)
    with pytest.raises(RosArgumentError, match="invalid enclave"):
        Context(transport=MemoryTransport(), args=["x", "--ros-args", "--enclave", enclave])


def test_enclave_argument_overrides_command_line() -> None:
    for arguments, expected in (({"enclave": "/a"}, "/a"), ({}, "/b")):
        transport = MemoryTransport()
        context = Context(transport=transport, args=["x", "--ros-args", "-e", "/b"], **arguments)
        assert core_of(context).participant.enclave == expected  # type: ignore[attr-defined]
        context.close()


@pytest.mark.parametrize("transport", ["memory", "zenoh"])
def test_transport_without_security_is_refused_if_security_is_enforced(
    keystore: Keystore, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, transport: str
) -> None:
    for name, value in keystore.environment().items():
        monkeypatch.setenv(name, value)
    kind: Any = MemoryTransport() if transport == "memory" else transport
    with pytest.raises(SecurityError, match="requires a secured context, but this transport has no security"):
        Context(transport=kind, args=["x"])
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Permissive")
    if transport == "memory":
        Context(transport=kind, args=["x"]).close()
        assert "this transport has no security; this process communicates unencrypted" in caplog.text


@pytest.mark.parametrize("failing", ["LoopBinding", "Discovery", "InitialValues"])
def test_failed_context_creation_closes_its_participant(failing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []

    class Recorded(MemoryTransport):
        def open(self, *arguments: Any, **options: Any) -> Any:
            opened.append(super().open(*arguments, **options))
            return opened[-1]

    def fail(*_: object) -> None:
        raise SecurityError(REASON)

    monkeypatch.setattr(node_context, failing, fail)
    with pytest.raises(SecurityError, match=REASON):
        Context(args=["x"], transport=Recorded())
    (participant,) = opened
    with pytest.raises(ClosedError):
        participant.create_reader(EndpointSpec(TopicKey("topic", "/t"), "std_msgs/msg/Bool", QoSProfile(), ""))
