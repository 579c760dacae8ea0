"""Real rclpy nodes as peers, in a network namespace of this test process. They are on Fast DDS; Humble and Lyrical also
on Cyclone DDS.

If the system refuses a namespace, all of them stay on this machine, as our nodes always do.
"""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.environments import rclpy_python
from support.node_fixtures import SHORT_LEASE, dds, domain_id, only_loopback, pytest_pyfunc_call

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

sys.path.insert(0, str(Path(__file__).parent))

from private_network import PrivateNetwork
from rclpy_peer import ANSWER_S, Peer

__all__ = ["dds", "only_loopback", "pytest_pyfunc_call"]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "only_with(*distros): there is no such test with other distributions")
    config.addinivalue_line("markers", "about_fast_dds(reason): there is no such test with peers on Cyclone DDS")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect tests for features that a distribution or a middleware does not have."""

    def exists(item: pytest.Item) -> bool:
        marker, name = item.get_closest_marker("only_with"), item.name.replace(f"[{CYCLONE}", "[")
        if name != item.name and item.get_closest_marker("about_fast_dds") is not None:
            return False
        return marker is None or any(f"[{distro}" in name for distro in marker.args)

    config.hook.pytest_deselected(items=[item for item in items if not exists(item)])
    items[:] = filter(exists, items)


HUMBLE = ["humble"] if "ROSIDL_PEER_HUMBLE" in os.environ else []
"""No package index has Humble: support/build_humble_peer.sh builds it."""
LYRICAL = ["lyrical"] if "ROSIDL_PEER_LYRICAL" in os.environ else []
"""No package index has Lyrical: the variable names a folder whose bin/python has rclpy of Lyrical."""


CYCLONE = "cyclone_"
"""Begins the names of distributions whose peers use Cyclone DDS."""


BUILT = [*HUMBLE, *LYRICAL]


@pytest.fixture(scope="session", params=["jazzy", "kilted", *BUILT, *(CYCLONE + name for name in BUILT)])
def _make(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="session")
def distro(_make: str) -> str:
    return _make.removeprefix(CYCLONE)


@pytest.fixture(scope="session")
def is_on_cyclone(_make: str) -> bool:
    return _make.startswith(CYCLONE)


@pytest.fixture(autouse=True)
def _distribution_of_ours(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Select Humble beside Humble, whose nodes may take gigabytes when they read graph messages of later ones."""
    if "distro" in request.fixturenames and request.getfixturevalue("distro") == "humble":
        monkeypatch.setenv("ROS_DISTRO", "humble")


@pytest.fixture(scope="session")
def _pythons() -> dict[str, Path]:
    """Create the environments before a test enters the private network, from which no index can be reached."""
    return {name: rclpy_python(name) for name in ("jazzy", "kilted", *BUILT)}


@pytest.fixture(scope="session")
def peer_python(distro: str, _pythons: dict[str, Path]) -> Path:
    return _pythons[distro]


@pytest.fixture(scope="session")
def _network(_pythons: dict[str, Path]) -> Iterator[PrivateNetwork | None]:
    try:
        made = PrivateNetwork()
    except OSError:
        yield None
        return
    yield made
    made.close()


@pytest.fixture(scope="module", autouse=True)
def _inside(_network: PrivateNetwork | None) -> Iterator[None]:
    """Run the tests of this folder in the private network, where nodes of other tests are invisible."""
    with nullcontext() if _network is None else _network.entered():
        yield


_ON_LOOPBACK = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast>"
    '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>'
    '<Discovery><Peers><Peer address="localhost"/></Peers><ParticipantIndex>auto</ParticipantIndex>'
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>"
)


@pytest.fixture(scope="session")
def start_peer(
    distro: str, is_on_cyclone: bool, peer_python: Path, _network: PrivateNetwork | None
) -> Iterator[Callable[..., Peer]]:
    """Return a function that starts peers, which end with the last test of the distribution.

    A `wide` peer discovers in the whole private network. On Fast DDS it is found at once if it starts before our node,
    else never. Those on Cyclone DDS are never wide, and get no ROS_LOCALHOST_ONLY: rmw_cyclonedds of Humble then adds
    the loopback interface to those of CYCLONEDDS_URI, and the domain refuses one that is there twice.
    """
    with ExitStack() as started:

        def start(name: str, *arguments: str, wide: bool = False, **settings: str) -> Peer:
            if is_on_cyclone:
                settings["CYCLONEDDS_URI"] = f"{_ON_LOOPBACK},{settings.get('CYCLONEDDS_URI', '')}".rstrip(",")
                settings["RMW_IMPLEMENTATION"] = "rmw_cyclonedds_cpp"
                settings["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # Humble ignores it
            elif _network is None or not wide:
                settings |= {"ROS_LOCALHOST_ONLY": "1"} if distro == "humble" else {}
                settings["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            with nullcontext() if _network is None else _network.entered():
                peer = Peer(peer_python, name, distro, *arguments, domain_id=domain_id(), **settings)
            started.callback(peer.close)
            return peer

        yield start


@pytest.fixture(scope="session")
def _shared_peer(start_peer: Callable[..., Peer]) -> Peer:
    return start_peer("shared_peer", wide=True)


@pytest.fixture
def shared_peer(_shared_peer: Peer) -> Iterator[Peer]:
    """Return a peer for many tests, which use names of their own; its entities are destroyed after the test."""
    yield _shared_peer
    _shared_peer.start("clear").result(ANSWER_S)


_SHORT_LEASE = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="mortal" is_default_profile="true"><rtps><builtin><discovery_config>
    <leaseDuration><sec>6</sec></leaseDuration><leaseAnnouncement><sec>1</sec></leaseAnnouncement>
  </discovery_config></builtin></rtps></participant>
</profiles>
"""


@pytest.fixture
def start_mortal(start_peer: Callable[..., Peer], tmp_path: Path) -> Callable[[str], Peer]:
    """Return a function that starts peers that may be killed, with a lease of 6 s instead of 20 s.

    With a shorter lease, a busy machine that loses packets declares living peers dead.
    """
    file = tmp_path / "profiles.xml"
    file.write_text(_SHORT_LEASE)
    names = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")  # of Fast DDS 2 and 3
    settings = {**dict.fromkeys(names, str(file)), **SHORT_LEASE}
    return lambda name: start_peer(name, **settings)
