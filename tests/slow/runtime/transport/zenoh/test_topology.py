"""Nodes with several routers: a line of three, and a router that stops and restarts."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String
from support.inner_state import participant_of
from support.waiting import until
from support.worlds import World

from rosidl_py_gen.runtime.transport.zenoh.router import ZenohRouter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime import Node


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes routers."""
    with ExitStack() as made:
        yield made


def router(stack: ExitStack, listen: str = "tcp/127.0.0.1:0", connect: tuple[str, ...] = ()) -> ZenohRouter:
    made = ZenohRouter({}, print, listen=[listen], connect=connect)
    stack.callback(made.close)
    return made


@pytest.fixture
def node_at(monkeypatch: pytest.MonkeyPatch, stack: ExitStack) -> Callable[..., Node]:
    """Function that creates a node at a router of the test; nodes are closed before routers."""
    world = World("zenoh")
    stack.callback(world.close)

    def make(name: str, endpoint: str, mode: str = "peer") -> Node:
        override = f'mode="{mode}";connect/endpoints=["{endpoint}"];listen/endpoints=["tcp/127.0.0.1:0"]'
        monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", override)
        return world.node(name)

    return make


@pytest.mark.parametrize("modes", [("client", "client"), ("peer", "peer"), ("peer", "client")])
async def test_nodes_communicate_across_a_line_of_three_routers(
    stack: ExitStack, node_at: Callable[..., Node], modes: tuple[str, str]
) -> None:
    first = router(stack)
    middle = router(stack, connect=(first.endpoints[0],))
    last = router(stack, connect=(middle.endpoints[0],))
    left, right = node_at("left", first.endpoints[0], modes[0]), node_at("right", last.endpoints[0], modes[1])
    publisher, subscription = left.create_publisher(String, "/far"), right.create_subscription(String, "/far")
    right.create_service(AddTwoInts, "/add", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    client = left.create_client(AddTwoInts, "/add")
    assert await publisher.wait_for_subscribers(10) and await client.wait_for_service(10)
    assert (await client.call(AddTwoInts.Request(a=1, b=2), timeout_s=10)).sum == 3
    publisher.publish(String(data="hello"))
    assert (await subscription.receive(10)).data == "hello"
    await until(lambda: "/right" in left.get_node_names() and "/left" in right.get_node_names())
    right.close()
    await until(lambda: "/right" not in left.get_node_names())


async def test_nodes_communicate_without_router_and_discover_new_nodes_after_its_restart(
    stack: ExitStack, node_at: Callable[..., Node]
) -> None:
    gone = router(stack)
    (endpoint,) = gone.endpoints
    talker, listener = node_at("talker", endpoint), node_at("listener", endpoint)
    publisher, subscription = talker.create_publisher(String, "/talk"), listener.create_subscription(String, "/talk")
    assert await publisher.wait_for_subscribers(10)
    here, there = (participant_of(node).session.info for node in (talker, listener))
    await until(lambda: there.zid() in here.peers_zid(), 10)  # a direct link
    gone.close()
    receiving = asyncio.ensure_future(subscription.receive(10))
    while not receiving.done():  # the direct link may be used later
        publisher.publish(String(data="alone"))
        await asyncio.wait([receiving], timeout=0.2)
    assert receiving.result().data == "alone"
    router(stack, endpoint)
    later = node_at("later", endpoint).create_subscription(String, "/talk")
    assert await publisher.wait_for_subscribers(15, count=2)
    publisher.publish(String(data="all"))
    assert (await later.receive(10)).data == "all"
    while (message := await subscription.receive(10)).data != "all":
        assert message.data == "alone"
