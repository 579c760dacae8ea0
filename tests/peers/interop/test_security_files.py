"""Keystores of ``rosidl-py security`` and of SROS2, used by secured programs on Cyclone DDS and Fast DDS."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from support.local_network import domain_id
from support.sros2_keystore import unpack

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.needs("cryptography")
TOPIC = "rt/chatter"
POLICY = """\
<policy version="0.2.0">
  <enclaves>
    <enclave path="/talker">
      <profiles>
        <profile ns="/" node="talker"><topics publish="ALLOW"><topic>chatter</topic></topics></profile>
      </profiles>
    </enclave>
    <enclave path="/listener">
      <profiles>
        <profile ns="/" node="listener">
          <topics subscribe="ALLOW"><topic>chatter</topic><topic>secret</topic></topics>
          <topics subscribe="DENY"><topic>secret</topic></topics>
        </profile>
      </profiles>
    </enclave>
  </enclaves>
</policy>
"""


def security(*words: str) -> None:
    """Run a command for the domain of the test, in a process of its own."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain_id())}
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "security", *words]
    subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)


@pytest.fixture
def keystore(tmp_path: Path) -> Path:
    """A keystore whose enclaves /talker and /listener may use all topics."""
    root = tmp_path / "keystore"
    security("generate_artifacts", "-k", str(root), "-e", "/talker", "/listener")
    return root


@pytest.fixture(params=["cyclone", "fastdds"])
def start(request: pytest.FixtureRequest, run_peer: Callable[..., Any]) -> Callable[..., Any]:
    """Start a secured peer: what it does, its topic, and the folder of its enclave."""
    program = request.getfixturevalue(f"{request.param}_peer")
    domain = [str(domain_id())] if request.param == "fastdds" else []

    def start(action: str, topic: str, folder: Path) -> Any:
        return run_peer(program, action, *domain, topic, enclave=folder)

    return start


def output(process: subprocess.Popen[str], timeout_s: float) -> str:
    """Return the next line of a peer, or an empty text after the timeout."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], timeout_s)
    return process.stdout.readline() if ready else ""


def test_peers_communicate_with_permissions_generated_from_policy(
    keystore: Path, start: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "policy.xml").write_text(POLICY)
    security("generate_artifacts", "-k", str(keystore), "-p", str(tmp_path / "policy.xml"))
    enclaves = keystore / "enclaves"
    with start("talk", TOPIC, enclaves / "talker"), start("listen", TOPIC, enclaves / "listener") as listener:
        assert output(listener, 20) == "GOT secret\n"


@pytest.mark.parametrize(
    ("action", "topic", "enclave"),
    [("talk", TOPIC, "listener"), ("listen", "rt/secret", "listener"), ("talk", "rt/other", "talker")],
)
def test_endpoints_not_allowed_by_policy_are_refused(
    keystore: Path,
    run_peer: Callable[..., Any],
    cyclone_peer: Path,
    tmp_path: Path,
    action: str,
    topic: str,
    enclave: str,
) -> None:
    (tmp_path / "policy.xml").write_text(POLICY)
    for name in ("/talker", "/listener"):
        security("create_permission", str(keystore), name, str(tmp_path / "policy.xml"))
    kind = "writer" if (action, topic) == ("talk", TOPIC) else "topic"
    first = f"FAILED {kind}: Not Allowed By Security\n"
    with run_peer(cyclone_peer, action, topic, enclave=keystore / "enclaves" / enclave, first_line=first):
        pass


def test_peers_communicate_with_extended_keystore_of_sros2(tmp_path: Path, start: Callable[..., Any]) -> None:
    """The talker is an enclave that SROS2 made; its permissions are renewed for the domain of the test."""
    root = unpack(tmp_path / "sros2")
    key = (root / "enclaves/talker/key.pem").read_bytes()
    governance = root / "enclaves/governance.xml"
    governance.write_text(governance.read_text().replace("<id>0</id>", f"<id>{domain_id()}</id>"))
    (root / "enclaves/governance.p7s").unlink()
    security("create_keystore", str(root))
    for name in ("/talker", "/made_here"):
        security("create_enclave", str(root), name)
    assert (root / "enclaves/talker/key.pem").read_bytes() == key
    enclaves = root / "enclaves"
    with start("talk", TOPIC, enclaves / "talker"), start("listen", TOPIC, enclaves / "made_here") as listener:
        assert output(listener, 20) == "GOT secret\n"
