"""``rosidl-py doctor``: findings on good and bad machines, and redacted reports."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import socket
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger
from support.terminals import on_terminal
from support.waiting import until

from rosidl_py_gen.ros_cli.doctor import BROKEN, NOTE, OK, WARNING, Finding, redact_finding, run_check
from rosidl_py_gen.ros_cli.doctor import machine as doctor_machine
from rosidl_py_gen.ros_cli.doctor import peers as doctor_peers
from rosidl_py_gen.ros_cli.doctor.machine import Interface
from rosidl_py_gen.ros_cli.doctor.peers import middleware_text
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.graph import ParticipantInfo
from rosidl_py_gen.runtime.transport.api import DiscoveryRange, DomainSettings

if TYPE_CHECKING:
    from collections.abc import Iterable

    from support.commands import Tool
    from support.worlds import World

    from rosidl_py_gen.command_support.command_node import CommandNode


def levels(findings: Iterable[Finding], word: str) -> list[str]:
    """Return the levels of the findings whose text contains a word."""
    return [one.level for one in findings if word in one.text]


def assert_each_line_has_a_level(lines: list[str], *expected: str) -> None:
    words = {line.split(" ")[0] for line in lines}
    assert {*expected} <= words <= {"ok", "note", "warning", "error"}, lines


# ------------------------------------------------------------------------------------------------------------ as a run


@pytest.mark.slow
@pytest.mark.real_time("commands are processes")
async def test_each_line_begins_with_level_at_80_columns(dds: World) -> None:
    dds.node("a_node_with_a_name_that_is_as_long_as_it_may_sensibly_be_here", "/robot")
    for options in ((), ("--report",)):
        done = await on_terminal("doctor", "--spin-time", "1.25", *options, ROS_STATIC_PEERS="127.0.0.1")
        assert done.code == 0
        assert_each_line_has_a_level(done.lines, "ok")
        assert any("1 participant, 1 node" in line for line in done.lines)


@pytest.mark.slow
async def test_healthy_machine_with_peers_has_no_errors(network: World, tool: Tool) -> None:
    node, other = network.pair()
    node.create_publisher(String, "/talk")
    await until(lambda: other.count_publishers("/talk") == 1)
    done = await tool("doctor", "--json", "--spin-time", "1.25")
    assert done.code == 0, done
    found = json.loads(done.out)
    assert found["broken"] is False
    texts = [row["text"] for row in found["peers"]]
    assert any("a message went there and back" in text for text in texts)
    middleware = "Cyclone DDS" if network.kind == "dds" else "Zenoh"
    (peers,) = [row["data"] for row in found["peers"] if f"{middleware}, ROS Iron or later" in row["text"]]
    assert (peers["participants"], peers["nodes"]) == (2, ["/alice", "/bob"])
    assert [row["level"] for row in found["installation"]] == ["ok"] * len(found["installation"])


@pytest.mark.slow
async def test_duplicate_names_and_incompatible_endpoints_are_reported(network: World, tool: Tool) -> None:
    node, twin = network.node("same"), network.node("same")
    node.create_publisher(String, "/scan", qos=QoSProfile().best_effort())
    twin.create_subscription(String, "/scan")
    node.create_publisher(String, "/mixed")
    twin.create_subscription(Bool, "/mixed")
    node.create_service(SetBool, "/stop", lambda request: SetBool.Response())
    twin.create_client(Trigger, "/stop")
    await until(lambda: twin.count_publishers("/scan") == 1 and twin.count_publishers("/mixed") == 1)
    await until(lambda: twin.count_services("/stop") == 1 and node.count_clients("/stop") == 1)
    spin = "--spin-time", "1.25"
    done, report = await asyncio.gather(tool("doctor", *spin), tool("doctor", "--report", *spin))
    assert "warning  peers: 2 nodes have the same name: /same" in done.out
    refused = "no messages on /scan from /same to /same: their quality of service is incompatible. ERROR: Best effort"
    assert (refused in done.out) == (network.kind == "dds")  # on Zenoh they connect
    assert "types differ, std_msgs/msg/String and std_msgs/msg/Bool" in done.out
    assert "no calls of /stop from /same to /same: types differ, " in done.out
    assert "2 nodes have the same name" in report.out
    assert "/same" not in report.out and "/scan" not in report.out


@pytest.mark.slow
async def test_broken_settings_exit_with_1_without_traceback(tool: Tool) -> None:
    domain, uri, off, zenoh = await asyncio.gather(
        tool("doctor", ROS_DOMAIN_ID="999"),
        tool("doctor", "--report", CYCLONEDDS_URI="<CycloneDDS>\n<Secret"),
        tool("doctor", "--discovery", "off", "--json"),
        tool("doctor", RMW_IMPLEMENTATION="rmw_zenoh_cpp", ZENOH_SESSION_CONFIG_URI="/no/such.json5"),
    )
    for done in (domain, uri, zenoh):
        assert done.code == 1 and "Traceback" not in done.err + done.out
    assert "error    settings: ROS_DOMAIN_ID must be a whole number from 0 to 232" in domain.out
    assert "CYCLONEDDS_URI is not well-formed XML" in uri.out and "Secret" not in uri.out
    assert "error    peers: Zenoh does not start: ZENOH_SESSION_CONFIG_URI='/no/such.json5'" in zenoh.out
    for done in (domain, uri, zenoh):
        assert_each_line_has_a_level(done.out.splitlines(), "error")
    assert off.code == 0 and any("discovery is off" in row["text"] for row in json.loads(off.out)["peers"])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("unshare") is None, reason="Linux, with the right to make namespaces")
def test_doctor_reports_machine_without_network_or_proc() -> None:
    doctor = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "doctor"]
    bare = ["unshare", "-m", "-n", "sh", "-c", 'mount -t tmpfs none /proc && exec "$@"', "sh"]
    done = subprocess.run([*bare, *doctor], capture_output=True, text=True, timeout=60)
    if "unshare failed" in done.stderr or "mount:" in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "no network interface is up" in done.stdout
    assert "this system does not report" in done.stdout and "DDS does not start" in done.stdout


@pytest.mark.parametrize(
    ("rmw", "missing", "broken"),
    [
        ("rmw_cyclonedds_cpp", "cyclonedds", []),
        ("rmw_cyclonedds_cpp", "eclipse-zenoh", []),
        ("rmw_zenoh_cpp", "eclipse-zenoh", ["eclipse-zenoh is not installed"]),
        ("rmw_zenoh_cpp", "cyclonedds", []),
    ],
)
def test_only_selected_middleware_must_be_installed(
    rmw: str, missing: str, broken: list[str], monkeypatch: Any
) -> None:
    def version(name: str) -> str:
        if name == missing:
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setenv("RMW_IMPLEMENTATION", rmw)
    monkeypatch.setattr(doctor_machine, "version", version)
    found = list(doctor_machine.libraries())
    assert [one.text for one in found if one.level == BROKEN] == broken
    assert missing not in " ".join(one.text for one in found if one.level == OK)


# ------------------------------------------------------------------------------------------------------------ settings


@pytest.mark.parametrize(
    ("variables", "word", "level"),
    [
        ({"RMW_IMPLEMENTATION": "rmw_connextdds"}, "never tested", NOTE),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, "RMW_IMPLEMENTATION=", OK),
        ({"ROS_LOCALHOST_ONLY": "1"}, "deprecated", WARNING),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "everywhere"}, "must be one of", WARNING),
        ({"ROS_DOMAIN_ID": "x"}, "must be a whole number", BROKEN),
        ({"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"}, "only by their server", WARNING),
        ({"FASTDDS_BUILTIN_TRANSPORTS": "SHM"}, "shared memory", WARNING),
        ({"ROS_SECURITY_ENABLE": "true"}, "but ROS_SECURITY_KEYSTORE is not set", WARNING),
        ({"ROS_SECURITY_ENABLE": "1"}, "does not enable security", WARNING),
        (
            {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": "/no/such"},
            "is not a keystore, as it has no folder enclaves",
            BROKEN,
        ),
        ({"CYCLONEDDS_URI": "file:///no/such.xml"}, "CYCLONEDDS_URI names /no/such.xml", BROKEN),
        ({"CYCLONEDDS_URI": "<a><b></a>"}, "not well-formed", BROKEN),
    ],
)
def test_problematic_settings_are_reported_with_level(variables: dict[str, str], word: str, level: str) -> None:
    assert levels(doctor_machine.settings(variables, None, None), word) == [level]
    assert levels(doctor_machine.settings({}, None, None), word) == []


def test_valid_configurations_of_cyclone_dds_have_no_findings(tmp_path: Path) -> None:
    file = tmp_path / "c.xml"
    file.write_text('<?xml version="1.0"?>\n<CycloneDDS/>')
    for value in ("", f"file://{file}", f"{file},{file}", '<?xml version="1.0"?><CycloneDDS/>', "<Domain/>,<Domain/>"):
        assert list(doctor_machine.cyclonedds_uri(value)) == []


@pytest.mark.parametrize(
    ("domain_id", "text", "expected"),
    [(150, "32768\t60999\n", [NOTE]), (100, "32768\t60999\n", []), (220, "32768\t60999\n", []), (150, "junk", [])],
)
def test_domain_in_ephemeral_port_range_is_noted(
    domain_id: int, text: str, expected: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "ip_local_port_range"
    file.write_text(text)
    found = list(doctor_machine.discovery_ports(domain_id, file))
    assert [finding.level for finding in found] == expected
    assert not found or (
        "a node of another domain" in found[0].text and found[0].advice == "a domain below 101 is safe"
    )
    assert list(doctor_machine.discovery_ports(domain_id, tmp_path / "absent")) == []


@pytest.mark.parametrize(("text", "level"), [("212992\n", WARNING), ("4194304", OK), ("junk", NOTE), (None, NOTE)])
def test_small_socket_buffers_are_a_warning(text: str | None, level: str, tmp_path: Path) -> None:
    file = tmp_path / "rmem_max"
    if text is not None:
        file.write_text(text)
    (finding,) = doctor_machine.socket_buffers(file)
    assert finding.level == level and (level != WARNING or "sysctl" in finding.advice)


# ------------------------------------------------------------------------------------------------------------- network


def interface(name: str, address: str | None = "10.0.0.1", **facts: Any) -> Interface:
    given = {"is_up": True, "is_loopback": False, "multicast_flag": True, "multicast_works": True, **facts}
    return Interface(name, address, **given)


LO = interface("lo", "127.0.0.1", is_loopback=True, multicast_flag=False)
SUBNET, LOCALHOST = DomainSettings(), DomainSettings(discovery_range=DiscoveryRange.LOCALHOST)
PEERS = DomainSettings(static_peers=("10.0.0.9",))


@pytest.mark.parametrize(
    ("found", "settings", "expected"),
    [
        ([LO, interface("eth0")], SUBNET, []),
        ([LO, interface("eth0"), interface("docker0")], SUBNET, [(NOTE, "eth0, docker0 lead to other machines")]),
        ([LO, interface("eth0"), interface("docker0")], LOCALHOST, []),
        ([LO, interface("tun0", multicast_works=False)], SUBNET, [(WARNING, "multicast does not work on tun0")]),
        ([LO, interface("tun0", multicast_flag=False)], SUBNET, [(WARNING, "multicast does not work on tun0")]),
        ([LO, interface("tun0", multicast_works=False)], PEERS, []),
        ([LO], SUBNET, [(NOTE, "no interface leads to other machines")]),
        ([interface("lo", None, is_up=False)], SUBNET, [(BROKEN, "no network interface is up")]),
        ([], SUBNET, [(NOTE, "this system does not report")]),
        ([Interface("en0")], SUBNET, []),
        ([LO], None, []),
    ],
)
def test_network_interface_findings_depend_on_discovery_range(
    found: list[Interface], settings: DomainSettings | None, expected: list[tuple[str, str]]
) -> None:
    judged = [one for one in doctor_machine.check_interfaces(found, settings) if one.level != OK]
    assert [one.level for one in judged] == [level for level, _ in expected]
    assert all(word in one.text for one, (_, word) in zip(judged, expected, strict=True))


def test_loopback_is_found_with_its_address(monkeypatch: pytest.MonkeyPatch) -> None:
    if sys.platform == "linux":
        (lo,) = [one for one in doctor_machine.network_interfaces() if one.name == "lo"]
        assert (lo.address, lo.is_up, lo.is_loopback) == ("127.0.0.1", True, True)

    def refuse() -> list[tuple[int, str]]:
        raise OSError("not here")

    monkeypatch.setattr(socket, "if_nameindex", refuse)
    assert doctor_machine.network_interfaces() == []


def test_other_domains_are_detected_by_their_ports(tmp_path: Path) -> None:
    ports = [7400, 7400 + 250 * 42, 7410 + 250 * 7, 7400 + 250 * 3 + 99, 7400 + 250 * 150, 53]
    lines = [f"  {number}: 0100007F:{port:04X} 00000000:0000 07 0" for number, port in enumerate(ports)]
    file = tmp_path / "udp"
    file.write_text("\n".join(["  sl  local_address rem_address", *lines]))
    (finding,) = doctor_machine.other_domains(0, (file, tmp_path / "udp6"))
    assert finding.data["domains"] == [7, 42]
    assert list(doctor_machine.other_domains(0, (tmp_path / "nothing",))) == []


# ------------------------------------------------------------------------------------------------- peers and strangers


@pytest.mark.slow
@pytest.mark.real_time("a process")
async def test_self_test_reports_second_process_that_did_not_start(
    memory: World, monkeypatch: Any, tmp_path: Path
) -> None:
    late = tmp_path / "python"
    late.write_text("#!/bin/sh\nexec sleep 60\n")
    late.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(late))
    monkeypatch.setattr(doctor_peers, "START_TIMEOUT_S", 0.1)
    node = memory.node("doctor")
    test = doctor_peers.SelfTest(cast("CommandNode", SimpleNamespace(node=node, context=node.context)))
    try:
        found = await test.result()
    finally:
        test.close()
    assert (found.level, found.text) == (NOTE, "the second process of the self-test did not start within 0 s")


@pytest.mark.slow
@pytest.mark.real_time("a process")
def test_second_process_of_the_self_test_imports_no_command_line_library() -> None:
    code = "from rosidl_py_gen.command_support import run_self_test_peer; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"click", "rich", "numpy", "rosidl_py_gen.ros_cli"}.isdisjoint(done.stdout.split())


@pytest.mark.parametrize(
    ("prefix", "is_ros", "hashes", "description"),
    [
        ("010f", True, True, "Fast DDS, ROS Iron or later"),
        ("0110", True, False, "Cyclone DDS, ROS Humble or earlier (no type hashes)"),
        ("0110", True, None, "Cyclone DDS, ROS"),
        ("0101", False, False, "RTI Connext, not ROS"),
        ("0999", False, False, "DDS of vendor 09.99, not ROS"),
    ],
)
def test_middleware_text_contains_only_known_facts_of_peer(
    prefix: str, is_ros: bool, hashes: bool | None, description: str
) -> None:
    vendor = bytes.fromhex(prefix)
    info = ParticipantInfo(vendor + bytes(14), is_ros, hashes, (), vendor=vendor)
    assert middleware_text(info) == description


def test_redacted_findings_hide_home_host_and_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/alice")
    monkeypatch.setenv("ROS_STATIC_PEERS", "robot.lab;10.1.2.3")
    monkeypatch.setattr(socket, "gethostname", lambda: "alices-laptop")
    text = (
        "/home/alice/ws on alices-laptop at 192.168.17.23 and 127.0.0.1, robot.lab;10.1.2.3, numpy 2.4.6, 239.255.0.1"
    )
    redacted = "~/ws on (host) at 192.168.x.x and 127.0.0.1, $ROS_STATIC_PEERS, numpy 2.4.6, 239.255.0.1"
    assert redact_finding(Finding(OK, text, text)) == Finding(OK, redacted, redacted)
    assert redact_finding(Finding(OK, "nodes: /secret", public="nodes: 1", data={"nodes": ["/secret"]})) == Finding(
        OK, "nodes: 1"
    )


def test_exception_in_check_becomes_a_finding() -> None:
    def check() -> Iterable[Finding]:
        yield Finding(OK, "never seen")
        raise ZeroDivisionError("strange machine")

    assert [(one.level, one.text) for one in run_check("the moon", check)] == [
        (NOTE, "the moon could not be checked: ZeroDivisionError: strange machine")
    ]


def test_missing_ament_prefix_folders_are_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(tmp_path), "/no/such/prefix"]))
    assert levels(doctor_machine.interfaces(()), "/no/such/prefix, which is not a folder") == [WARNING]
    assert levels(doctor_machine.interfaces(("/no/such",)), "expected a folder") == [BROKEN]


def test_loopback_interface_is_reported_as_used_with_range_localhost() -> None:
    (found,) = doctor_machine.check_interfaces([LO], LOCALHOST)
    assert found.text == "lo: 127.0.0.1, used by the discovery range LOCALHOST"
    assert "though its flag is not set: DDS does not use it" in next(doctor_machine.check_interfaces([LO], SUBNET)).text


def test_zenoh_has_no_discovery_range() -> None:
    first = next(doctor_machine.settings({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}, 5, "localhost"))
    assert first.text == "domain 5"
    assert next(doctor_machine.settings({}, 5, "localhost")).text == "domain 5, discovery range LOCALHOST"
