"""Configuration of sessions and routers: docs/internals/zenoh.md 1.2, 1.3, 1.7."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.zenoh import participant
from rosidl_py_gen.runtime.transport.zenoh import router as router_module
from rosidl_py_gen.runtime.transport.zenoh.participant import (
    ZenohConfigError,
    configured_endpoints,
    router_attempts,
    router_config,
    session_config,
)
from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

if TYPE_CHECKING:
    from pathlib import Path

# Differences of the files of rmw_zenoh_cpp 0.2.10 from the defaults of Zenoh 1.10.
BOTH = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
    "timestamping/enabled": {"router": True, "peer": True, "client": True},
    "queries_default_timeout": 600000,
    "transport/unicast/open_timeout": 60000,
    "transport/unicast/accept_timeout": 60000,
    "transport/unicast/accept_pending": 10000,
    "transport/unicast/max_sessions": 10000,
    "transport/link/tx/lease": 60000,
    "transport/link/tx/keep_alive": 2,
    "transport/shared_memory/enabled": False,
    "transport/shared_memory/transport_optimization/pool_size": 50331648,
    "transport/shared_memory/transport_optimization/message_size_threshold": 512,
    "adminspace/enabled": True,
}


def refuse(sentence: str) -> None:
    raise AssertionError(f"unexpected warning: {sentence}")


def values(config: Any, keys: Any) -> dict[str, Any]:
    return {key: json.loads(config.get_json(key)) for key in keys}


def test_default_session_is_a_local_peer_that_connects_to_the_router() -> None:
    expected = {
        **BOTH,
        "mode": "peer",
        "connect/endpoints": ["tcp/localhost:7447"],
        "listen/endpoints": ["tcp/localhost:0"],
        "scouting/gossip/autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
        "scouting/multicast/autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 60000000,
    }
    assert values(session_config({}, refuse), expected) == expected


def test_default_router_listens_on_all_interfaces() -> None:
    expected = {**BOTH, "mode": "router", "listen/endpoints": ["tcp/[::]:7447"]}
    config = router_config({}, refuse)
    assert values(config, expected) == expected
    assert configured_endpoints(config, "connect") == []


def test_router_endpoints_of_the_caller_override_file_and_variables(tmp_path: Path) -> None:
    path = tmp_path / "router.json5"
    path.write_text('{mode: "router", listen: {endpoints: ["tcp/127.0.0.1:1"]}}')
    environ = {"ZENOH_ROUTER_CONFIG_URI": str(path), "ZENOH_CONFIG_OVERRIDE": 'listen/endpoints=["tcp/127.0.0.1:2"]'}
    assert configured_endpoints(router_config(environ, refuse), "listen") == ["tcp/127.0.0.1:2"]
    config = router_config(environ, refuse, listen=["tcp/127.0.0.1:3"], connect=["tcp/127.0.0.1:4"])
    assert (configured_endpoints(config, "listen"), configured_endpoints(config, "connect")) == (
        ["tcp/127.0.0.1:3"],
        ["tcp/127.0.0.1:4"],
    )


def test_session_configuration_file_replaces_the_defaults(tmp_path: Path) -> None:
    path = tmp_path / "session.json5"
    path.write_text('{mode: "client", /* a comment */ connect: {endpoints: ["tcp/robot:7447"]}}')
    config = session_config({"ZENOH_SESSION_CONFIG_URI": str(path), "ZENOH_ROUTER_CONFIG_URI": "/nowhere"}, refuse)
    assert values(config, ["mode", "connect/endpoints"]) == {"mode": "client", "connect/endpoints": ["tcp/robot:7447"]}
    assert json.loads(config.get_json("transport/link/tx/lease")) == 10000  # the default of Zenoh


def test_endpoints_may_depend_on_the_mode(tmp_path: Path) -> None:
    path = tmp_path / "session.json5"
    path.write_text('{mode: "client", connect: {endpoints: {client: ["tcp/robot:7447"], peer: ["tcp/other:7447"]}}}')
    config = session_config({"ZENOH_SESSION_CONFIG_URI": str(path)}, refuse)
    assert (configured_endpoints(config, "connect"), configured_endpoints(config, "listen")) == (["tcp/robot:7447"], [])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("missing.json5", None, "No such file"),
        ("wrong.txt", "{}", "Unsupported file type"),
        ("wrong.json5", "{mode: 'peer', lisn: 1}", r"unknown field `lisn`, .*\(line 1, column 16\)"),
        ("wrong.json5", "{mode:", "expected"),
        ("wrong.json5", "[" * 100_000, "expected at most 100 nested brackets"),
        (".", None, "Is a directory"),
    ],
)
def test_unusable_configuration_file_is_named_in_error(
    tmp_path: Path, name: str, text: str | None, message: str
) -> None:
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    for variable, make in (("ZENOH_SESSION_CONFIG_URI", session_config), ("ZENOH_ROUTER_CONFIG_URI", router_config)):
        with pytest.raises(ZenohConfigError, match=f"{variable}='{re.escape(str(path))}': .*{message}") as caught:
            make({variable: str(path)}, refuse)
        assert ".rs" not in str(caught.value)


def test_pairs_of_the_override_variable_take_precedence() -> None:
    override = 'mode="client";connect/endpoints=["tcp/a:1", "tcp/b:2?x=y"];;transport/link/tx/lease=5000;'
    for config in (
        session_config({"ZENOH_CONFIG_OVERRIDE": override}, refuse),
        router_config({"ZENOH_CONFIG_OVERRIDE": override}, refuse),
    ):
        assert values(config, ["mode", "connect/endpoints", "transport/link/tx/lease"]) == {
            "mode": "client",
            "connect/endpoints": ["tcp/a:1", "tcp/b:2?x=y"],
            "transport/link/tx/lease": 5000,
        }


@pytest.mark.parametrize(
    ("pair", "warning"),
    [
        (
            "mode=client",
            "ZENOH_CONFIG_OVERRIDE: mode='client': expected array, boolean, null, number, object, or string "
            "(line 1, column 1); texts need quotes; this pair has no effect",
        ),
        ("mode", "ZENOH_CONFIG_OVERRIDE: expected key=value, found 'mode'; this pair has no effect"),
        ("mode=", "ZENOH_CONFIG_OVERRIDE: expected key=value, found 'mode='; this pair has no effect"),
        ("lisn/x=1", "ZENOH_CONFIG_OVERRIDE: lisn/x='1': unknown key; this pair has no effect"),
    ],
)
def test_invalid_override_pair_is_ignored_with_warning(pair: str, warning: str) -> None:
    warnings: list[str] = []
    config = session_config({"ZENOH_CONFIG_OVERRIDE": f"{pair};transport/link/tx/lease=5000"}, warnings.append)
    assert warnings == [warning]
    assert values(config, ["mode", "transport/link/tx/lease"]) == {"mode": "peer", "transport/link/tx/lease": 5000}


@given(st.text())
@example("a/b=" + "[" * 100_000)  # crashes the parser of Zenoh
def test_any_override_text_raises_no_error(text: str) -> None:
    warnings: list[str] = []
    session_config({"ZENOH_CONFIG_OVERRIDE": text}, warnings.append)
    assert all(len(sentence) < 1000 for sentence in warnings)


@pytest.mark.parametrize(
    ("text", "attempts"), [(None, 1), ("", 1), ("1", 1), ("5", 5), ("0", math.inf), ("-1", 0), ("-7", 0)]
)
def test_router_check_attempts_are_read_from_environment(text: str | None, attempts: float) -> None:
    assert router_attempts({} if text is None else {"ZENOH_ROUTER_CHECK_ATTEMPTS": text}) == attempts


def test_invalid_router_check_attempts_are_refused() -> None:
    with pytest.raises(ZenohConfigError, match=r"ZENOH_ROUTER_CHECK_ATTEMPTS must be a whole number .*, got 'many'"):
        router_attempts({"ZENOH_ROUTER_CHECK_ATTEMPTS": "many"})


# ------------------------------------------------------------------------------------------------------------- router


def test_router_reports_its_endpoint_and_frees_it_on_close() -> None:
    with ZenohRouter({}, refuse, listen=["tcp/127.0.0.1:0"]) as router:
        (endpoint,) = router.endpoints
        assert re.fullmatch(r"tcp/127\.0\.0\.1:[1-9]\d*", endpoint)
        with pytest.raises(TransportError, match=f"no Zenoh router on {endpoint}: .*Address already in use") as caught:
            ZenohRouter({}, refuse, listen=[endpoint])
        assert ".rs" not in str(caught.value)
    with ZenohRouter({}, refuse, listen=[endpoint]) as router:
        assert router.endpoints == [endpoint]
        router.close()


def test_invalid_router_endpoint_is_named_in_error() -> None:
    with pytest.raises(ZenohConfigError, match=r"""router: listen/endpoints='\["7447"\]': Endpoints must be"""):
        ZenohRouter({}, refuse, listen=["7447"])


def test_router_listens_on_ipv4_without_ipv6(monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[list[str]] = []

    def stop(*_: object, listen: list[str], connect: list[str]) -> None:
        requested.append(listen)
        raise ZenohConfigError("far enough")

    def no_ipv6(*_: object) -> None:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(participant, "router_config", stop)
    for listen in ([], ["tcp/127.0.0.1:0"]):
        with pytest.raises(ZenohConfigError):
            ZenohRouter({}, refuse, listen=listen)
    monkeypatch.setattr(router_module.socket, "socket", no_ipv6)
    for listen in ([], ["tcp/127.0.0.1:0"]):
        with pytest.raises(ZenohConfigError):
            ZenohRouter({}, refuse, listen=listen)
    assert requested == [[], ["tcp/127.0.0.1:0"], ["tcp/0.0.0.0:7447"], ["tcp/127.0.0.1:0"]]
