"""Foreign peers that are built with packages of Debian and run on loopback, in the domain of the test run.

They need cyclonedds-dev cyclonedds-tools libfastrtps-dev fastddsgen gcc g++. Tests are skipped without these packages,
unless ROSIDL_TEST_REQUIRE_PEERS is set, as in CI.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.environments import kept
from support.local_network import domain_id

from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.library import IGNORE_TYPE_INFORMATION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SOURCES = Path(__file__).parent / "peers"
_CYCLONE_XML = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address='localhost'/></Peers>"
    "<LeaseDuration>{lease_s}s</LeaseDuration></Discovery>"
    "</Domain></CycloneDDS>"
)


@pytest.fixture(autouse=True)
def bound_as_the_peers_are(only_loopback: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bind to loopback, because peers announce only that, and Cyclone before 11 needs it: docs/internals/dds.md 8."""
    if IGNORE_TYPE_INFORMATION in library.find_library().unsupported_elements:
        bound = "<General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces></General>"
        monkeypatch.setenv("CYCLONEDDS_URI", f"<CycloneDDS><Domain>{bound}</Domain></CycloneDDS>")


def _compiled(name: str, programs: tuple[str, ...], *commands: str) -> Path:
    """Return a program that commands make in a folder, where SOURCES stands for that of the sources."""
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        assert "ROSIDL_TEST_REQUIRE_PEERS" not in os.environ, f"missing: {missing}"
        pytest.skip(f"needs {', '.join(missing)}")

    def make(folder: Path) -> None:
        folder.mkdir()
        for command in commands:
            subprocess.run(command, shell=True, cwd=folder, env={**os.environ, "SOURCES": str(SOURCES)}, check=True)

    return kept(name, [*sorted(SOURCES.iterdir()), Path(__file__)], make) / "peer"


@pytest.fixture(scope="session")
def cyclone_peer() -> Path:
    """C program on Cyclone DDS 0.10.2; with `-t` it announces no XTypes information, like endpoints of ROS."""
    generate = "idlc -t $SOURCES/types.idl"
    return _compiled(
        "cyclone-peer", ("idlc", "gcc"), generate, "gcc -O1 -I. types.c $SOURCES/cyclone_peer.c -lddsc -o peer"
    )


@pytest.fixture(scope="session")
def fastdds_peer() -> Path:
    """C++ program on Fast DDS 2.9."""
    generate = "cp $SOURCES/types.idl . && fastddsgen types.idl > fastddsgen.log"
    compile = "g++ -I. *.cxx $SOURCES/fastdds_peer.cpp -lfastrtps -lfastcdr -o peer"
    return _compiled("fastdds-peer", ("fastddsgen", "g++"), generate, compile)


@pytest.fixture(scope="session")
def fastdds_service_peer() -> Path:
    """C++ program on Fast DDS 2.9 with a server and a client like those of rmw_fastrtps of Humble."""
    # The generator proves that the packages of Fast DDS are installed.
    compile = "g++ -std=c++17 $SOURCES/fastdds_service_peer.cpp -lfastrtps -lfastcdr -o peer"
    return _compiled("fastdds-service-peer", ("fastddsgen", "g++"), compile)


@contextmanager
def running(
    program: Path, *arguments: str, lease_s: int = 10, first_line: str = "READY\n", enclave: Path | None = None
) -> Iterator[subprocess.Popen[str]]:
    """Start a peer, wait until it prints `first_line`, and kill it at the end.

    Args:
        lease_s: lease of its participant, on Cyclone DDS.
        enclave: folder of its enclave; None for an unsecured peer.
    """
    environment = {
        **os.environ,
        "CYCLONEDDS_URI": _CYCLONE_XML.replace("<Domain>", f"<Domain Id='{domain_id()}'>").format(lease_s=lease_s),
        **({} if enclave is None else {"SECURE_ENCLAVE": str(enclave)}),
    }
    process = subprocess.Popen([str(program), *arguments], env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == first_line
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def run_peer() -> Callable[..., object]:
    return running
