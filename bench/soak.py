"""Long run of a recorder, a Foxglove bridge with viewers, calls and goals, while peers are killed every 10 s.

    python bench/soak.py --minutes 60

Samples memory, descriptors and threads of each process that lives through the run, and counts what is promised: every
call and goal to a living server is answered with its own result, the bag has every message of the reliable topic, and
a viewer that reads gets messages in order. Exits with 1 if something was lost.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rosidl_py_gen import get_action, get_service, install_import_hook

install_import_hook()
from std_msgs.msg import Int64, String  # noqa: E402

from rosidl_py_gen.errors import RosidlError  # noqa: E402
from rosidl_py_gen.runtime import Node, run  # noqa: E402

DOMAIN = "58"
KILL_S, SAMPLE_S, HZ = 10.0, 15.0, 50.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--role", choices=["server", "client", "peer"], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.environ.update(ROS_DOMAIN_ID=DOMAIN, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    roles = {"server": serve, "client": call, "peer": be_killed}
    if arguments.role:
        run(roles[arguments.role]())
        return
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(asyncio.run(soak(arguments.minutes * 60, Path(folder))))


# ------------------------------------------------------------------------------------------------- the other processes


async def serve() -> None:
    """Serve calls and goals and publish numbers, until a signal."""
    fibonacci = get_action("example_interfaces/action/Fibonacci")
    add = get_service("example_interfaces/srv/AddTwoInts")
    async with Node("soak_server") as node:

        async def execute(goal: object) -> object:
            order = goal.request.order  # type: ignore[attr-defined]
            for count in range(3):
                goal.publish_feedback(fibonacci.Feedback(sequence=[count]))  # type: ignore[attr-defined]
                await asyncio.sleep(0.01)
            return fibonacci.Result(sequence=[order])

        node.create_service(add, "soak_add", lambda asked: add.Response(sum=asked.a + asked.b))
        node.create_action_server(fibonacci, "soak_goal", execute)
        publisher = node.create_publisher(Int64, "soak_numbers", 1000)
        number = 0

        def publish() -> None:
            nonlocal number
            publisher.publish(Int64(data=number))
            number += 1

        node.create_subscription(String, "soak_talk", lambda message: None)
        node.declare_parameter("soak_rate", HZ)
        print("ready", flush=True)
        await asyncio.sleep(5)  # until the recorder has matched
        node.create_timer(1 / HZ, publish)
        try:
            await asyncio.Event().wait()
        finally:
            print(json.dumps({"published": number}), flush=True)


async def call() -> None:
    """Call and send goals without pause; print what was answered, rightly and otherwise."""
    fibonacci = get_action("example_interfaces/action/Fibonacci")
    add = get_service("example_interfaces/srv/AddTwoInts")
    counts = {"calls": 0, "goals": 0, "lost": 0, "wrong": 0}
    async with Node("soak_client") as node:
        calls, goals = node.create_client(add, "soak_add"), node.create_action_client(fibonacci, "soak_goal")
        await calls.wait_for_service(20)
        await goals.wait_for_server(20)

        async def many_calls() -> None:
            while True:
                a, b = random.randrange(1 << 40), random.randrange(1 << 40)
                try:
                    answer = await calls.call(add.Request(a=a, b=b), timeout_s=30)
                    counts["calls"] += 1
                    counts["wrong"] += answer.sum != a + b
                except RosidlError:
                    counts["lost"] += 1
                await asyncio.sleep(0.01)

        async def many_goals() -> None:
            while True:
                order = random.randrange(1 << 20)
                try:
                    goal = await goals.send_goal(fibonacci.Goal(order=order), timeout_s=30)
                    _, result = await goal.result(timeout_s=30)
                    counts["goals"] += 1
                    counts["wrong"] += list(result.sequence) != [order]
                except RosidlError:
                    counts["lost"] += 1
                await asyncio.sleep(0.05)

        try:
            await asyncio.gather(many_calls(), many_calls(), many_goals(), many_goals())
        finally:
            print(json.dumps(counts), flush=True)


async def be_killed() -> None:
    """Have endpoints of every kind and use those of the server, until this process is killed."""
    add = get_service("example_interfaces/srv/AddTwoInts")
    async with Node(f"soak_peer_{os.getpid()}") as node:
        publisher = node.create_publisher(String, "soak_talk")
        node.create_subscription(Int64, "soak_numbers", lambda message: None)
        node.create_service(get_service("std_srvs/srv/Trigger"), "~/trigger", lambda asked: None)
        node.declare_parameter("own", 1)
        client = node.create_client(add, "soak_add")
        await client.wait_for_service(20)
        while True:
            publisher.publish(String(data="x" * 100))
            await client.call(add.Request(a=1, b=2), timeout_s=20)
            await asyncio.sleep(0.02)


# ------------------------------------------------------------------------------------------------------- the experiment


async def soak(seconds: float, folder: Path) -> int:
    """Run everything and report; the number of things that were lost."""
    tool = [sys.executable, "-m", "rosidl_py_gen.ros_cli"]
    me = [sys.executable, __file__, "--role"]
    alive: dict[str, subprocess.Popen[str]] = {}

    def start(name: str, *command: str) -> subprocess.Popen[str]:
        errors = (folder / f"{name}.err").open("w")
        alive[name] = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, cwd=folder)
        return alive[name]

    samples: dict[str, list[tuple[float, int, int, int]]] = {}
    seen = {"messages": 0, "out of order": 0, "viewers": 0}
    try:
        start("recorder", *tool, "bag", "record", "--topics", "/soak_numbers", "/soak_talk", "-o", "bag")
        assert start("server", *me, "server").stdout.readline() == "ready\n"  # type: ignore[union-attr]
        address = json.loads(start("bridge", *tool, "foxglove", "--port", "0", "--json").stdout.readline())["address"]  # type: ignore[union-attr]
        start("client", *me, "client")
        tasks = [asyncio.create_task(_watch(address, seen)), asyncio.create_task(_come_and_go(address, seen))]
        began = time.monotonic()
        killed, sampled, kills = began, began, 0
        peer = subprocess.Popen([*me, "peer"])
        while (now := time.monotonic()) < began + seconds:
            await asyncio.sleep(0.5)
            for task in tasks:
                if task.done():
                    task.result()
            if now - killed >= KILL_S:
                peer.kill()
                peer.wait()
                peer, killed, kills = subprocess.Popen([*me, "peer"]), now, kills + 1
            if now - sampled >= SAMPLE_S:
                sampled = now
                for name, process in alive.items():
                    samples.setdefault(name, []).append((now - began, *_sizes(process.pid)))
                print(f"{now - began:.0f} s", {name: rows[-1][1] >> 20 for name, rows in samples.items()}, flush=True)
        for task in tasks:
            task.cancel()
        peer.kill()
        counts = json.loads(_end(alive["client"]))
        published = json.loads(_end(alive["server"]))["published"]
        await asyncio.sleep(2)
        _end(alive["recorder"])
        _end(alive["bridge"])
    finally:
        for process in alive.values():
            process.kill()
    recorded = _recorded(folder / "bag")
    missing = published - len(set(recorded))
    for name, rows in samples.items():
        print(name, _growth(rows), "codes", alive[name].returncode, (folder / f"{name}.err").read_text()[-300:])
    print(
        f"killed {kills}; client {counts}; viewers {seen}; published {published}, recorded {len(recorded)}", flush=True
    )
    lost = counts["lost"] + counts["wrong"] + max(missing, 0) + (len(recorded) - len(set(recorded)))
    print("lost:", lost, "of them not in the bag:", missing)
    return int(bool(lost or seen["out of order"]))


def _end(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGINT)
    return process.communicate(timeout=30)[0].strip().rpartition("\n")[2]


def _sizes(pid: int) -> tuple[int, int, int]:
    """Resident memory in bytes, open descriptors, threads."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return pages * 4096, len(os.listdir(f"/proc/{pid}/fd")), len(os.listdir(f"/proc/{pid}/task"))
    except OSError:
        return 0, 0, 0


def _growth(rows: list[tuple[float, int, int, int]]) -> str:
    """Median of the second sixth of the run against that of the last: memory in MB, descriptors, threads."""
    part = max(1, len(rows) // 6)
    early, late = rows[part : 2 * part] or rows, rows[-part:]
    texts = []
    for column, unit, scale in ((1, "MB", 1 << 20), (2, "descriptors", 1), (3, "threads", 1)):
        then, now = (statistics.median(row[column] for row in some) / scale for some in (early, late))
        texts.append(f"{then:.1f} -> {now:.1f} {unit}")
    return ", ".join(texts)


def _recorded(bag: Path) -> list[int]:
    from rosidl_py_gen.bags import BagReader

    with BagReader(bag) as reader:
        return [one.message.data for one in reader.messages(topics=["/soak_numbers"])]


async def _watch(address: str, seen: dict[str, int]) -> None:
    """View every number; a viewer that keeps up gets them in order."""
    from websockets.asyncio.client import connect

    async with connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None) as viewer:  # type: ignore[list-item]
        last = -1
        async for text in viewer:
            if isinstance(text, str):
                for channel in json.loads(text).get("channels", ()):
                    if channel["topic"] == "/soak_numbers":
                        wanted = [{"id": 1, "channelId": channel["id"]}]
                        await viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            elif text[0] == 1:
                number = Int64.decode(text[13:]).data
                seen["messages"] += 1
                seen["out of order"] += number <= last
                last = number


async def _come_and_go(address: str, seen: dict[str, int]) -> None:
    """View everything for some seconds, again and again, and leave without a word."""
    from websockets.asyncio.client import connect

    while True:
        viewer = await connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None)  # type: ignore[list-item]
        seen["viewers"] += 1
        until = time.monotonic() + random.uniform(1, 8)
        ids = 0
        while time.monotonic() < until:
            try:
                text = await asyncio.wait_for(viewer.recv(), 1)
            except asyncio.TimeoutError:
                continue
            if isinstance(text, str):
                for channel in json.loads(text).get("channels", ()):
                    ids += 1
                    wanted = [{"id": ids, "channelId": channel["id"]}]
                    await viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        viewer.transport.abort()


if __name__ == "__main__":
    main()
