"""Real rclpy nodes on Fast DDS as peers, in a network of this test process alone.

Where the system lets us have no such network all of them are told to stay on this machine, as our nodes always are.
"""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.environments import environment
from support.node_fixtures import dds, domain_id, only_loopback, pytest_pyfunc_call

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

sys.path.insert(0, str(Path(__file__).parent))

from private_network import PrivateNetwork
from rclpy_peer import REQUIREMENTS, Peer

__all__ = ["dds", "only_loopback", "pytest_pyfunc_call"]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "only_with(distro): there is no such test with the other distribution")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave tests out that need what one distribution does not have."""

    def exists(item: pytest.Item) -> bool:
        marker = item.get_closest_marker("only_with")
        return marker is None or f"[{marker.args[0]}" in item.name

    config.hook.pytest_deselected(items=[item for item in items if not exists(item)])
    items[:] = filter(exists, items)


@pytest.fixture(scope="session", params=["jazzy", "kilted"])
def distro(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="session")
def _pythons() -> dict[str, Path]:
    """One for each distribution, made before anything is in the private network, from which no index can be reached."""
    pythons = {}
    for name, requirements in REQUIREMENTS.items():
        made = os.environ.get(f"ROSIDL_PEER_{name.upper()}")
        pythons[name] = Path(made, "bin", "python") if made else environment(f"rclpy-{name}", requirements)
    return pythons


@pytest.fixture(scope="session")
def peer_python(distro: str, _pythons: dict[str, Path]) -> Path:
    """A Python that can import rclpy; $ROSIDL_PEER_JAZZY and ..._KILTED name environments that are there already."""
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
    """The tests of this folder run inside, the others do not; nodes of either never see each other."""
    with nullcontext() if _network is None else _network.entered():
        yield


@pytest.fixture(scope="session")
def start_peer(distro: str, peer_python: Path, _network: PrivateNetwork | None) -> Iterator[Callable[..., Peer]]:
    """Starts peers, which are ended when all tests with this distribution are done, if not earlier.

    A peer that is `wide` looks for others in the whole network if that is ours alone. Started before our node it is
    found at once, started later not at all.
    """
    with ExitStack() as started:

        def start(name: str, *arguments: str, wide: bool = False, **settings: str) -> Peer:
            if _network is None or not wide:
                settings["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            with nullcontext() if _network is None else _network.entered():
                peer = Peer(peer_python, name, distro, *arguments, domain_id=domain_id(), **settings)
            started.callback(peer.close)
            return peer

        yield start


@pytest.fixture(scope="session")
def shared_peer(start_peer: Callable[..., Peer]) -> Peer:
    """One peer for many tests; each uses names of its own. It is found at once, others within a second."""
    return start_peer("shared_peer", wide=True)


_SHORT_LEASE = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="mortal" is_default_profile="true"><rtps><builtin><discovery_config>
    <leaseDuration><sec>6</sec></leaseDuration><leaseAnnouncement><sec>1</sec></leaseAnnouncement>
  </discovery_config></builtin></rtps></participant>
</profiles>
"""


@pytest.fixture
def start_mortal(start_peer: Callable[..., Peer], tmp_path: Path) -> Callable[[str], Peer]:
    """Starts peers that may be killed: they are missed after 6 seconds, not 20 as they come. Less is not enough
    where a machine is held up and packets are lost: who is missed too early gets no reply."""
    file = tmp_path / "profiles.xml"
    file.write_text(_SHORT_LEASE)
    names = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")  # of Fast DDS 2 and 3
    return lambda name: start_peer(name, **dict.fromkeys(names, str(file)))
