"""Rules of governance files, and records of rejected peers: docs/internals/dds.md 11 and 12."""

from __future__ import annotations

import ctypes as ct
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fast_dds import fast_dds_property, new_peers

from rosidl_py_gen.runtime.transport.cyclone import security
from rosidl_py_gen.runtime.transport.cyclone.library import DdscLibrary
from rosidl_py_gen.runtime.transport.cyclone.security import Governance

if TYPE_CHECKING:
    from pathlib import Path


RULE = """<topic_rule><topic_expression>{}</topic_expression>
<metadata_protection_kind>{}</metadata_protection_kind><data_protection_kind> {} </data_protection_kind></topic_rule>"""


def governance(folder: Path, domains: str, *rules: tuple[str, str, str], domain_id: int = 5) -> Governance:
    texts = "".join(RULE.format(*rule) for rule in rules)
    other = f"<domain_rule><domains><id>77</id></domains>{RULE.format('*', 'NONE', 'SIGN')}</domain_rule>"
    text = f"MIME-Version: 1.0\n{other}<domain_rule><domains>{domains}</domains>{texts}</domain_rule>"
    (folder / "governance.p7s").write_text(text)
    return Governance(str(folder), domain_id)


@pytest.mark.parametrize(
    ("domains", "is_found"),
    [
        ("<id>5</id>", True),
        ("<id>1</id><id> 5 </id>", True),
        ("<id>6</id>", False),
        ("<id_range><min>2</min><max>5</max></id_range>", True),
        ("<id_range><min>5</min></id_range>", True),
        ("<id_range><max>4</max></id_range>", False),
        ("<!-- <id>5</id> -->", False),
        ("", False),
    ],
)
def test_governance_rule_is_selected_by_domain_id(tmp_path: Path, domains: str, is_found: bool) -> None:
    assert (
        governance(tmp_path, domains, ("*", "NONE", "ENCRYPT")).only_data_reason().startswith("the governance rule '*'")
        is is_found
    )


def test_first_governance_rule_that_matches_the_topic_applies(tmp_path: Path) -> None:
    rules = (
        ("rt/plain*", "NONE", "NONE"),
        ("rq/*", "SIGN", "ENCRYPT"),
        ("r[rt]/*", "NONE", "SIGN"),
        ("*", "NONE", "NONE"),
    )
    made = governance(tmp_path, "<id>5</id>", *rules)
    assert "rule 'r[rt]/*' protects" in made.only_data_reason()
    topics = {"rt/plain": False, "rt/other/x": True, "rq/addRequest": False, "rr/addReply": True, "ros": False}
    assert {topic: bool(made.only_data_reason(topic)) for topic in topics} == topics


@given(st.text(alphabet="<>/ *!-domainrulestpicexpr5", max_size=300))
def test_any_governance_text_is_read_without_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    folder = tmp_path_factory.mktemp("governance")
    (folder / "governance.p7s").write_text(text)
    Governance(str(folder), 5).only_data_reason("rt/x")


def test_missing_governance_file_has_no_rules(tmp_path: Path) -> None:
    assert Governance(str(tmp_path), 5).only_data_reason() == ""


# -------------------------------------------------------------------------------------------------------------- lines


class Api:
    """Fake Cyclone API that records the log sinks."""

    def __init__(self) -> None:
        self.sinks: list[Any] = []
        self.set_log_sink: Any = lambda sink, argument: self.sinks.append(sink)


class Line:
    """Log line in the form that Cyclone passes to a sink."""

    def __init__(self, text: str, file: str = "/src/core/ddsi/src/ddsi_handshake.c") -> None:
        head = b"1.0 [0] fsm: "
        self._buffer = ct.create_string_buffer(head + text.encode() + b"\n")
        self._data = security.LogData(
            kind=2, file=file.encode(), message=ct.addressof(self._buffer) + len(head), size=len(text.encode())
        )
        self._data.header_size = len(head)
        self.pointer = ct.pointer(self._data)


def log_of(*lines: Line) -> tuple[list[str], int]:
    """Return the records about lines, and how often the loop was woken up."""
    woken: list[None] = []
    log = security.SecurityLog(api := Api())  # type: ignore[arg-type]
    log.open(lambda: woken.append(None))
    for line in lines:
        api.sinks[0](None, line.pointer)
    records = log.new_records()
    assert log.new_records() == []
    return records, len(woken)


def rejected(subject: str, code: int = 200) -> Line:
    reason = "Begin handshake reply failed: Certificate not valid: error: certificate signature failure"
    return Line(f"{reason}; subject: /CN=\\/{subject}(code: {code})")


def test_rejected_peer_is_logged_once_with_its_subject() -> None:
    records, woken = log_of(rejected("a"), rejected("a"), rejected("b"), rejected("a"))
    assert len(records) == woken == 2
    assert (
        "a peer with subject /CN=\\/a was rejected: the certificate of the peer was issued by another CA" in records[0]
    )


def test_rejections_that_differ_in_addresses_or_guids_are_logged_once() -> None:
    text = "Begin handshake reply failed: Failed to convert octet sequence to ASN1 integer: {}:error:068000A8:asn1"
    records, _ = log_of(*(Line(text.format(thread)) for thread in ("C006AC277B7F0000", "C006AC277B7F0001")))
    assert len(records) == 1 and "only if Cyclone DDS begins the handshake" in records[0] and "error:" not in records[0]
    text = "Could not get remote participant {}:1:2:1c1 permissions from plugin"
    assert len(log_of(Line(text.format("80ab")), Line(text.format("80ac")))[0]) == 1


def test_rejection_records_are_limited_in_number_and_length() -> None:
    records, woken = log_of(*(rejected(f"{number}" + "x" * 5000) for number in range(2000)))
    assert len(records) == woken == 101 and records[-1] == "further rejected peers are not logged"
    assert max(map(len, records)) < 1000
    (record,), _ = log_of(rejected("\x1b[31m\n\u202e"))
    assert record.isprintable()


def test_unrelated_log_lines_of_cyclone_are_written_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    assert log_of(Line("something else", "/src/core/ddsi/src/q_init.c")) == ([], 0)
    assert capfd.readouterr().err == "1.0 [0] fsm: something else\n"
    assert log_of(Line("Remote secure participant 1:2:3:1c1 not allowed", "ddsi_entity.c")) == ([], 0)
    assert capfd.readouterr().err == ""


def test_log_sink_is_removed_with_the_last_participant() -> None:
    api = Api()
    log = security.SecurityLog(api)  # type: ignore[arg-type]
    one, two = (lambda: None), (lambda: None)
    for function in (log.open, log.close):
        function(one)
        function(two)
    # Each call of the second kind waits for a sink that runs.
    assert api.sinks[0] is api.sinks[1] is not None and api.sinks[2:] == [None]
    api.set_log_sink = None  # 11.0
    log.open(one)
    log.close(one)


def test_log_lines_of_the_creating_thread_are_captured() -> None:
    log = security.SecurityLog(api := Api())  # type: ignore[arg-type]
    log.open(lambda: None)
    own, peer = rejected("own"), rejected("peer")
    with log.captured() as lines:
        api.sinks[0](None, own.pointer)
    api.sinks[0](None, peer.pointer)
    assert len(lines) == 1 and "own" in lines[0] and len(log.new_records()) == 1


# ------------------------------------------------------------------------------------------------------------ plugins


class Handle:
    """Handle of a library with security."""

    DDS_Security_Exception_set = None


def test_security_plugins_are_searched_next_to_the_library(tmp_path: Path) -> None:
    library = tmp_path / "libddsc.so.0.10.5"
    library.touch()
    (tmp_path / "libddsc0debian").mkdir()
    reason = security.find_plugins(DdscLibrary(object(), str(library)))  # type: ignore[arg-type]
    assert "was built without security" in reason and "ROSIDL_LIBDDSC" in reason
    reason = security.find_plugins(DdscLibrary(Handle(), str(library)))  # type: ignore[arg-type]
    assert f"has security, but its plugins (libdds_security_auth.so and two more) are not in {tmp_path}" in reason
    for name in ("auth", "crypto", "ac"):
        (tmp_path / "libddsc0debian" / f"libdds_security_{name}.so").write_bytes(b"junk")
    reason = security.find_plugins(DdscLibrary(Handle(), str(library)))  # type: ignore[arg-type]
    assert "libdds_security_auth.so does not load" in reason


def test_security_plugins_of_another_build_are_refused(tmp_path: Path) -> None:
    debian = "/usr/lib/x86_64-linux-gnu/libddsc0debian"
    try:
        for name in ("auth", "crypto", "ac"):
            (tmp_path / f"libdds_security_{name}.so").symlink_to(f"{debian}/libdds_security_{name}.so")
        ct.CDLL(str(tmp_path / "libdds_security_auth.so"))
    except OSError:
        pytest.skip("needs libddsc0debian")
    library = tmp_path / "libddsc.so.0.10.5"
    library.touch()
    reason = security.find_plugins(DdscLibrary(Handle(), str(library)))  # type: ignore[arg-type]
    assert "libdds_security_auth.so belongs to another library, /usr/lib/" in reason and "would crash" in reason


@pytest.mark.dds
def test_secured_fast_dds_participants_are_recognized_in_the_domain_that_discovered_them() -> None:
    peers, other = new_peers(), new_peers()
    hashed, cyclone, fast = (bytes.fromhex(head).ljust(16, b"\1") for head in ("93eb4bd1", "0110", "010f"))
    assert [*map(peers.vendor_of, (hashed, cyclone, fast))] == [b"", b"\1\x10", b"\1\x0f"]
    assert [*map(peers.uses_sample_identity, (hashed, cyclone, fast))] == [False, False, True]
    peers.on_participant(hashed, lambda name: "")  # on Cyclone DDS
    assert not peers.has_secured_peers()
    for one in (peers, other):
        one.on_participant(hashed, fast_dds_property)
    assert peers.uses_sample_identity(hashed[:12] + b"\0\0\1\4") and peers.has_secured_peers()
    assert peers.vendor_of(hashed) == b"\1\x0f"
    peers.on_participant_lost(hashed)
    assert not peers.uses_sample_identity(hashed) and not peers.has_secured_peers()
    assert other.uses_sample_identity(hashed)  # in another domain
    other.close()
    assert not other.uses_sample_identity(hashed)


@pytest.mark.dds
def test_secured_fast_dds_peer_without_endpoints_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    peers = new_peers()
    silent, known = (bytes.fromhex(head).ljust(16, b"\1") for head in ("93eb4bd1", "b604d120"))
    guids = {1: known[:12] + b"\0\0\1\4"}
    for guid in (silent, known):
        peers.on_participant(guid, fast_dds_property)
    peers.warn_without_endpoints([known], guids)
    assert "a peer on Fast DDS" not in caplog.text
    peers.warn_without_endpoints([known, silent], guids)
    assert "a peer on Fast DDS was found, but no endpoints of it" in caplog.text
    caplog.clear()
    peers.on_participant_lost(silent)
    peers.warn_without_endpoints([silent], guids)
    assert caplog.text == ""
    peers.on_participant(silent, fast_dds_property)
    peers.forget()
    peers.warn_without_endpoints([silent], guids)
    assert caplog.text == ""
