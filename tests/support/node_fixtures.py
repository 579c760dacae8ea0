"""Worlds for tests with nodes: a test that uses `world` runs on the memory transport, and on real DDS and Zenoh where
that matters (`transports`); every test that uses `network` runs on DDS and on Zenoh, with processes of its own.

All stay on this machine: a fixture sets the environment so, refuses to join a domain that is not loopback only or not
one of ours, and to open a session of Zenoh that listens elsewhere. Zenoh's sessions meet at a router in this process.
Async test functions run on an event loop of their own. A conftest takes from here what its tests need.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import functools
import inspect
import itertools
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import zenoh

from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.runtime import Context, LoopRunner, MemoryTransport, Node
from rosidl_py_gen.runtime.loop.virtual_time import VirtualTimeLoop
from rosidl_py_gen.runtime.transport.api import SYSTEM_CLOCKS, ClockFunctions
from rosidl_py_gen.runtime.transport.cyclone import library
from support.machine_locks import holds, lock

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterator

    from rosidl_py_gen.runtime import Client, Publisher, ServiceServer, Subscription

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [
    "example_interfaces",
    "geometry_msgs",
    "nav_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "visualization_msgs",
]
GENERATED = tempfile.TemporaryDirectory(prefix="runtime-tests-")
atexit.register(GENERATED.cleanup)
generate(scan_search_path([interfaces_dir()], ament="", bundled=False), PACKAGES, Path(GENERATED.name))
sys.path.insert(0, GENERATED.name)

WAITS = re.compile(
    r"topic \S+ does not appear to be published yet; waiting for it\n|"
    r"Waiting for at least \d+ matching subscription\(s\) on \S+\.\.\.\n"
)
"""Notes that commands print on a busy machine while they wait."""
FIRST_DOMAIN, DOMAINS = 10, 45
"""Twice as many as `DOMAINS`, and none above 100: no other socket is given their ports (docs/howto/network.md)."""
_LOCAL_ENDPOINTS = ("tcp/127.0.0.1:", "tls/127.0.0.1:", "tcp/localhost:", "tls/localhost:", "tcp/[::1]:")
_open_session = zenoh.open
ON_ZENOH = {
    "test_action_bytes.py",
    "test_action_clients.py",
    "test_actions.py",
    "test_arrays.py",
    "test_buffer.py",
    "test_contexts.py",
    "test_loop_runner.py",
    "test_introspection.py",
    "test_lifecycle.py",
    "test_lost_results.py",
    "test_lost_servers.py",
    "test_adaptive.py",
    "test_node.py",
    "test_parameter_client.py",
    "test_peer_definitions.py",
    "test_parameter_services.py",
    "test_parameter_threads.py",
    "test_plain_scripts.py",
    "test_services.py",
    "test_sim_time.py",
    "test_sim_time_sleep.py",
    "test_stress.py",
    "test_take.py",
    "test_threads_and_loops.py",
    "test_topics.py",
    "test_type_description.py",
    "test_unmatched.py",
}
"""Files whose tests run on Zenoh as well where they run on DDS."""


_domains: dict[int, int] = {}
"""Domain IDs locked by this test process, with the lock's descriptor."""


def new_domain_id() -> int:
    """Return a domain that neither another test process of this machine nor this one uses."""
    start = os.getpid() * 7
    all_of_them = (FIRST_DOMAIN + (start + offset) % DOMAINS for offset in range(DOMAINS))
    for number in all_of_them:
        held = lock(f"domain-{number}", wait=False)
        if held is not None:
            _domains[number] = held
            return number
    raise LookupError("other test processes have all domains")


@functools.cache
def domain_id() -> int:
    """Return the domain of this test process, so that parallel runs do not discover each other."""
    return new_domain_id()


def second_domain_id() -> int:
    """Return a second domain that only this test process uses."""
    return domain_id() + DOMAINS


@functools.cache
def zenoh_router() -> str:
    from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

    router = ZenohRouter({}, print, listen=["tcp/127.0.0.1:0"])
    atexit.register(router.close)
    return router.endpoints[0]


def zenoh_environment() -> dict[str, str]:
    """Return the variables of nodes and peers that use the router of this process on the loopback interface."""
    endpoints = f'connect/endpoints=["{zenoh_router()}"];listen/endpoints=["tcp/127.0.0.1:0"]'
    return {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": endpoints}


def world_on_zenoh(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    for name, value in zenoh_environment().items():
        monkeypatch.setenv(name, value)
    made = World("zenoh")
    yield made
    made.close()


@pytest.fixture(autouse=True)
def only_loopback(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Force discovery onto localhost; any other participant fails the test."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id()))
    for name in ("CYCLONEDDS_URI", "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY"):
        monkeypatch.delenv(name, raising=False)
    for name in ("RMW_IMPLEMENTATION", *(name for name in os.environ if "ZENOH_" in name)):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", "off")
    monkeypatch.setattr(sys, "argv", ["test"])
    if library.is_found():
        _guard_dds(monkeypatch)
    monkeypatch.setattr(zenoh, "open", guarded_open)
    yield
    Context.close_default()
    lost = [number for number, held in _domains.items() if not holds(held, f"domain-{number}")]
    assert not lost, f"something closed the locks of the domains {lost}, which are another's descriptors"


def _guard_dds(monkeypatch: pytest.MonkeyPatch) -> None:
    from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone

    original = cyclone.Domain.join

    def guarded(api: Any, fast_dds: Any, number: int, xml: str, enclave_folder: str) -> cyclone.Domain:
        # Cyclone before 11 is not bound, and told by "localhost" alone where to look (docs/internals/dds.md 8).
        assert 'address="127.0.0.1"' in xml or fast_dds.loopback_refusal, f"not bound to loopback: {xml}"
        assert '<Peer address="localhost"/>' in xml or "ros_discovery_off" in xml, xml
        assert xml.count("<AllowMulticast>false</AllowMulticast>") > 0, f"multicast is on: {xml}"
        assert number in _domains or number - DOMAINS in _domains, f"domain {number} is not this test run's"
        return original(api, fast_dds, number, xml, enclave_folder)

    monkeypatch.setattr(cyclone.Domain, "join", guarded)


def guarded_open(config: Any) -> Any:
    """Open a session of Zenoh that cannot be reached from elsewhere."""
    from rosidl_py_gen.runtime.transport.zenoh.config import endpoints_of

    for what in ("listen", "connect"):
        strange = [one for one in endpoints_of(config, what) if not one.startswith(_LOCAL_ENDPOINTS)]
        assert not strange, f"not bound to loopback: {what} {strange}"
    assert config.get_json("scouting/multicast/enabled") == "false"
    return _open_session(config)


class World:
    """Contexts and nodes that see each other, all closed at the end of the test."""

    def __init__(self, kind: str, clocks: ClockFunctions = SYSTEM_CLOCKS) -> None:
        self.kind = kind
        self.transport = MemoryTransport(clocks) if kind == "memory" else kind
        self.contexts: list[Context] = []
        self.nodes: list[Node] = []
        self._numbers = itertools.count()

    def context(self, *args: str, loop_runner: LoopRunner | None = None) -> Context:
        """A context of this world; `args` is a command line without program name, in words or as a whole."""
        context = Context(transport=self.transport, args=["test", *" ".join(args).split()], loop_runner=loop_runner)
        self.contexts.append(context)
        return context

    def node(
        self, name: str = "", namespace: str = "", *, context: Context | None = None, args: str = "", **options: Any
    ) -> Node:
        """Return a node, in a new context unless one is given."""
        name = name or f"node{next(self._numbers)}"
        node = Node(name, namespace, context=context or self.context(args), **options)
        self.nodes.append(node)
        return node

    def pair(self) -> tuple[Node, Node]:
        """Return two nodes in two contexts."""
        return self.node("alice"), self.node("bob")

    async def connected(
        self, msg_type: Any, topic: str, qos: Any = 10, *, callback: Any = None, **options: Any
    ) -> tuple[Publisher[Any], Subscription[Any]]:
        """Return a publisher of alice and a subscription of bob, matched; the options are those of the subscription."""
        alice, bob = self.pair()
        subscription: Subscription[Any] = bob.create_subscription(msg_type, topic, callback, qos, **options)
        publisher: Publisher[Any] = alice.create_publisher(msg_type, topic, qos)
        assert await publisher.wait_for_subscribers(timeout_s=5)
        return publisher, subscription

    async def served(
        self, srv_type: Any, name: str, handler: Any = None
    ) -> tuple[ServiceServer[Any, Any], Client[Any, Any]]:
        """Return a server of alice and a client of bob, matched."""
        alice, bob = self.pair()
        server: ServiceServer[Any, Any] = alice.create_service(srv_type, name, handler)
        client: Client[Any, Any] = bob.create_client(srv_type, name)
        assert await client.wait_for_service(timeout_s=5)
        return server, client

    def close(self) -> None:
        """Close all contexts; none of their threads may survive."""
        for context in self.contexts:
            context.close()
        names = [thread.name for thread in threading.enumerate() if thread.name.startswith("rosidl-py-gen")]
        assert names == []


_LOOP = pytest.StashKey[VirtualTimeLoop]()


def _clocks(item: Any) -> ClockFunctions:
    """Virtual clocks, for async tests whose worlds are all in memory."""
    kinds = {item.callspec.params[name] for name in ("world", "network") if name in _params(item)}
    takes_time = item.get_closest_marker("real_time") is not None or not inspect.iscoroutinefunction(item.obj)
    if takes_time or "dds" in item.fixturenames or kinds - {"memory"}:
        return SYSTEM_CLOCKS
    if _LOOP not in item.stash:
        item.stash[_LOOP] = VirtualTimeLoop(limit_s=90)
    return item.stash[_LOOP].clocks


def _params(item: Any) -> dict[str, Any]:
    callspec = getattr(item, "callspec", None)
    return {} if callspec is None else callspec.params


@pytest.fixture
def world(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    for name, value in zenoh_environment().items() if request.param == "zenoh" else ():
        monkeypatch.setenv(name, value)
    made = World(request.param, _clocks(request.node))
    yield made
    made.close()


network = world
"""Yield a `world` for tests with processes: on DDS and on Zenoh, which new processes of the test use, too."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Parametrize tests that have a `world` or a `network` with transports; `transports` has the rule."""
    refusal = metafunc.definition.get_closest_marker("without_zenoh")
    if "world" in metafunc.fixturenames:
        metafunc.parametrize("world", transports(metafunc), indirect=True)
    if "network" in metafunc.fixturenames:
        metafunc.parametrize("network", ["dds", *["zenoh"] * (refusal is None)], indirect=True)


def transports(metafunc: pytest.Metafunc) -> list[str]:
    """Return the transports of a test with a `world`: memory, or all if transports may behave differently.

    Marked `every_transport` are tests of delivery, order, matching, quality of service, discovery, loss, matching of
    replies to requests, and closing, and one journey of each feature. With `--all-transports` the others run
    everywhere, too.
    """
    definition = metafunc.definition
    marked = definition.get_closest_marker("every_transport") is not None
    if not (marked or metafunc.config.getoption("--all-transports")):
        return ["memory"]
    has_zenoh = definition.get_closest_marker("without_zenoh") is None
    return ["memory", "dds", *["zenoh"] * (has_zenoh and definition.path.name in ON_ZENOH)]


@pytest.fixture
def memory(request: pytest.FixtureRequest) -> Iterator[World]:
    """A world on the memory transport only."""
    made = World("memory", _clocks(request.node))
    yield made
    made.close()


@pytest.fixture
def dds() -> Iterator[World]:
    """A world on DDS only."""
    made = World("dds")
    yield made
    made.close()


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run async tests; none needs more than a few seconds, but several processes on a busy machine may."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    arguments = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    if _LOOP in pyfuncitem.stash:
        pyfuncitem.stash[_LOOP].run(pyfuncitem.obj(**arguments))
        return True
    asyncio.run(asyncio.wait_for(pyfuncitem.obj(**arguments), 90 if "soak" not in pyfuncitem.name else None))
    return True


def run(main: Callable[[], Coroutine[Any, Any, None]], timeout_s: float = 20) -> None:
    """Run an async test."""
    asyncio.run(asyncio.wait_for(main(), timeout_s))


async def until(condition: Callable[[], object], timeout_s: float = 20) -> None:
    deadline = asyncio.get_running_loop().time() + timeout_s
    while not condition():
        assert asyncio.get_running_loop().time() < deadline, "never happened"
        await asyncio.sleep(0.001)


def wait_until(condition: Callable[[], object], timeout_s: float = 20) -> None:
    """Wait as `until` does, in code without an event loop."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "never happened"
        time.sleep(0.005)


def while_the_loop_sleeps(act: Callable[[], object]) -> threading.Thread:
    """Do something in another thread, which alone can wake the loop of this one; the thread, for `join`."""

    def wait_and_act() -> None:
        time.sleep(0.1)  # the loop sleeps by now; if it does not yet, the test shows less, and passes
        act()

    thread = threading.Thread(target=wait_and_act)
    thread.start()
    return thread


async def rests(for_s: float, cpu_s: float) -> bool:
    """Return True if this process takes less than `cpu_s` of CPU time while the loop sleeps, in one of three attempts.

    On a VM, stolen CPU time counts as ours.
    """
    for _ in range(3):
        before = time.process_time()
        await asyncio.sleep(for_s)  # what is measured
        if time.process_time() - before < cpu_s:
            return True
    return False


def held_up(cpu_s: float = 0.05) -> float:
    began, cpu = time.perf_counter(), time.thread_time()
    while time.thread_time() - cpu < cpu_s:
        pass
    return (time.perf_counter() - began) / (time.thread_time() - cpu)


_SHORT_LEASE = "<Domain><Discovery><LeaseDuration>6s</LeaseDuration></Discovery></Domain>"
SHORT_LEASE = {"CYCLONEDDS_URI": f"<CycloneDDS>{_SHORT_LEASE}</CycloneDDS>"}
"""For processes that are killed: they are missed after 6 s, not 10."""
_SOON_MISSED = "<LeaseDuration>5s</LeaseDuration><SPDPInterval>1s</SPDPInterval>"
SOON_MISSED = "CYCLONEDDS_URI", f"<CycloneDDS><Domain><Discovery>{_SOON_MISSED}</Discovery></Domain></CycloneDDS>"
"""For contexts that Fast DDS shall miss when they are closed: after 5 s, not 10. Five announcements in that time are
enough where a machine is held up."""

_guards: set[asyncio.Task[None]] = set()


async def start_process(*command: str | Path, **options: Any) -> asyncio.subprocess.Process:
    """`asyncio.create_subprocess_exec`, but the process ends with the loop, also when the test fails.

    A subprocess transport collected after its loop closed prints a ResourceWarning.
    """
    process = await asyncio.create_subprocess_exec(*command, **options)

    async def guard() -> None:
        try:
            await process.wait()
        except asyncio.CancelledError:  # by `asyncio.run`, at its end
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.communicate()  # closes its pipes
            raise

    task = asyncio.ensure_future(guard())
    _guards.add(task)
    task.add_done_callback(_guards.discard)
    return process


def entity(owner: Any, name: str) -> Any:
    """Return the entity of a node, or of an action client or server, whose topic or service name ends with `name`."""
    entities = getattr(owner, "_parts", owner._scope).owned.values()
    return next(one for one in entities if str(getattr(one, "topic", getattr(one, "name", ""))).endswith(name))


async def take(stream: Any) -> Any:
    """Return the next item."""
    return await asyncio.wait_for(stream.__anext__(), 20)


@contextlib.contextmanager
def running_process(
    *command: str | Path, cwd: Path | None = None, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """Run a program with pipes for its input, output and errors; kill it at the end of the block."""
    pipe, changed = subprocess.PIPE, {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    process = subprocess.Popen(command, cwd=cwd, env=changed, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def python_process(
    program: str, *arguments: str, **environment: str
) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    """Run the text of a Python program as `running_process`."""
    return running_process(sys.executable, "-W", "default", "-c", program, *arguments, **environment)
