"""Real rclpy nodes as peers: of Jazzy and Kilted on Fast DDS, and the built ones in the folder $ROSIDL_PEERS.

DDS is in a network namespace of this test process. If the system refuses a namespace, peers stay on this machine, as
our nodes always do. Zenoh stays on the loopback interface: the threads of its runtime remain in the namespace in which
a test of this process first used Zenoh.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.environments import built_peers, rclpy_python
from support.local_network import domain_id, zenoh_environment
from support.processes import SHORT_LEASE
from support.worlds import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

sys.path.insert(0, str(Path(__file__).parent))

from private_network import PrivateNetwork
from rclpy_peer import ANSWER_S, Peer

FAST_DDS, CYCLONE_DDS, ZENOH = "Fast DDS", "Cyclone DDS", "Zenoh"
PREFIXES = {"cyclone_": CYCLONE_DDS, "zenoh_": ZENOH, "": FAST_DDS}
"""Middlewares by the beginning of a peer's name; the rest of the name is the distribution."""
NAMES = list(dict.fromkeys(["jazzy", "kilted", *built_peers()]))


def split_name(name: str) -> tuple[str, str]:
    """Return middleware and distribution of a peer."""
    prefix = next(one for one in PREFIXES if name.startswith(one))
    return PREFIXES[prefix], name.removeprefix(prefix)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "only_with(*distros): there is no such test with other distributions")
    config.addinivalue_line("markers", "about_fast_dds(reason): there is no such test with peers on other middlewares")
    config.addinivalue_line("markers", "about_dds(reason): there is no such test with peers on Zenoh")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect tests for features that a distribution or a middleware does not have."""

    def exists(item: pytest.Item) -> bool:
        only_with = item.get_closest_marker("only_with")
        name = getattr(getattr(item, "callspec", None), "params", {}).get("peer_name")
        if name is None:
            return only_with is None
        middleware, distro = split_name(name)
        if middleware != FAST_DDS and item.get_closest_marker("about_fast_dds") is not None:
            return False
        if middleware == ZENOH and item.get_closest_marker("about_dds") is not None:
            return False
        return only_with is None or distro in only_with.args

    config.hook.pytest_deselected(items=[item for item in items if not exists(item)])
    items[:] = filter(exists, items)


@pytest.fixture(scope="session", params=NAMES)
def peer_name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="session")
def distro(peer_name: str) -> str:
    return split_name(peer_name)[1]


@pytest.fixture(scope="session")
def middleware(peer_name: str) -> str:
    return split_name(peer_name)[0]


@pytest.fixture(autouse=True)
def _settings_of_ours(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, only_loopback: None) -> None:
    """Select the middleware for our nodes, and Humble beside Humble.

    Nodes of Humble may take gigabytes when they read graph messages of later distributions.
    """
    if "peer_name" in request.fixturenames:
        if request.getfixturevalue("distro") == "humble":
            monkeypatch.setenv("ROS_DISTRO", "humble")
        if request.getfixturevalue("middleware") == ZENOH:
            for name, value in zenoh_environment().items():
                monkeypatch.setenv(name, value)


@pytest.fixture
def world(middleware: str, _settings_of_ours: None) -> Iterator[World]:
    """World on the transport of the peer."""
    made = World("zenoh" if middleware == ZENOH else "dds")
    yield made
    made.close()


@pytest.fixture(scope="session")
def _pythons() -> dict[str, Path]:
    """Create the environments before a test enters the private network, from which no index can be reached."""
    return {name: rclpy_python(name) for name in NAMES}


@pytest.fixture(scope="session")
def peer_python(peer_name: str, _pythons: dict[str, Path]) -> Path:
    return _pythons[peer_name]


@pytest.fixture(scope="session")
def _network(_pythons: dict[str, Path]) -> Iterator[PrivateNetwork | None]:
    try:
        made = PrivateNetwork()
    except OSError:
        yield None
        return
    yield made
    made.close()


@pytest.fixture(autouse=True)
def _inside(request: pytest.FixtureRequest, _network: PrivateNetwork | None) -> Iterator[None]:
    """Run a test on DDS in the private network, where nodes of other tests are invisible."""
    is_on_zenoh = "peer_name" in request.fixturenames and request.getfixturevalue("middleware") == ZENOH
    with nullcontext() if _network is None or is_on_zenoh else _network.entered():
        yield


_ON_LOOPBACK = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast>"
    '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>'
    '<Discovery><Peers><Peer address="localhost"/></Peers><ParticipantIndex>auto</ParticipantIndex>'
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>"
)


@pytest.fixture(scope="session")
def start_peer(
    distro: str, middleware: str, peer_python: Path, _network: PrivateNetwork | None
) -> Iterator[Callable[..., Peer]]:
    """Return a function that starts peers, which end with the last test of the peer's name.

    A `wide` peer discovers in the whole private network. On Fast DDS it is found at once if it starts before our node,
    else never. Peers on Cyclone DDS are never wide, and get no ROS_LOCALHOST_ONLY: rmw_cyclonedds of Humble then adds
    the loopback interface to the interfaces of CYCLONEDDS_URI, and the domain refuses one that is there twice.
    """
    network = None if middleware == ZENOH else _network
    with ExitStack() as started:

        def start(name: str, *arguments: str, wide: bool = False, **settings: str) -> Peer:
            if middleware == ZENOH:
                settings |= zenoh_environment()
            elif middleware == CYCLONE_DDS:
                settings["CYCLONEDDS_URI"] = f"{_ON_LOOPBACK},{settings.get('CYCLONEDDS_URI', '')}".rstrip(",")
                settings["RMW_IMPLEMENTATION"] = "rmw_cyclonedds_cpp"
                settings["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # Humble ignores it
            elif network is None or not wide:
                settings |= {"ROS_LOCALHOST_ONLY": "1"} if distro == "humble" else {}
                settings["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            with nullcontext() if network is None else network.entered():
                peer = Peer(
                    peer_python,
                    name,
                    *arguments,
                    middleware=middleware,
                    distro=distro,
                    domain_id=domain_id(),
                    **settings,
                )
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
