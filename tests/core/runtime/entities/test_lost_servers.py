"""Calls whose servers leave before they reply: closed or killed, replaced or not."""

from __future__ import annotations

import asyncio
import os
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from support.folders import ROOT
from support.generated_packages import GENERATED
from support.inner_state import servers_of, transport_end_of
from support.processes import python_process
from support.waiting import until

from rosidl_py_gen.runtime import ActionServerLostError, CallTimeoutError, ServerLostError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

Request, Response = AddTwoInts.Request, AddTwoInts.Response
_LOST = "the server of /add went away before it answered"
_SHORT_LEASE = (
    '<CycloneDDS><Domain Id="any"><Discovery><LeaseDuration>1s</LeaseDuration></Discovery></Domain></CycloneDDS>'
)
_SILENT_SERVER = """
import asyncio
from example_interfaces.srv import AddTwoInts
from rosidl_py_gen.runtime import Node

async def main():
    async with Node("server") as node:
        async for request in node.create_service(AddTwoInts, "add"):
            print("asked", flush=True)

asyncio.run(main())
"""


@pytest.fixture
def mortal() -> Iterator[subprocess.Popen[str]]:
    """Process with a server that never replies; its loss is detected a second after it was killed."""
    path = os.pathsep.join([str(ROOT), GENERATED.name])
    with python_process(_SILENT_SERVER, PYTHONPATH=path, CYCLONEDDS_URI=_SHORT_LEASE) as process:
        yield process


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    return Response(sum=request.a + request.b)


async def asked(world: World, count: int = 1, timeout_s: float | None = None) -> tuple[Any, Any, list[Any]]:
    """Return a server that has received calls of a client and replied to none."""
    server = world.node("server").create_service(AddTwoInts, "add")
    client = world.node("caller").create_client(AddTwoInts, "add")
    calls = [asyncio.ensure_future(client.call(Request(a=1, b=2), timeout_s)) for _ in range(count)]
    for _ in calls:
        await asyncio.wait_for(anext(server), 20)
    return server, client, calls


@pytest.mark.every_transport
@pytest.mark.parametrize("timeout_s", [None, 60], ids=["without limit", "with limit"])
async def test_pending_calls_raise_server_lost_error_when_server_closes(world: World, timeout_s: float | None) -> None:
    server, client, calls = await asked(world, 3, timeout_s)
    server.close()
    for call in calls:
        with pytest.raises(ServerLostError, match=_LOST):
            await asyncio.wait_for(call, 20)
    assert client.in_flight_count == 0


@pytest.mark.every_transport
async def test_pending_call_fails_although_a_new_server_replaced_the_lost_one(world: World) -> None:
    server, client, (call,) = await asked(world)
    world.node("next").create_service(AddTwoInts, "add", add)
    await until(lambda: len(servers_of(client)) == 2)
    assert not call.done()
    server.close()
    with pytest.raises(ServerLostError, match=_LOST):
        await asyncio.wait_for(call, 20)
    assert (await client.call(Request(a=1, b=2), timeout_s=20)).sum == 3


@pytest.mark.every_transport
async def test_call_stays_pending_while_one_of_its_servers_remains(world: World) -> None:
    first, second = (world.node(name).create_service(AddTwoInts, "add") for name in ("first", "second"))
    client = world.node("caller").create_client(AddTwoInts, "add")
    await until(lambda: len(servers_of(client)) == 2)
    call = asyncio.ensure_future(client.call(Request(a=1, b=2)))
    request = await asyncio.wait_for(anext(second), 20)
    first.close()
    await until(lambda: len(servers_of(client)) == 1)
    assert not call.done()
    request.respond(Response(sum=3))
    assert (await asyncio.wait_for(call, 20)).sum == 3


@pytest.mark.every_transport
async def test_reply_sent_before_server_closed_is_received(world: World) -> None:
    server = world.node("server").create_service(AddTwoInts, "add")
    client = world.node("caller").create_client(AddTwoInts, "add")
    for number in range(10):
        call = asyncio.ensure_future(client.call(Request(a=number), timeout_s=20))
        (await asyncio.wait_for(anext(server), 20)).respond(Response(sum=number))
        await until(transport_end_of(server).all_acknowledged)
        if number == 9:
            server.close()
        assert (await call).sum == number


@pytest.mark.every_transport
async def test_call_made_before_any_server_exists_waits_for_a_server(world: World) -> None:
    passer_by, client = world.node("passer_by"), world.node("caller").create_client(AddTwoInts, "add")
    call = asyncio.ensure_future(client.call(Request(a=1, b=2)))
    other = passer_by.create_service(AddTwoInts, "other", add)
    await asyncio.sleep(0)
    other.close()
    passer_by.close()
    world.node("server").create_service(AddTwoInts, "add", add)
    assert (await asyncio.wait_for(call, 20)).sum == 3


async def test_requests_waiting_in_the_window_go_to_the_next_server(
    memory: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, client, (call,) = await asked(memory)
    servers = transport_end_of(client).servers
    monkeypatch.setattr(transport_end_of(client), "servers", lambda: replace(servers(), request_queue_depth=1))
    second = asyncio.ensure_future(client.call(Request(a=1, b=2), timeout_s=5))
    third = asyncio.ensure_future(client.call(Request(a=2, b=2), timeout_s=5))
    await until(lambda: client.in_flight_count == 3)
    memory.node("next").create_service(AddTwoInts, "add", add)
    await until(lambda: len(transport_end_of(client).server_endpoints()) == 4)
    server.close()
    for lost in (call, second):
        with pytest.raises(ServerLostError, match=_LOST):
            await lost
    assert (await third).sum == 4


@pytest.mark.slow
async def test_call_to_killed_server_fails_after_its_lease_expires(
    network: World, mortal: subprocess.Popen[str]
) -> None:
    node = network.node("caller")
    client = node.create_client(AddTwoInts, "add")
    call = asyncio.ensure_future(client.call(Request(a=1, b=2)))
    assert mortal.stdout is not None and await asyncio.to_thread(mortal.stdout.readline) == "asked\n"
    mortal.kill()
    with pytest.raises(ServerLostError, match=_LOST):
        await asyncio.wait_for(call, 60)
    await until(lambda: not client.service_is_available() and node.get_node_names() == ["/caller"])
    with pytest.raises(CallTimeoutError, match="no server of /add"):
        await client.call(Request(), timeout_s=0.1)


@pytest.mark.every_transport
async def test_goal_fails_at_once_if_server_closes_before_accepting(world: World) -> None:
    async def on_goal(goal: Any) -> bool:
        entered.set()
        try:
            await asyncio.Event().wait()
        finally:
            ended.set()
        return True

    async def execute(goal: Any) -> Any:
        return Fibonacci.Result()

    entered, ended = asyncio.Event(), asyncio.Event()
    node = world.node("server")
    server = node.create_action_server(Fibonacci, "fib", execute, goal_callback=on_goal)
    client = world.node("caller").create_action_client(Fibonacci, "fib")
    sending = asyncio.ensure_future(client.send_goal(Fibonacci.Goal(order=1)))
    await asyncio.wait_for(entered.wait(), 20)
    server.close()
    await asyncio.wait_for(ended.wait(), 20)
    with pytest.raises(ActionServerLostError, match="action /fib: no reply to the goal: the server of /fib/_action"):
        await asyncio.wait_for(sending, 20)
    assert client._goals == {}
