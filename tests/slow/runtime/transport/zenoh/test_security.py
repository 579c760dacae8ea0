"""Access control by certificate or password, with the configurations of docs/howto/zenoh.md.

Routers listen on loopback; sessions are plain Zenoh sessions.
"""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest
import trustme
import zenoh
from support.folders import ROOT
from support.markdown_pages import blocks

from rosidl_py_gen.runtime.transport.zenoh.participant import session_config
from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

EXAMPLES = {block.title: block.text for block in blocks(ROOT / "docs/howto/zenoh.md") if block.language == "json5"}
ROUTER, SESSION = EXAMPLES["router.json5"], EXAMPLES["session.json5"]
USERS, USER = EXAMPLES["router: what to add below transport"], EXAMPLES["session: what to add below transport"]


def refuse(sentence: str) -> None:
    raise AssertionError(f"unexpected warning: {sentence}")


def issue(folder: Path, ca: trustme.CA, name: str) -> None:
    certificate = ca.issue_cert("localhost", "127.0.0.1")
    certificate.private_key_pem.write_to_path(str(folder / f"{name}.key"))
    certificate.cert_chain_pems[0].write_to_path(str(folder / f"{name}.pem"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in place of /etc/robot; the stranger has a certificate of another authority."""
    made = tmp_path_factory.mktemp("robot")
    ca = trustme.CA()
    ca.cert_pem.write_to_path(str(made / "ca.pem"))
    issue(made, ca, "router")
    issue(made, ca, "desk")
    issue(made, trustme.CA(), "stranger")
    (made / "users.txt").write_text("robot:other\ndesk:secret\n")
    return made


class Guarded:
    """Router and sessions with the files of the page, with changes (old text, new text)."""

    def __init__(self, folder: Path, stack: ExitStack, *changes: tuple[str, str]) -> None:
        self.folder, self.stack = folder, stack
        path = self.write("router.json5", ROUTER, ("[::]:7447", "127.0.0.1:0"), *changes)
        # The router of the page has no admin space, which this test needs to read its port.
        environ = {"ZENOH_ROUTER_CONFIG_URI": path, "ZENOH_CONFIG_OVERRIDE": "adminspace/enabled=true"}
        router = stack.enter_context(ZenohRouter(environ, refuse))
        self.port = router.endpoints[0].rpartition(":")[2]

    def write(self, name: str, text: str, *changes: tuple[str, str]) -> str:
        for old, new in (*changes, ("/etc/robot", str(self.folder))):
            assert old in text, f"{name}: {old}"
            text = text.replace(old, new)
        (self.folder / name).write_text(text)
        return str(self.folder / name)

    def session(self, *changes: tuple[str, str]) -> zenoh.Session:
        path = self.write("session.json5", SESSION, ("robot.local:7447", f"localhost:{self.port}"), *changes)
        return self.stack.enter_context(zenoh.open(session_config({"ZENOH_SESSION_CONFIG_URI": path}, refuse)))


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes sessions first, routers last."""
    with ExitStack() as made:
        yield made


def exchange(one: zenoh.Session, other: zenoh.Session) -> None:
    server = other.declare_queryable("a/b", lambda query: query.reply("a/b", b"hello"))
    querier = one.declare_querier("a/b", timeout=10)
    deadline = time.monotonic() + 10
    while not querier.matching_status.matching:
        assert time.monotonic() < deadline, "never matched"
        time.sleep(0.01)
    assert [reply.ok.payload.to_bytes() for reply in querier.get() if reply.ok] == [b"hello"]
    server.undeclare()


NOT_CONNECTED = "Unable to connect"
NO_CERTIFICATE = ("enable_mtls: true", "enable_mtls: false")


@pytest.mark.parametrize(
    "changes",
    [[("desk.", "stranger.")], [NO_CERTIFICATE], [("tls/", "tcp/"), ('"tls"', '"tcp"')]],
    ids=["of another authority", "none", "plain TCP"],
)
def test_connection_requires_certificate_of_the_authority(
    folder: Path, stack: ExitStack, changes: list[tuple[str, str]]
) -> None:
    guarded = Guarded(folder, stack)
    exchange(guarded.session(), guarded.session())
    with pytest.raises(zenoh.ZError, match=NOT_CONNECTED):
        guarded.session(*changes)


def test_router_with_certificate_of_another_authority_is_refused(folder: Path, stack: ExitStack) -> None:
    guarded = Guarded(folder, stack, ("router.pem", "stranger.pem"), ("router.key", "stranger.key"))
    with pytest.raises(zenoh.ZError, match=NOT_CONNECTED):
        guarded.session()


BELOW = "transport: {"


@pytest.mark.parametrize("over", ["tls", "tcp"])
@pytest.mark.parametrize(
    ("old", "new"), [('"secret"', '"Secret"'), ('"desk"', '"nobody"'), (USER, "")], ids=["password", "user", "neither"]
)
def test_connection_requires_password(folder: Path, stack: ExitStack, over: str, old: str, new: str) -> None:
    plain = [("tls/", "tcp/"), ('"tls"', '"tcp"')] if over == "tcp" else []
    guarded = Guarded(folder, stack, *plain, (BELOW, BELOW + USERS))
    exchange(guarded.session(*plain, (BELOW, BELOW + USER)), guarded.session(*plain, (BELOW, BELOW + USER)))
    with pytest.raises(zenoh.ZError, match=NOT_CONNECTED):
        guarded.session(*plain, (BELOW, BELOW + USER.replace(old, new)))
