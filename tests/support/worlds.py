"""Worlds: contexts and nodes that see each other.

A test with the fixture `world` runs on the memory transport, and with `@pytest.mark.every_transport` also on DDS and on
Zenoh (`transports`). `memory` and `dds` use one transport. `network` is for tests with processes: DDS and Zenoh.

Async test functions run on an event loop of their own. If all their worlds are in memory, waiting takes no time.
"""

from __future__ import annotations

import asyncio
import inspect
import itertools
import threading
from typing import TYPE_CHECKING, Any

import pytest

from rosidl_py_gen.runtime import Context, LoopRunner, MemoryTransport, Node
from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop
from rosidl_py_gen.runtime.transport.api import SYSTEM_CLOCKS, ClockFunctions
from support.inner_state import scope_of
from support.local_network import zenoh_environment

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.runtime import Client, Publisher, ServiceServer, Subscription


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
        assert await publisher.wait_for_subscribers(timeout_s=20)
        return publisher, subscription

    async def served(
        self, srv_type: Any, name: str, handler: Any = None
    ) -> tuple[ServiceServer[Any, Any], Client[Any, Any]]:
        """Return a server of alice and a client of bob, matched."""
        alice, bob = self.pair()
        server: ServiceServer[Any, Any] = alice.create_service(srv_type, name, handler)
        client: Client[Any, Any] = bob.create_client(srv_type, name)
        assert await client.wait_for_service(timeout_s=20)
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


def world_on_zenoh(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    for name, value in zenoh_environment().items():
        monkeypatch.setenv(name, value)
    made = World("zenoh")
    yield made
    made.close()


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
    on, without = map(definition.get_closest_marker, ("on_zenoh", "without_zenoh"))
    return ["memory", "dds", *["zenoh"] * (on is not None and without is None)]


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run async tests; none needs more than a few seconds, but several processes on a busy machine may."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    arguments = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    if _LOOP in pyfuncitem.stash:
        pyfuncitem.stash[_LOOP].run(pyfuncitem.obj(**arguments))
        return True
    asyncio.run(asyncio.wait_for(pyfuncitem.obj(**arguments), 180 if "soak" not in pyfuncitem.name else None))
    return True


def entity(owner: Any, name: str) -> Any:
    """Return the entity of a node, or of an action client or server, whose topic or service name ends with `name`."""
    entities = getattr(owner, "_parts", scope_of(owner)).owned.values()
    return next(one for one in entities if str(getattr(one, "topic", getattr(one, "name", ""))).endswith(name))
