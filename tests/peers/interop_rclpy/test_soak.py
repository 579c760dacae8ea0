"""Calls and goals at the same time while packets are lost and peers are killed every 20 s or earlier.

SOAK_MINUTES=10 makes it last ten minutes. Cyclone DDS drops packets when it sends; Fast DDS has no such setting.
"""

from __future__ import annotations

import asyncio
import gc
import os
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Any

import pytest
from peer_helpers import action, fresh, service
from rclpy_peer import Peer, PeerError
from support.inner_state import servers_of
from support.waiting import until

from rosidl_py_gen.runtime import ServerGoal
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone

MINUTES = float(os.environ.get("SOAK_MINUTES", "0.25"))
KILLED_EVERY_S = min(20.0, 30 * MINUTES)
WAIT_S = 25
BASIC, TRIGGER, FIBONACCI = "test_msgs/srv/BasicTypes", "std_srvs/srv/Trigger", "test_msgs/action/Fibonacci"
_PAUSE_S = 0.05
"""Pause between calls. Every reply goes to every client of a service, and rclpy's clients queue ten: while a lost
packet is repeated, or rclpy is busy, more than ten replies would overwrite each other.
"""
_LOSSES = (
    "<CycloneDDS><Domain><Internal><Test><XmitLossiness>50</XmitLossiness></Test></Internal></Domain></CycloneDDS>"
)
_ANSWERED_S, _ATTEMPTS = 4, 8


def rss_mb() -> float:
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * 4096 / 1e6


async def retried(once: Callable[[], Awaitable[Any]]) -> Any:
    """Return the result of a call that is repeated if there is no reply.

    Servers on Fast DDS, and ours as well, drop the first reply for a client whose reader they have not found after 0.1
    s. A lost packet delays discovery by more than that.
    """
    for _ in range(_ATTEMPTS):
        with suppress(asyncio.TimeoutError):
            return await asyncio.wait_for(once(), _ANSWERED_S)
    raise AssertionError(f"no answer to {_ATTEMPTS} calls")


class Soak:
    """Concurrent activities and their counters."""

    def __init__(self, world: Any, stays: Peer) -> None:
        self.stays = stays
        self.ours = world.node(fresh("ours").strip("/"))
        self.basic, self.trigger = service(stays, BASIC), service(stays, TRIGGER)
        self.fibonacci = action(stays, FIBONACCI)
        names = ("theirs", "ours", "ours_mortal", "both_for_us", "both_for_them", "goals_theirs", "goals_ours")
        self.names = {name: fresh(name) for name in names}
        self.count: Counter[str] = Counter()
        self.is_over = False

    async def prepare(self) -> None:
        """Create the services; those that are called both have a server on each side."""
        names, stays = self.names, self.stays
        for name in ("theirs", "both_for_us", "both_for_them"):
            await stays.do("serve", name=names[name], type=BASIC, how="echo")
        for name in ("ours", "ours_mortal", "both_for_us", "both_for_them"):
            self.ours.create_service(self.basic, names[name], self.echo)
        await stays.do(
            "action_server", name=names["goals_theirs"], type=FIBONACCI, how="succeed", result={"sequence": [7]}
        )
        self.ours.create_action_server(self.fibonacci, names["goals_ours"], self.execute, result_timeout_s=WAIT_S)
        await stays.do("client", name=names["ours"], type=BASIC)
        await stays.do("client", name=names["both_for_them"], type=BASIC)
        await stays.do("action_client", name=names["goals_ours"], type=FIBONACCI)

    def echo(self, request: Any) -> Any:
        return self.basic.Response(int64_value=request.int64_value, string_value=request.string_value)

    async def execute(self, goal: ServerGoal[Any]) -> Any:
        goal.publish_feedback(self.fibonacci.Feedback(sequence=[goal.request.order]))
        await asyncio.sleep(0)
        return goal.succeed(self.fibonacci.Result(sequence=[goal.request.order]))

    # Each of these has to succeed, whatever is lost: its peers live on.

    def our_calls(self, name: str) -> Callable[[int], Awaitable[None]]:
        client = self.ours.create_client(self.basic, self.names[name])

        async def call(number: int) -> None:
            text = "x" * (number * 7919 % 3000)
            answer = await client.call(self.basic.Request(int64_value=number, string_value=text), WAIT_S)
            assert (answer.int64_value, answer.string_value) == (number, text)

        return call

    def their_calls(self, name: str) -> Callable[[int], Awaitable[None]]:
        async def call(number: int) -> None:
            request = {"int64_value": number, "string_value": "y" * (number * 7919 % 3000)}
            (answer,) = await self.stays.do("call", name=self.names[name], requests_=[request])
            assert (answer["int64_value"], answer["string_value"]) == tuple(request.values())

        return call

    def our_goals(self) -> Callable[[int], Awaitable[None]]:
        client = self.ours.create_action_client(self.fibonacci, self.names["goals_theirs"])

        async def goal(number: int) -> None:
            handle = await client.send_goal(self.fibonacci.Goal(order=number % 100), timeout_s=WAIT_S)
            assert list((await handle.result(timeout_s=WAIT_S))[1].sequence) == [7]

        return goal

    async def their_goals(self, number: int) -> None:
        key, order = f"goal{number}", number % 100
        assert await self.stays.do("send_goal", name=self.names["goals_ours"], key=key, goal={"order": order})
        assert (await self.stays.do("result", key=key))["result"] == {"sequence": [order]}

    async def repeat(self, name: str, once: Callable[[int], Awaitable[None]]) -> None:
        """Repeat an activity until the end."""
        try:
            await retried(partial(once, 0))
            while not self.is_over:
                await once(self.count[name])
                self.count[name] += 1
                await asyncio.sleep(_PAUSE_S)
        except BaseException as err:
            raise AssertionError(f"{name}, number {self.count[name]}: {err!r}") from err

    @staticmethod
    def is_replaced(client: Any, dead: set[bytes]) -> bool:
        """Return True if the client knows a server other than the dead ones."""
        servers = servers_of(client)
        return bool(servers) and servers.isdisjoint(dead)

    async def kill(self, start_mortal: Callable[[str], Peer]) -> None:
        """Start peers that serve, call and are killed; only calls at that moment may be lost."""
        name = fresh("mortal")
        client = self.ours.create_client(self.trigger, name)
        while not self.is_over:
            # A killed server counts until its lease ends, and a request may go to that server alone.
            dead = servers_of(client)
            peer = start_mortal("mortal")
            await peer.do("serve", name=name, type=TRIGGER, how="trigger", note="alive")
            await peer.do("client", name=self.names["ours_mortal"], type=BASIC)
            await until(partial(self.is_replaced, client, dead), WAIT_S)
            assert (await retried(partial(client.call, self.trigger.Request()))).message == "alive"
            request: dict[str, Any] = {"name": self.names["ours_mortal"], "requests_": [{"int64_value": 5}]}
            await retried(partial(peer.do, "call", **request))
            end = asyncio.get_running_loop().time() + KILLED_EVERY_S
            while asyncio.get_running_loop().time() < end and not self.is_over:
                (answer,) = await peer.do("call", **request)
                assert answer["int64_value"] == 5
                await asyncio.sleep(_PAUSE_S)
            cut_off = peer.start("call", name=self.names["ours_mortal"], requests_=[{}] * 5)
            lost = asyncio.ensure_future(client.call(self.trigger.Request(), 3))
            await asyncio.sleep(0)
            await asyncio.to_thread(peer.kill)
            with suppress(PeerError):
                cut_off.result(WAIT_S)
            await asyncio.wait([lost])
            lost.exception()
            self.count["killed"] += 1


@pytest.mark.timeout(60 * MINUTES + 240)
async def test_soak_with_packet_loss_and_killed_peers_loses_no_replies(
    world: Any,
    start_peer: Callable[..., Peer],
    start_mortal: Callable[[str], Peer],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", _LOSSES)
    soak = Soak(world, start_peer("soak_peer", wide=True))
    await soak.prepare()
    work = {
        "our calls to theirs": soak.our_calls("theirs"),
        "our calls beside clients that are killed": soak.our_calls("ours_mortal"),
        "our calls to both": soak.our_calls("both_for_us"),
        "their calls to ours": soak.their_calls("ours"),
        "their calls to both": soak.their_calls("both_for_them"),
        "our goals": soak.our_goals(),
        "their goals": soak.their_goals,
    }
    tasks = [asyncio.ensure_future(soak.repeat(name, once)) for name, once in work.items()]
    tasks.append(asyncio.ensure_future(soak.kill(start_mortal)))
    await asyncio.wait(tasks, timeout=60 * MINUTES / 3, return_when=asyncio.FIRST_EXCEPTION)
    gc.collect()
    before_mb, before_count = rss_mb(), soak.count.total()
    await asyncio.wait(tasks, timeout=60 * MINUTES * 2 / 3, return_when=asyncio.FIRST_EXCEPTION)
    soak.is_over = True
    await asyncio.gather(*tasks)
    gc.collect()
    grown_mb, done = rss_mb() - before_mb, soak.count.total() - before_count
    print(dict(soak.count), f"grown {grown_mb:.1f} MB in {done}")
    assert min(soak.count[name] for name in work) >= 5
    assert soak.count["killed"] >= 1
    assert grown_mb < 8 + 2 * MINUTES
    assert cyclone.FAST_DDS_SUPPORT.refusal is None
