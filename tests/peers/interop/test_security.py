"""Secured networks (SROS 2), on Debian's libddsc, whatever library the other tests use: nodes of ours in processes, the
program in C on Cyclone DDS 0.10, and those in C++ on Fast DDS 2.9."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from ctypes import CDLL
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from support.keystores import Authority, Keystore, governance
from support.local_network import domain_id
from support.processes import running_process

from rosidl_py_gen.bags import BagReader

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager

NODE = Path(__file__).parent / "peers" / "secured_node.py"
LIBRARY = "libddsc.so.0debian"
OF_NODE = ("rt/rosout", "rt/parameter_events", "rr/*")
"""Topics that every node publishes."""
TALKER = {"publish": ("rt/chatter", "rt/fibonacci/_action/*", *OF_NODE), "subscribe": ("rq/*",)}
"""Permissions as sros2 makes them from the policy of a talker."""
# As the peers are bound: docs/internals/dds.md 8.
_BOUND = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces></General></Domain>"
    "</CycloneDDS>"
)


@pytest.fixture(autouse=True)
def debian_library() -> None:
    try:
        assert hasattr(CDLL(LIBRARY), "DDS_Security_Exception_set")
    except OSError:
        assert "ROSIDL_TEST_REQUIRE_PEERS" not in os.environ, "libddsc0debian is missing"
        pytest.skip("needs libddsc0debian")


@pytest.fixture
def keystore(tmp_path: Path) -> Keystore:
    return Keystore(tmp_path / "keystore", domain_id())


Result = dict[str, Any]


def started(
    role: str, enclave: str, environ: Mapping[str, str], *more: str
) -> AbstractContextManager[subprocess.Popen[str]]:
    """Run a node; without variables of security it is an unsecured one."""
    settings = {"ROSIDL_LIBDDSC": LIBRARY, "CYCLONEDDS_URI": _BOUND, **environ}
    return running_process(sys.executable, NODE, role, enclave, *more, **settings)


@contextmanager
def talking(role: str, enclave: str, environ: Mapping[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Run a node that goes on until the end of the block, from when it is ready."""
    with started(role, enclave, environ) as process:
        assert process.stdout is not None and process.stderr is not None
        line = process.stdout.readline()
        assert line == '{"ready": true}\n', line or process.stderr.read()
        yield process


def results(role: str, enclave: str, environ: Mapping[str, str], *more: str) -> tuple[Result, str]:
    """Run a node to its end; return what it reports, and its log."""
    with started(role, enclave, environ, *more) as process:
        out, log = process.communicate(timeout=60)
    merged: Result = {}
    for line in out.splitlines():
        merged |= json.loads(line)
    return merged, log


def ended(keystore: Keystore, program: str) -> subprocess.CompletedProcess[str]:
    """Run the text of a Python program in the secured network to its end."""
    environ = {**os.environ, **keystore.environment()}
    return subprocess.run([sys.executable, "-c", program], env=environ, capture_output=True, text=True, timeout=60)


def log_of(process: subprocess.Popen[str]) -> str:
    """End a node, and return its log."""
    process.terminate()
    return process.communicate(timeout=10)[1]


def side_by_side(*functions: Callable[[], Any]) -> list[Any]:
    with ThreadPoolExecutor(len(functions)) as pool:
        return [future.result() for future in [pool.submit(function) for function in functions]]


# ---------------------------------------------------------------------------------------------------- nodes of ours


def test_secured_nodes_communicate_and_are_invisible_to_unsecured_ones(keystore: Keystore) -> None:
    keystore.enclave("/talker", **TALKER)
    keystore.enclave("/robot/listener", publish=("rq/*", *OF_NODE), subscribe=("rt/*", "rr/*", "rq/listen/*"))
    environ = keystore.environment()
    with talking("talk", "/talker", environ) as talker:
        (found, log), (unsecured, unsecured_log) = side_by_side(
            lambda: results("listen", "/robot/listener", environ), lambda: results("watch", "/", {})
        )
        assert "found security directory" in log_of(talker)
    assert found.pop("received").startswith("secret "), log
    assert "error" not in found, found
    assert "enclaves" in found, (found, log)
    assert found.pop("enclaves") == {"/talk": "/talker", "/listen": "/robot/listener"}
    assert found == {"sum": 5, "color": ["red"], "result": [0, 1, 1]}
    assert "WARN" not in log and f"found security directory {keystore.folder}/enclaves/robot/listener" in log
    # Unsecured peers neither see anything nor are seen.
    assert unsecured == {"nodes": ["watch"], "received": []}
    assert unsecured_log == ""


def test_security_error_names_denied_topic(keystore: Keystore) -> None:
    keystore.enclave("/reader", publish=OF_NODE, subscribe=("rt/secret", "rq/reader/*", "rq/create/*"))
    keystore.enclave("/writer", publish=("rt/secret", "rq/secretRequest", *OF_NODE), subscribe=("rq/create/*", "rr/*"))
    keystore.enclave("/nothing", publish=(), subscribe=())
    environ = keystore.environment()
    (reader, _), (writer, _), (nothing, _) = side_by_side(
        *(lambda name=name: results("create", name, environ) for name in ("/reader", "/writer", "/nothing"))
    )
    denied = "SecurityError: enclave /{} must not {} (DDS topic {}): the permissions in {}/permissions.p7s"
    folder = keystore.folder / "enclaves"
    assert reader["subscription"] == "created"
    assert reader["publisher"].startswith(denied.format("reader", "publish to /secret", "rt/secret", folder / "reader"))
    assert "must not subscribe to requests of /secret (DDS topic rq/secretRequest)" in reader["service"]
    assert "must not subscribe to replies of /secret" in reader["client"]
    assert (writer["publisher"], writer["client"]) == ("created", "created")
    assert "must not subscribe to /secret" in writer["subscription"]
    assert nothing["error"].startswith("SecurityError: enclave /nothing must not publish to /rosout")


def test_security_error_names_invalid_file(keystore: Keystore) -> None:
    other = Authority("otherCA")
    keystore.enclave("/expired", days=(-10, -1))
    keystore.enclave("/early", days=(5, 10))
    keystore.enclave("/subject", subject="/somebody")
    keystore.enclave("/old", not_after="2021-01-01T00:00:00")
    keystore.enclave("/good")
    revoked = keystore.enclave("/revoked")
    (revoked.folder / "crl.pem").write_bytes(keystore.authority.revoke(revoked.certificate))
    key, issued, changed, missing, broken = map(
        keystore.enclave, ("/key", "/issued", "/changed", "/missing", "/broken")
    )
    (key.folder / "key.pem").write_bytes((keystore.folder / "enclaves/good/key.pem").read_bytes())
    pem = keystore.enclave("/other", authority=other).folder / "identity_ca.cert.pem"
    (issued.folder / "identity_ca.cert.pem").write_bytes(pem.read_bytes())
    permissions = changed.folder / "permissions.p7s"
    permissions.write_bytes(permissions.read_bytes().replace(b"DENY", b"ALLOW"))
    (missing.folder / "key.pem").unlink()
    (missing.folder / "governance.p7s").unlink()
    (broken.folder / "permissions.p7s").write_text("junk")
    expected = {
        "/expired": "the certificate of the enclave, {}/cert.pem, or of its CA, ",
        "/early": "the certificate of the enclave, {}/cert.pem, is not valid yet",
        "/subject": "{}/permissions.p7s has no grant for the subject of {}/cert.pem",
        "/old": "the permissions in {}/permissions.p7s are outside of their validity",
        "/revoked": "the certificate of the enclave, {}/cert.pem, is revoked by {}/crl.pem",
        "/key": "{}/key.pem (private key of the enclave) is damaged, has a password, or is not the key of {}/cert.pem",
        "/issued": "{}/cert.pem was not issued by the CA of {}/identity_ca.cert.pem",
        "/changed": "{}/governance.p7s or permissions.p7s was changed, or is not signed by the CA of",
        "/missing": "{} (enclave /missing) lacks key.pem (private key of the enclave), governance.p7s (signed rules",
        "/broken": "{}/permissions.p7s (signed permissions of the enclave) is not a file in S/MIME format",
        "/nowhere": "there is no folder {} (enclave /nowhere); the keystore has the enclaves /",
    }
    found, log = results("open", ",".join([*expected, "/good"]), keystore.environment())
    assert found.pop("/good") == "open", log
    for name, text in expected.items():
        folder = f"{keystore.folder}/enclaves{name}"
        assert found[name].startswith("SecurityError: ") and text.format(folder, folder) in found[name], found[name]
    assert "rror occurred" not in log, "Cyclone's lines are in the errors"


def test_contexts_of_a_domain_in_one_process_must_share_enclave(keystore: Keystore) -> None:
    """Cyclone would end the process; after a context that failed or was closed, the domain may be used otherwise."""
    keystore.enclave("/expired", days=(-10, -1))
    keystore.enclave("/foreign")
    keystore.enclave("/good")
    keystore.enclave("/other")
    governance_file = keystore.folder / "enclaves/foreign/governance.p7s"
    governance_file.unlink()
    governance_file.write_bytes(keystore.authority.sign(governance(domain_id() + 1)))
    program = """
import os
from rosidl_py_gen.runtime import Context, SecurityError

def attempt(enclave):
    os.environ["ROS_SECURITY_ENABLE"] = "true" if enclave else "false"
    try:
        return Context(enclave=enclave or "/", args=["x"])
    except SecurityError as error:
        print(error)

plain = attempt("")
attempt("/good")
plain.close()
attempt("/expired")
attempt("/foreign")
good = attempt("/good")
attempt("/good").close()
attempt("")
attempt("/other")
good.close()
attempt("/other").close()
attempt("").close()
print("end")
"""
    run = ended(keystore, program)
    second, expired, foreign, unsecured, other, end = run.stdout.splitlines() or [run.stderr]
    folder = f"{keystore.folder}/enclaves/good"
    assert "with no security, and Cyclone DDS permits one enclave" in second
    assert f"got the enclave in {folder}. Use one enclave, or two processes" in second
    assert "expired/cert.pem" in expired and "has no rule for domain" in foreign
    assert f"with the enclave in {folder}, and Cyclone DDS permits" in unsecured and "got no security" in unsecured
    assert f"with the enclave in {folder}, and Cyclone DDS permits one enclave" in other and "enclaves/other" in other
    assert (end, run.returncode) == ("end", 0)


def test_rejected_peer_is_logged_once(keystore: Keystore) -> None:
    keystore.enclave("/talker")
    stranger = keystore.enclave("/stranger", authority=Authority())
    expired = keystore.enclave("/later")
    (keystore.folder / "enclaves/talker/crl.pem").write_bytes(keystore.authority.revoke(expired.certificate))
    environ = keystore.environment()
    with talking("talk", "/talker", environ) as talker:
        strangers = side_by_side(
            *(lambda name=name: results("watch", name, environ) for name in ("/stranger", "/later", "/stranger"))
        )
        log = log_of(talker)
    for found, _ in strangers:
        assert found["received"] == [] and "talk" not in found["nodes"]
    lines = [line for line in log.splitlines() if "was rejected" in line] + [
        line for _, text in strangers for line in text.splitlines() if "was rejected" in line
    ]
    # The side that begins the handshake, by a hash of the subjects, gets to know nothing.
    assert stranger.certificate is not None
    about = [line for line in lines if "stranger" in line or "/CN=\\/talker" in line or "later" in line]
    assert about == lines and len(lines) == len(set(lines)) and 1 <= len(lines) <= 5, lines
    assert any("issued by another CA" in line for line in lines), lines


# ------------------------------------------------------------------------------------------------------- permissive


# ------------------------------------------------------------------------------------------------------------ commands


def command(*arguments: str, environ: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rosidl_py_gen.ros_cli", *arguments],
        env={**os.environ, "CYCLONEDDS_URI": _BOUND, **environ},
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_commands_work_in_secured_network(keystore: Keystore, tmp_path: Path) -> None:
    keystore.enclave("/talker")
    keystore.enclave("/cli", publish=("rq/*", "rr/*", "rt/events/*"), subscribe=("rt/chatter", "rr/*", "rq/*"))
    environ = keystore.environment(ROS_SECURITY_ENCLAVE_OVERRIDE="/cli")
    with talking("talk", "/talker", keystore.environment()):
        nodes, echo, call, doctor, record = side_by_side(
            lambda: command("node", "list", environ=environ),
            lambda: command("topic", "echo", "/chatter", "--once", environ=environ),
            lambda: command(
                *("service", "call", "/add", "example_interfaces/srv/AddTwoInts", "{a: 1, b: 2}"), environ=environ
            ),
            lambda: command("doctor", "--json", environ=environ),
            lambda: command(
                *("bag", "record", "/chatter", "/rosout", "-o", str(tmp_path / "bag"), "--duration", "4"),
                environ=environ,
            ),
        )
    assert "/talk" in nodes.stdout.splitlines(), nodes
    assert "secret" in echo.stdout, echo
    assert "sum" in call.stdout and "3" in call.stdout, call
    assert "skipped /rosout: enclave / must not subscribe to /rosout" in record.stderr, record
    with BagReader(tmp_path / "bag") as bag:
        assert {topic for topic, *_ in bag.messages()} == {"/chatter"}
    texts = json.loads(doctor.stdout)
    assert any("security is on" in one["text"] for one in texts["settings"]), texts
    assert any("secured DDS, probably Cyclone DDS" in one["text"] for one in texts["peers"]), texts


def test_library_without_security_error_suggests_package(keystore: Keystore) -> None:
    pytest.importorskip("cyclonedds")
    keystore.enclave("/good")
    import cyclonedds

    folder = Path(cyclonedds.__file__).parents[1] / "cyclonedds.libs"
    wheel = next(folder.glob("libddsc*"), None)
    if wheel is None:
        pytest.skip("the wheel has no libddsc here")
    environ = keystore.environment(ROSIDL_LIBDDSC=str(wheel))
    enforced, permissive = side_by_side(
        lambda: results("watch", "/good", environ),
        lambda: results("watch", "/good", {**environ, "ROS_SECURITY_STRATEGY": ""}),
    )
    for text in (enforced[0]["error"], permissive[1]):
        assert "was built without security; use a libddsc with security: apt install libddsc0debian" in text
        assert "ROSIDL_LIBDDSC=libddsc.so.0debian" in text
    # Without the variable, the library of Debian is found, because only it has security.
    found, log = results("watch", "/good", {**environ, "ROSIDL_LIBDDSC": ""})
    assert "error" not in found and "found security directory" in log


# ------------------------------------------------------------------------------------------------------- other programs


def until_found(run: Callable[[], tuple[Result, str]]) -> tuple[Result, str]:
    """Start a peer on Fast DDS and a node until they find each other: docs/internals/dds.md 12."""
    for _ in range(6):
        found, log = run()
        if not found.get("error", "").startswith("WaitTimeoutError"):
            break
        assert not log or "a peer on Fast DDS was found, but no endpoints of it" in log, log
    return found, log


def test_secured_topics_and_services_work_with_cyclone_dds_peer(
    keystore: Keystore, run_peer: Callable[..., Any], cyclone_peer: Path
) -> None:
    keystore.enclave("/ours")
    folder = keystore.enclave("/peer").folder
    with run_peer(cyclone_peer, enclave=folder):
        found, log = results("use", "/ours", keystore.environment(), "topics", "/c_add")
    assert found == {"sizes": [5, 70_000], "sums": [42]}, log


# The hash of /talker is smaller than that of /listener, so whoever has it begins the handshake.
@pytest.mark.parametrize(
    "kinds",
    [
        {},
        {"data": "NONE"},
        {"data": "SIGN", "metadata": "SIGN", "rtps": "NONE"},
        {"data": "NONE", "metadata": "NONE", "rtps": "ENCRYPT", "discovery": "NONE", "liveliness": "NONE"},
    ],
    ids=["as sros2", "plain data", "signed", "packets only"],
)
def test_secured_services_work_with_fast_dds_peer(
    tmp_path: Path, run_peer: Callable[..., Any], fastdds_service_peer: Path, kinds: dict[str, str]
) -> None:
    keystore, domain = Keystore(tmp_path / "keystore", domain_id(), kinds), str(domain_id())
    keystore.enclave("/talker")
    folder = keystore.enclave("/listener").folder

    def call() -> tuple[Result, str]:
        with run_peer(fastdds_service_peer, "serve", domain, "f_add", enclave=folder):
            return results("use", "/talker", keystore.environment(), "/f_add")

    def serve() -> tuple[Result, str]:
        with (
            talking("talk", "/talker", keystore.environment()),
            run_peer(fastdds_service_peer, "call", domain, "add", "1", "2", "3", "4", enclave=folder) as peer,
        ):
            lines = [line.strip() for line in peer.stdout]
            return {"lines": lines} if lines else {"error": "WaitTimeoutError"}, ""

    found, log = until_found(call)
    assert found["sums"] == [42], log
    assert until_found(serve)[0] == {"lines": ["SUM 3", "SUM 7"]}


def test_secured_topics_work_with_fast_dds_peer(
    keystore: Keystore, run_peer: Callable[..., Any], fastdds_peer: Path
) -> None:
    keystore.enclave("/talker")
    folder = keystore.enclave("/listener").folder

    def echo() -> tuple[Result, str]:
        with run_peer(fastdds_peer, "echo", str(domain_id()), enclave=folder):
            return results("use", "/talker", keystore.environment(), "topics")

    found, log = until_found(echo)
    assert found["sizes"] == [5, 70_000], log


def test_handshake_started_by_fast_dds_is_reported(
    keystore: Keystore, run_peer: Callable[..., Any], fastdds_service_peer: Path
) -> None:
    folder = keystore.enclave("/talker").folder
    keystore.enclave("/listener")
    with run_peer(fastdds_service_peer, "serve", str(domain_id()), "f_add", enclave=folder):
        found, log = results("use", "/listener", keystore.environment(), "/f_add")
    assert found["error"].startswith("WaitTimeoutError"), found
    assert log.count("they authenticate each other only if Cyclone DDS begins the handshake") == 1, log


def test_services_are_refused_if_governance_protects_data_but_not_metadata(
    tmp_path: Path, run_peer: Callable[..., Any], fastdds_service_peer: Path
) -> None:
    keystore = Keystore(tmp_path / "keystore", domain_id(), {"metadata": "NONE"})
    keystore.enclave("/talker")
    folder = keystore.enclave("/listener").folder

    def call() -> tuple[Result, str]:
        with run_peer(fastdds_service_peer, "serve", str(domain_id()), "f_add", enclave=folder):
            return results("use", "/talker", keystore.environment(), "/f_add")

    found, log = until_found(call)
    error = found["error"]
    assert error.startswith("IncompatibleServiceError") and "protects data but not metadata" in error, found
    assert log.count("a peer on Fast DDS was found, and the governance rule '*' protects data") == 1, log


# ----------------------------------------------------------------------------------------------------- rclpy programs


RCLPY_LISTENER = """
import sys, rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.node import Node
from std_msgs.msg import String

rclpy.init(args=sys.argv)
node, received = Node("listen"), []
node.create_subscription(String, "chatter", lambda message: received.append(message.data), 10)
client = node.create_client(AddTwoInts, "add")
if client.wait_for_service(timeout_sec=float(sys.argv[1])):
    call = client.call_async(AddTwoInts.Request(a=2, b=3))
    rclpy.spin_until_future_complete(node, call, timeout_sec=20)
    while not received:
        rclpy.spin_once(node)
    print(call.result().sum, received[0])
    while len(node.get_node_names()) < 2:  # names come on a topic of their own, and may come later than the response
        rclpy.spin_once(node, timeout_sec=0.1)
print(sorted(node.get_node_names_and_namespaces_with_enclaves()))
node.destroy_node()
rclpy.shutdown()
"""


def test_rclpy_programs_use_security_settings(keystore: Keystore, tmp_path: Path) -> None:
    for name in ("/talker", "/listener"):
        keystore.enclave(name)
    (tmp_path / "listener.py").write_text(RCLPY_LISTENER)

    def listener(timeout_s: int, *arguments: str, **more: str) -> subprocess.CompletedProcess[str]:
        return command(
            *("run", str(tmp_path / "listener.py"), str(timeout_s), *arguments),
            environ={**keystore.environment(), **more},
        )

    with talking("talk", "/talker", keystore.environment()):
        secured, plain, missing = side_by_side(
            lambda: listener(20, "--ros-args", "--enclave", "/listener"),
            lambda: listener(2, ROS_SECURITY_ENABLE="false"),
            lambda: listener(2, "--ros-args", "--enclave", "/nowhere"),
        )
    assert secured.stdout.startswith("5 secret "), secured
    assert secured.stdout.endswith("[('listen', '/', '/listener'), ('talk', '/', '/talker')]\n"), secured
    assert plain.stdout == "[('listen', '/', '/')]\n", plain
    assert "RCLError: failed to initialize rcl: ROS_SECURITY_STRATEGY=Enforce requires a secured" in missing.stderr
