"""Observation of a program from outside: its part of the graph, and traffic for all its endpoints. For `run_others`."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import struct
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.runtime import Context, Node, QoSProfile

_START_S, _QUIET_S, _LONGEST_S, _END_S = 30.0, 4.0, 15.0, 12.0
_INFRASTRUCTURE = ("_parameters", "_parameters_atomically", "_parameter_types", "/get_type_description")
_FAILING = ("/introspection/snapshot_streams/services",)
"""Not called: a callback of py_trees_ros that has no other end than AttributeError."""
_TOPICS = ("/rosout", "/parameter_events")
_GOAL = "/_action/send_goal"


@dataclass
class Seen:
    """Observations of a program; lists are sorted."""

    nodes: list[str] = field(default_factory=list)
    endpoints: list[Any] = field(default_factory=list)
    published: list[str] = field(default_factory=list)
    answered: list[Any] = field(default_factory=list)
    fed: list[str] = field(default_factory=list)
    interrupted: bool = False
    code: int | None = None
    output: str = ""
    errors: str = ""

    @property
    def last(self) -> str:
        lines = [line for line in self.errors.splitlines() if line.strip() and line[0] not in " ["]
        return lines[-1][:400] if lines else ""


async def watch(command: Sequence[str], cwd: Path, environment: dict[str, str], domain: int, paths: list[str]) -> Seen:
    """Run the program once, from start to SIGINT, or until it exits."""
    with Context(domain_id=domain, discovery="localhost") as context:
        async with Node("others_watch", context=context, enable_rosout=False) as node:
            pipe, (keys, terminal) = asyncio.subprocess.PIPE, os.openpty()
            process = await asyncio.create_subprocess_exec(
                *command, cwd=cwd, env=environment, stdin=terminal, stdout=pipe, stderr=pipe
            )
            os.close(terminal)
            os.write(keys, b"1\n" * 50)
            talk = asyncio.ensure_future(_texts(process))
            watcher = _Watcher(node, paths)
            try:
                await watcher.until_quiet(talk)
                watcher.seen.interrupted = not talk.done()
                for _ in range(2):
                    if talk.done():
                        break
                    process.send_signal(signal.SIGINT)
                    with contextlib.suppress(asyncio.TimeoutError):
                        await asyncio.wait_for(asyncio.shield(talk), _END_S)
                        watcher.seen.code = process.returncode
                        break
                else:
                    watcher.seen.code = None
                if talk.done():
                    watcher.seen.code = process.returncode
            finally:
                if process.returncode is None:
                    process.kill()
                watcher.close()
                os.close(keys)
            watcher.seen.output, watcher.seen.errors = await talk
    return watcher.seen


async def _texts(process: asyncio.subprocess.Process) -> tuple[str, str]:
    assert process.stdout is not None and process.stderr is not None
    out, error = await asyncio.gather(process.stdout.read(), process.stderr.read())
    await process.wait()
    return out.decode(errors="replace")[-20_000:], error.decode(errors="replace")[-20_000:]


class _Watcher:
    """Attends to each endpoint of the program when it comes up, to services when all are there."""

    def __init__(self, node: Node, paths: list[str]) -> None:
        self.seen = Seen()
        self._node = node
        self._paths = paths
        self._known: set[tuple[str, str, str]] = set()
        self._tasks: list[asyncio.Task[None]] = []
        self._published: set[str] = set()
        self._to_call: list[tuple[str, str]] = []

    def close(self) -> None:
        for task in self._tasks:
            task.cancel()

    async def until_quiet(self, ended: asyncio.Future[Any]) -> None:
        """Wait until no new endpoint appears; services are called one after another once all endpoints exist."""
        await self._settle(ended)
        while self._to_call and not ended.done():
            calls, self._to_call = sorted(self._to_call), []
            for name, type_ in calls:
                if not ended.done():
                    await self._guarded(self._call, name, type_)
            await self._settle(ended)
        self.seen.published = sorted(self._published)
        self.seen.answered.sort(key=str)

    async def _settle(self, ended: asyncio.Future[Any]) -> None:
        """Wait until no new endpoint has appeared for a while, and running traffic has finished."""
        began = changed = time.monotonic()
        published = 0
        while not ended.done():
            await asyncio.sleep(0.1)
            now = time.monotonic()
            if self._look() or len(self._published) > published:
                changed, published = now, len(self._published)
            if not self.seen.nodes:
                if now > began + _START_S:
                    break
                changed = now
            busy = any(not task.done() for task in self._tasks)
            if now > began + _START_S + _LONGEST_S or (now > changed + _QUIET_S and not busy):
                break

    def _look(self) -> bool:
        node, new = self._node, False
        endpoints: set[Any] = set()
        for info in node.get_nodes():
            if info.fully_qualified_name == node.fully_qualified_name:
                continue
            if info.fully_qualified_name not in self.seen.nodes:
                self.seen.nodes = sorted([*self.seen.nodes, info.fully_qualified_name])
                new = True
            where = info.name, info.namespace
            for kind, names, attend in (
                ("publisher", node.get_publisher_names_and_types_by_node(*where), self._listen),
                ("subscription", node.get_subscriber_names_and_types_by_node(*where), self._publish),
                ("service", node.get_service_names_and_types_by_node(*where), self._call),
                ("client", node.get_client_names_and_types_by_node(*where), self._serve),
            ):
                for name, types in names:
                    for type_ in types:
                        endpoints.add((kind, name, type_, info.fully_qualified_name, *self._qos(kind, name, where)))
                        if (kind, name, type_) not in self._known:
                            self._known.add((kind, name, type_))
                            new = True
                            if kind == "service":
                                self._to_call.append((name, type_))
                            else:
                                self._attend(attend, name, type_)
        if endpoints:
            self.seen.endpoints = sorted({*map(tuple, self.seen.endpoints), *endpoints}, key=str)
        return new

    def _qos(self, kind: str, name: str, where: tuple[str, str]) -> list[str]:
        infos: Sequence[Any] = ()
        if kind == "publisher":
            infos = self._node.get_publishers_info_by_topic(name)
        elif kind == "subscription":
            infos = self._node.get_subscriptions_info_by_topic(name)
        told = ("reliability", "durability", "deadline_ns", "lifespan_ns", "liveliness", "liveliness_lease_ns")
        mine = [info.qos_profile for info in infos if (info.node_name, info.node_namespace) == where]
        return sorted(" ".join(str(getattr(qos, one)) for one in told) for qos in mine)

    def _attend(self, attend: Callable[[str, str], Any], name: str, type_: str) -> None:
        self._tasks.append(asyncio.get_running_loop().create_task(self._guarded(attend, name, type_)))

    async def _guarded(self, attend: Callable[[str, str], Any], name: str, type_: str) -> None:
        try:
            await asyncio.wait_for(attend(name, type_), 15)
        except asyncio.CancelledError:
            raise
        except Exception as error:
            self.seen.answered.append((name, f"{type(error).__name__}: {str(error)[:200]}"))

    async def _listen(self, name: str, type_: str) -> None:
        if name in _TOPICS or "/_action/" in name or name.endswith("/transition_event"):
            return
        cls = get_message(type_, path=self._paths)
        infos = self._node.get_publishers_info_by_topic(name)
        latched = all("TRANSIENT" in str(info.qos_profile.durability).upper() for info in infos)
        qos = QoSProfile().keep_last(10).best_effort()
        qos = QoSProfile().keep_last(10).transient_local() if latched and infos else qos
        self._node.create_subscription(cls, name, lambda _: self._published.add(name), qos)

    async def _publish(self, name: str, type_: str) -> None:
        if name in _TOPICS or "/_action/" in name:
            return
        publisher = self._node.create_publisher(get_message(type_, path=self._paths), name, QoSProfile().keep_last(10))
        await publisher.wait_for_subscribers(timeout_s=5)
        for _ in range(5):
            publisher.publish(sample(type_, self._paths))
            await asyncio.sleep(0.2)
        self.seen.fed.append(name)

    async def _call(self, name: str, type_: str) -> None:
        if name.endswith(_INFRASTRUCTURE + _FAILING) or ("/_action/" in name and not name.endswith(_GOAL)):
            return
        if name.endswith(_GOAL):
            action: Any = get_action(type_.removesuffix("_SendGoal"), path=self._paths)
            client: Any = self._node.create_action_client(action, name.removesuffix(_GOAL))
            goal = await client.send_goal(_filled(action.Goal()), timeout_s=5)
            self.seen.answered.append((name, str(await goal.result(timeout_s=14))[:500]))
            return
        cls: Any = get_service(type_, path=self._paths)
        service: Any = self._node.create_client(cls, name)
        requests = [_filled(cls.Request(), "a")]
        if type_ == "lifecycle_msgs/srv/ChangeState":
            requests = [cls.Request() for _ in range(2)]
            for request, number in zip(requests, (1, 3), strict=True):
                request.transition.id = number
        for request in requests:
            self.seen.answered.append((name, str(await service.call(request, timeout_s=6))[:500]))

    async def _serve(self, name: str, type_: str) -> None:
        if name.endswith(_INFRASTRUCTURE) or ("/_action/" in name and not name.endswith(_GOAL)):
            return
        if any(not one.startswith(self._node.fully_qualified_name) for one in self._servers(name)):
            return
        if name.endswith(_GOAL):
            action: Any = get_action(type_.removesuffix("_SendGoal"), path=self._paths)
            self._node.create_action_server(action, name.removesuffix(_GOAL), lambda _: action.Result())
            return
        cls: Any = get_service(type_, path=self._paths)

        def answer(request: Any) -> Any:
            self.seen.fed.append(name)
            return _filled(cls.Response())

        self._node.create_service(cls, name, answer)

    def _servers(self, name: str) -> list[str]:
        found = []
        for info in self._node.get_nodes():
            served = self._node.get_service_names_and_types_by_node(info.name, info.namespace)
            found += [info.fully_qualified_name] if name in dict(served) else []
        return found


def sample(type_: str, paths: list[str]) -> Any:
    """A message that programs can do something with."""
    message: Any = get_message(type_, path=paths)()
    if type_ == "sensor_msgs/msg/LaserScan":
        message.angle_increment, message.range_max, message.ranges = 0.0175, 10.0, [1.0] * 360
        message.intensities = [0.0] * 360
    elif type_ == "sensor_msgs/msg/Joy":
        message.axes, message.buttons = [0.5] * 8, [1] + [0] * 11
    elif type_ == "sensor_msgs/msg/Image":
        message.height, message.width, message.step, message.encoding = 48, 64, 192, "rgb8"
        message.data = bytes(48 * 192)
    elif type_ == "sensor_msgs/msg/CompressedImage":
        message.format = "png"
        rows = zlib.compress((b"\0" + bytes(64 * 3)) * 48)
        chunks = (b"IHDR" + struct.pack(">IIBBBBB", 64, 48, 8, 2, 0, 0, 0)), b"IDAT" + rows, b"IEND"
        parts = (struct.pack(">I", len(one) - 4) + one + struct.pack(">I", zlib.crc32(one)) for one in chunks)
        message.data = b"\x89PNG\r\n\x1a\n" + b"".join(parts)
    elif type_ == "sensor_msgs/msg/JointState":
        message.name, message.position, message.velocity = ["a", "b"], [0.1, 0.2], [0.0, 0.0]
    return _filled(message)


def _filled(message: Any, text: str = "1") -> Any:
    """Fill numbers and texts of the message that are still zero."""
    for name in getattr(type(message), "__slots__", ()):
        value = getattr(message, name, None)
        for kind, other in ((bool, True), (int, 3), (float, 1.0), (str, text)):
            if type(value) is kind and not value:
                with contextlib.suppress(Exception):
                    setattr(message, name, other)
    return message
