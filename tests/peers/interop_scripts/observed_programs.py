"""Observation of one program under real rclpy (Fast DDS) and under ours, with the same traffic.

A node of this process, which both middlewares can talk to, executes the steps of a case: it publishes to the program,
subscribes to its topics, calls its services, reads the graph and interrupts it. All results go into an `Observation`;
two of them are compared as a whole, without what differs in every run: times of log lines, inner frames of tracebacks
and stamps.
"""

from __future__ import annotations

import asyncio
import contextlib
import difflib
import os
import re
import shlex
import signal
import subprocess
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from pprint import pformat
from typing import Any

from support.environments import SHARED_MEMORY_LOST

from rosidl_py_gen.runtime import Context, Node, ParameterNotDeclaredError, QoSProfile

PROGRAMS = Path(__file__).parent / "programs"
TIMEOUT_S = 30
_STABLE_S = 1.5
_VARIABLE_TEXTS = (
    (SHARED_MEMORY_LOST, ""),
    (re.compile(r"^(\[\w+\] )\[\d+\.\d+\] ", re.MULTILINE), r"\1"),
    (
        re.compile(r"^Traceback \(most recent call last\):\n(?: .*\n|\n|During .*\n|The above .*\n)*", re.MULTILINE),
        "Traceback\n",
    ),
    (re.compile(r"[\w/.\-]*/(?=programs/)"), ""),
    (re.compile(r"0x[0-9a-f]+"), "0x"),
    (re.compile(r"Goal ID: \[[\d ]*\]"), "Goal ID: []"),
    (re.compile(r"^Failed to publish log message to rosout: .*\n\n?", re.MULTILINE), ""),  # ours does not print it
    (re.compile(r"^.*RuntimeWarning: Failed to fini .*\n.*\n", re.MULTILINE), ""),  # from rcl
)
"""Patterns of times, frames of tracebacks, paths, addresses and random numbers, and their replacements."""
_ABORTED = "terminate called without an active exception"


@dataclass(frozen=True)
class Publish:
    """Send messages once the program has subscribed to the topic."""

    topic: str
    type: str
    messages: tuple[dict[str, Any], ...]
    qos: QoSProfile = field(default_factory=lambda: QoSProfile().keep_last(100))


@dataclass(frozen=True)
class Receive:
    """Wait until the program has published a number of messages since its start, and observe them."""

    topic: str
    type: str
    count: int
    qos: QoSProfile = field(default_factory=lambda: QoSProfile().keep_last(100))


@dataclass(frozen=True)
class Call:
    """Call a service of the program and observe the response."""

    service: str
    type: str
    request: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Ask(Call):
    """Send a request to a service of the program that never replies."""


@dataclass(frozen=True)
class Printed:
    """Wait until the program has printed a text, on either stream."""

    text: str
    count: int = 1


@dataclass(frozen=True)
class Graph:
    """Observe the program's nodes, topics, services and the QoS of each endpoint."""


@dataclass(frozen=True)
class Parameters:
    """Observe names, types, values and descriptors of a node's parameters."""

    node: str


@dataclass(frozen=True)
class Interrupt:
    """Send a signal, once the program only waits."""

    signal: int = signal.SIGINT


Step = Publish | Receive | Call | Ask | Printed | Graph | Parameters | Interrupt


@dataclass(frozen=True)
class Case:
    """Program and its steps; it has to end without help after the last step."""

    program: str
    steps: tuple[Step, ...] = ()
    arguments: str = ""
    """Command line, split as by a shell."""
    unordered: bool = False
    """Threads of the program print in an unspecified order."""
    leaves_threads: bool = False
    """It ends with a thread in rclpy. CPython before 3.14 unwinds such a thread when it comes back from C++, which
    may abort all (`std::terminate`): where that befell real rclpy, what it did until then is compared.
    """

    def name(self) -> str:
        return "-".join((self.program, *shlex.split(self.arguments)[2:3]))


@dataclass
class Observation:
    """Observations in the order of the steps."""

    seen: list[Any] = field(default_factory=list)
    output: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    code: int | None = None


Both = tuple[Observation, Observation]
Observed = Callable[[Case], Both]


def difference(case: Case, expected: Observation, found: Observation) -> str:
    """Return the lines that differ."""
    assert not any(isinstance(one, str) and one.startswith(("nothing", "not ended")) for one in expected.seen), expected
    if case.leaves_threads and (expected.code, expected.errors[-1:]) == (-signal.SIGABRT, [_ABORTED]):
        expected = replace(expected, code=0, errors=expected.errors[:-1])
    texts = [pformat(asdict(one), width=110, sort_dicts=True).splitlines() for one in (expected, found)]
    return "\n".join(difflib.unified_diff(*texts, "real rclpy", "ours", lineterm="", n=1))


class _Process:
    """Running program and its output.

    Attributes:
        ended: task that ends after the program.
    """

    def __init__(self, process: asyncio.subprocess.Process, changed: Callable[[], None]) -> None:
        self.process = process
        self.texts = {"stdout": "", "stderr": ""}
        self._changed = changed
        self.ended = asyncio.ensure_future(self._read_to_end())
        self.ended.add_done_callback(lambda _: changed())

    @classmethod
    async def start(cls, command: list[str], settings: dict[str, str], changed: Callable[[], None]) -> _Process:
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RCUTILS_", "PYTHON"))}
        environment = {**kept, "PYTHONUNBUFFERED": "1", **settings}
        pipe = subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            *command,
            env=environment,
            cwd=PROGRAMS.parent,
            limit=1 << 20,
            stdin=subprocess.DEVNULL,
            stdout=pipe,
            stderr=pipe,
        )
        return cls(process, changed)

    async def _read(self, name: str) -> None:
        async for line in getattr(self.process, name):
            self.texts[name] += line.decode()
            self._changed()

    async def _read_to_end(self) -> None:
        await asyncio.gather(*map(self._read, self.texts))
        await self.process.wait()

    def sleeps(self) -> bool:
        """Return True if all its threads wait."""
        try:
            stats = [path.read_text() for path in Path(f"/proc/{self.process.pid}/task").glob("*/stat")]
        except OSError:
            return False
        return all(stat.rpartition(")")[2].split()[0] == "S" for stat in stats)

    async def idle(self) -> None:
        """Wait until it sleeps, three times in a row, or has ended."""
        for _ in range(3):
            while not (self.sleeps() or self.ended.done()):
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.01)

    async def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        await self.ended


class Observer:
    """Runs a case once, in a domain of its own."""

    def __init__(self, domain: int, case: Case) -> None:
        self._case = case
        self._context: Context | None = None
        if case.steps:
            self._context = Context(domain_id=domain, transport="dds", args=["observer"])
            self._node = Node("observer", context=self._context)
            self._own = self._node.fully_qualified_name
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._publishers: dict[str, Any] = {}
        self._open_calls: list[asyncio.Future[Any]] = []
        self._received: dict[tuple[str, str], list[Any]] = {}

    async def run(self, command: list[str], settings: dict[str, str], like: Observation | None = None) -> Observation:
        """Start the program and execute all steps.

        Args:
            command: command that starts the program.
            settings: environment variables.
            like: observations under the other rclpy. Graphs are awaited until they are equal, because discovery takes
                time.
        """
        for step in self._case.steps:
            if isinstance(step, Receive) and (step.topic, step.type) not in self._received:
                got = self._received.setdefault((step.topic, step.type), [])
                self._node.create_subscription(step.type, step.topic, self._keep(got), step.qos)
        found = Observation()
        process = await _Process.start([*command, *shlex.split(self._case.arguments)], settings, self._news.set)
        try:
            for number, step in enumerate(self._case.steps):
                expected = like.seen[number] if like is not None and number < len(like.seen) else None
                try:
                    found.seen.append(await self._do(step, process, expected))
                except TimeoutError:
                    found.seen.append(f"nothing within {TIMEOUT_S} seconds")
                    break
            try:
                await self._end(process, repeats_signal=like is None)
                found.code = process.process.returncode
            except TimeoutError:
                found.seen.append(f"not ended within {TIMEOUT_S} seconds")
        finally:
            await process.close()
            for task in self._open_calls:
                task.cancel()
            await asyncio.gather(*self._open_calls, return_exceptions=True)
            if self._context is not None:
                self._context.close()
        found.output = _plain(process.texts["stdout"]).splitlines()
        found.errors = _plain(process.texts["stderr"]).splitlines()
        if self._case.unordered:
            found.output.sort()
            found.errors.sort()
        return found

    def _keep(self, got: list[Any]) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            got.append(message)
            self._news.set()

        return keep

    async def _until(self, condition: Callable[[], object], timeout_s: float = TIMEOUT_S) -> None:
        end = self._loop.time() + timeout_s
        timer = self._loop.call_at(end, self._news.set)
        try:
            while not condition():
                if self._loop.time() >= end:
                    raise TimeoutError
                self._news.clear()
                await self._news.wait()
        finally:
            timer.cancel()

    async def _end(self, process: _Process, *, repeats_signal: bool) -> None:
        """Wait until the program has ended; repeat a signal, because a busy real rclpy may lose one before it waits."""
        last = self._case.steps[-1] if self._case.steps else None
        for _ in range(3):
            if repeats_signal and isinstance(last, Interrupt):
                with contextlib.suppress(TimeoutError):
                    return await self._until(process.ended.done, TIMEOUT_S / 3)
                await process.idle()
                process.process.send_signal(last.signal)
        await self._until(process.ended.done)

    async def _do(self, step: Step, process: _Process, expected: Any) -> Any:
        match step:
            case Publish(topic, type_, messages, qos):
                if topic not in self._publishers:
                    self._publishers[topic] = self._node.create_publisher(type_, topic, qos)
                publisher = self._publishers[topic]
                if not await publisher.wait_for_subscribers(timeout_s=TIMEOUT_S):
                    raise TimeoutError
                await process.idle()  # so that it knows the publisher
                for message in messages:
                    publisher.publish(message)
                return len(messages)
            case Receive(topic, type_, count):
                got = self._received[topic, type_]
                await self._until(lambda: len(got) >= count or process.ended.done())
                return _without_stamps(got[:count])
            case Call(service, type_, request):
                call = self._node.create_client(type_, service).call(request, timeout_s=TIMEOUT_S)
                if isinstance(step, Ask):
                    self._open_calls.append(asyncio.ensure_future(call))
                    return None
                return _without_stamps(await call)
            case Printed(text, count):
                streams = ("stdout", "stderr")
                await self._until(lambda: sum(process.texts[name].count(text) for name in streams) >= count)
                return None
            case Graph():
                await process.idle()  # its start is complete
                return await self._stable_graph(process, expected)
            case Parameters(node):
                return await self._parameters(node)
            case Interrupt(number):
                await process.idle()  # the callback whose output was awaited has returned
                process.process.send_signal(number)
                return None

    async def _stable_graph(self, process: _Process, expected: Any) -> Any:
        """Return the graph as soon as it is as expected, or complete and stable while the program sleeps."""
        seen, since = self._graph(), self._loop.time()
        end = since + TIMEOUT_S
        while seen != expected and self._loop.time() < end:
            if expected is None and self._is_whole() and self._loop.time() >= since + _STABLE_S:
                break
            await asyncio.sleep(0.05)
            now = self._graph()
            if now != seen or not (process.sleeps() or process.ended.done()):
                seen, since = now, self._loop.time()
        return seen

    def _is_whole(self) -> bool:
        """Return True if there are nodes, and all endpoints they announce and their nodes are known."""
        node = self._node
        return len(node.get_nodes()) > 1 and node.node_names_complete() and node.endpoints_complete()

    def _graph(self) -> Any:
        node = self._node
        nodes: dict[str, Any] = {}
        for info in node.get_nodes():
            if info.fully_qualified_name == self._own:
                continue
            name_and_namespace = info.name, info.namespace
            nodes[info.fully_qualified_name] = {
                "publishers": node.get_publisher_names_and_types_by_node(*name_and_namespace),
                "subscribers": node.get_subscriber_names_and_types_by_node(*name_and_namespace),
                "services": node.get_service_names_and_types_by_node(*name_and_namespace),
                "clients": node.get_client_names_and_types_by_node(*name_and_namespace),
            }
        endpoints = []
        for topic, _ in node.get_topic_names_and_types():
            for end in (*node.get_publishers_info_by_topic(topic), *node.get_subscriptions_info_by_topic(topic)):
                name = f"{end.node_namespace.rstrip('/')}/{end.node_name}"
                if name != self._own:
                    type_ = end.topic_type, str(end.topic_type_hash)
                    endpoints.append((topic, end.endpoint_type.name, name, *type_, _qos(end.qos_profile)))
        return nodes, sorted(endpoints)

    async def _parameters(self, name: str) -> Any:
        client = self._node.create_parameter_client(name)
        names = sorted((await client.list(timeout_s=TIMEOUT_S)).names)
        described = await client.describe(names, timeout_s=TIMEOUT_S)
        found = {}
        for one, text in zip(names, described, strict=True):
            try:
                value = repr(await client.get(one, timeout_s=TIMEOUT_S))
            except ParameterNotDeclaredError:  # the reply of rclpy's service for a parameter without a value
                value = "no answer"
            found[one] = value, repr(text)
        return found


def _qos(qos: QoSProfile) -> dict[str, Any]:
    """Return the policies that are announced, which history and depth are not."""
    names = ("reliability", "durability", "deadline_ns", "lifespan_ns", "liveliness", "liveliness_lease_ns")
    return {name: str(getattr(qos, name)) for name in names}


def _plain(text: str) -> str:
    for pattern, short in _VARIABLE_TEXTS:
        text = pattern.sub(short, text)
    return text


def _without_stamps(value: Any) -> Any:
    if isinstance(value, dict):
        names = value.keys()
        if names == {"sec", "nanosec"}:
            return "some time" if any(value.values()) else "no time"
        return {name: _without_stamps(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_without_stamps(one) for one in value]
    return value.tolist() if hasattr(value, "tolist") else value
