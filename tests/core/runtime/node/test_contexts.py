"""Contexts: forks, domains that are open already, nodes that cannot start, calls after close."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import textwrap
import warnings
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int32
from support.folders import ROOT
from support.inner_state import reader_of
from support.waiting import until

from rosidl_py_gen.errors import ClosedError, InvalidNameError
from rosidl_py_gen.runtime import BackendMissingError, Context, Node, ParameterDescriptor, TransportError
from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError
from rosidl_py_gen.runtime.node.context import core_of, open_contexts

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

    from support.worlds import World

pytestmark = pytest.mark.on_zenoh

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")


def python(text: str, timeout_s: float = 60, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a process, with a timeout."""
    return subprocess.run(
        [sys.executable, "-W", "default", "-c", text],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


FORK = """
import asyncio, os, sys, warnings
from rosidl_py_gen.runtime import Context, MemoryTransport, Node, TransportError
warnings.simplefilter("ignore", DeprecationWarning)  # newer Pythons: "may lead to deadlocks"

def forked(action):
    child = os.fork()
    if child == 0:
        try:
            print(action())
        except TransportError as error:
            print(error)
        sys.exit(7)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)

def talk(name="child"):
    with Node(name) as node:
        return f"/{name}" in node.get_node_names()
"""


@pytest.mark.slow
@needs_fork
def test_a_forked_child_of_a_process_with_nodes_exits_and_leaves_parent_usable() -> None:
    text = """
node = Node("parent")
publisher = node.create_publisher("std_msgs/msg/Int32", "s")
async def loop():
    async with node:
        forked(lambda: os.getpid())
forked(node.close)
asyncio.run(loop())
print(talk("still alive".replace(" ", "_")))
"""
    done = python(FORK + text)
    assert (done.stderr, done.returncode) == ("", 0)
    answers = done.stdout.splitlines()
    assert answers[:2] == ["None", "7"] and answers[2].isdigit() and answers[3:] == ["7", "True"]


@pytest.mark.slow
@needs_fork
def test_a_forked_child_closes_a_client_while_discovery_changes_in_the_parent() -> None:
    text = """
import threading
node = Node("parent", context=Context(transport=MemoryTransport()))
client = node.create_client("example_interfaces/srv/AddTwoInts", "add")
actions = node.create_action_client("example_interfaces/action/Fibonacci", "count")
is_held, is_over = threading.Event(), threading.Event()
def change():
    with node._scope.participant.endpoint_index.change_lock:
        is_held.set()
        is_over.wait()
thread = threading.Thread(target=change)
thread.start()
is_held.wait()
forked(client.close)
forked(actions.close)
is_over.set()
thread.join()
node.close()
"""
    done = python(FORK + text, timeout_s=20)
    assert (done.stderr, done.stdout) == ("", "None\n7\nNone\n7\n")


@pytest.mark.slow
@needs_fork
def test_a_forked_child_of_a_dds_process_can_use_only_memory_transport() -> None:
    text = """
node = Node("parent")
forked(talk)
forked(lambda: Context((node.context.domain_id + 1) % 200))
forked(lambda: Node("child", context=Context(transport=MemoryTransport())))
"""
    done = python(FORK + text)
    refused, end, again, _, created, _ = done.stdout.splitlines()
    assert refused.startswith("this process was forked from one that uses DDS") and "spawn" in refused
    assert (end, again, created.partition(",")[0], done.returncode) == ("7", refused, "Node(/child", 0)


@pytest.mark.slow
@needs_fork
def test_a_forked_child_can_use_dds_if_no_context_was_open() -> None:
    done = python(FORK + "talk()\nforked(talk)\nprint(talk())")
    assert (done.stdout, done.stderr) == ("True\n7\nTrue\n", "")


def in_forked_child(action: Callable[[], object]) -> str:
    """Return the result, or the exception, of `action` in a forked child of this process."""
    fork: Any = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe()

    def body(answers: Connection) -> None:
        try:
            answers.send(repr(action()))
        except BaseException as error:
            answers.send(f"{type(error).__name__}: {error}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # newer Pythons: "may lead to deadlocks", which we test
        child = fork.Process(target=body, args=(theirs,))
        child.start()
    try:
        assert ours.poll(30), "the child hangs"
        return str(ours.recv())
    finally:
        child.join(30)
        alive = child.is_alive()
        child.kill()
        child.join()
        assert not alive, "the child does not end"


async def enter(node: Node) -> None:
    async with node:
        pass


@pytest.mark.every_transport
@needs_fork
def test_inherited_nodes_and_entities_raise_closed_error_after_a_fork(world: World) -> None:
    node = world.node("parent")
    publisher = node.create_publisher(Int32, "s")
    subscription = node.create_subscription(Int32, "s")
    time, parameters = node.create_sim_time_publisher(), node.create_parameter_client("other")
    uses: list[Callable[[], object]] = [
        lambda: publisher.publish(Int32()),
        lambda: node.create_publisher(Int32, "t"),
        lambda: node.create_timer(1.0),
        node.get_node_names,
        lambda: asyncio.run(subscription.receive()),
        lambda: time.advance(1.0),
        lambda: asyncio.run(parameters.get("x", 1)),
        lambda: asyncio.run(node.wait_for_node("x", 1)),
        lambda: asyncio.run(node.wait_for_message(Int32, "x", 1)),
        lambda: asyncio.run(enter(node)),
        lambda: Node("child", context=node.context),
    ]
    for use in uses:
        answer = in_forked_child(use)
        assert answer.startswith("ClosedError: ") and "before this process was forked" in answer, answer
    for end in (node.close, publisher.close, subscription.close, time.close, parameters.close):
        assert in_forked_child(end) == "None"
    assert in_forked_child(node.context.close) == "None"
    assert in_forked_child(lambda: node.logger.warning("from the child")) == "None"
    assert node.get_node_names() == ["/parent"]
    publisher.publish(Int32(data=3))
    assert asyncio.run(subscription.receive(timeout_s=20)).data == 3


OPEN = """
from rosidl_py_gen.runtime import Context, TransportError
try:
    Context()
except TransportError as error:
    print(error)
"""


def test_second_configuration_of_a_domain_in_a_process_is_refused(dds: World) -> None:
    first = dds.context()
    with pytest.raises(TransportError, match="open in this process with another configuration") as caught:
        Context(first.domain_id, discovery="off", args=["test"])
    assert "AllowMulticast" in str(caught.value) and "ros_discovery_off" in str(caught.value)
    assert str(caught.value).count("<CycloneDDS>") == 2
    with Context(first.domain_id, discovery="localhost", args=["test"]) as second:
        assert second.domain_id == first.domain_id
    first.close()
    with Context(first.domain_id, discovery="off", args=["test"]) as third:
        assert not third.is_closed


@pytest.mark.slow
@pytest.mark.parametrize(
    "uri",
    [
        "<CycloneDDS><Domain>",
        "file:///nowhere/cyclone.xml",
        "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='no0'/></Interfaces></General></Domain>"
        "</CycloneDDS>",
    ],
)
def test_a_broken_cyclonedds_uri_is_quoted_in_the_error(uri: str) -> None:
    output = python(OPEN, CYCLONEDDS_URI=uri).stdout
    assert f"CYCLONEDDS_URI is set to {uri!r}" in output and "could not configure domain" in output


def test_missing_zenoh_package_is_reported_with_its_installation(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [one for one in sys.modules if one.startswith("rosidl_py_gen.runtime.transport.zenoh.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(BackendMissingError, match=r"import of zenoh halted.* To install them: .*zenoh") as caught:
        Context(transport="zenoh")
    assert caught.value.name == "zenoh"


@pytest.mark.slow
def test_domain_without_free_participant_index_is_reported(dds: World) -> None:
    from rosidl_py_gen.runtime.transport.cyclone.domain import has_free_index

    number = dds.context().domain_id
    assert has_free_index(number)
    with contextlib.ExitStack() as stack:
        for index in range(32):
            taken = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            with contextlib.suppress(OSError):  # our own context has one
                taken.bind(("127.0.0.1", 7400 + 250 * number + 10 + 2 * index))
        assert not has_free_index(number)
        output = python(OPEN).stdout
    assert "All 32 participant indexes of the domain are taken on this machine" in output and "ROS_DOMAIN_ID" in output


@pytest.mark.parametrize(
    ("name", "namespace", "args"),
    [("bad name", "", ""), ("n", "/a//b", ""), (None, "", ""), ("n", "", f"--ros-args -r n:__node:={'n' * 256}")],
)
def test_failed_node_creation_leaves_no_default_context(
    name: Any, namespace: str, args: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["test", *args.split()])
    with pytest.raises(InvalidNameError):
        Node(name, namespace)
    assert not any(core.is_default for core in open_contexts)
    with Node("other") as other:
        with pytest.raises(InvalidNameError):
            Node(name, namespace)
        assert not other.context.is_closed


async def test_node_that_cannot_be_entered_is_closed_and_others_stay_open(memory: World) -> None:
    context = memory.context()
    used = memory.node("used", context=context)
    core_of(context).loop_binding.running_loop()

    async def elsewhere() -> None:
        async with Node("second", context=context):
            raise AssertionError("two loops of one context")

    async def enter_used() -> None:
        async with used:
            raise AssertionError("two loops of one context")

    for attempt in (elsewhere, enter_used):
        with pytest.raises(WrongEventLoopError):
            await asyncio.to_thread(lambda attempt=attempt: asyncio.run(attempt()))
    assert not used.is_closed
    assert used.get_node_names() == ["/used"]


async def test_closed_node_raises_closed_error_in_every_method(world: World) -> None:
    node = world.node("n", "/ns")
    node.close()
    calls: list[Callable[[], object]] = [
        node.get_node_names,
        node.get_nodes,
        node.get_topic_names_and_types,
        node.get_service_names_and_types,
        lambda: node.get_publishers_info_by_topic("t"),
        lambda: node.get_subscriptions_info_by_topic("t"),
        lambda: node.count_publishers("t"),
        lambda: node.count_subscribers("t"),
        lambda: node.count_services("t"),
        lambda: node.count_clients("t"),
        lambda: node.get_servers_info_by_service("t"),
        lambda: node.get_clients_info_by_service("t"),
        lambda: node.incompatible_endpoints_of_topic("t"),
        lambda: node.incompatible_endpoints_of_service("t"),
        lambda: node.node_names_complete(),
        lambda: node.get_publisher_names_and_types_by_node("n"),
        lambda: node.get_subscriber_names_and_types_by_node("n"),
        lambda: node.get_service_names_and_types_by_node("n"),
        lambda: node.get_client_names_and_types_by_node("n"),
        lambda: node.create_publisher(Int32, "t"),
        lambda: node.set_descriptor("use_sim_time", ParameterDescriptor()),
        lambda: node.parameter_services(),
    ]
    for call in calls:
        with pytest.raises(ClosedError, match=r"^node /ns/n is closed$"):
            call()
    with pytest.raises(ClosedError, match=r"^node /ns/n is closed$"):
        async with node:
            pass
    with pytest.raises(ClosedError):
        await node.wait_for_node("n", timeout_s=0.1)


class Own(Node):
    """Node with a method as callback."""

    def __init__(self, context: Context, seen: list[int]) -> None:
        super().__init__("own", context=context)
        self.seen = seen
        self.create_subscription(Int32, "n", self.on_number)

    def on_number(self, message: Int32) -> None:
        self.seen.append(message.data)


async def test_unreferenced_node_with_method_callbacks_works_until_its_context_closes(world: World) -> None:
    seen: list[int] = []
    context, other = world.context(), world.node("other")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        Own(context, seen)
        gc.collect()
        publisher = other.create_publisher(Int32, "n")
        assert await publisher.wait_for_subscribers(timeout_s=5)
        publisher.publish(Int32(data=5))
        await until(lambda: seen == [5])
        context.close()
        await until(lambda: other.get_node_names() == ["/other"])


async def test_reader_state_does_not_grow_with_closed_publishers(memory: World) -> None:
    alice, bob = memory.pair()
    subscription = bob.create_subscription(Int32, "n")
    sizes: list[set[int]] = []
    for number in range(3):
        for _ in range(20):
            publisher = alice.create_publisher(Int32, "n")
            publisher.publish(Int32(data=number))
            message, info = await subscription.receive_with_info(timeout_s=10)
            assert (message.data, info.publisher_gid) == (number, publisher.gid)
            publisher.close()
        reader: Any = reader_of(subscription)
        sizes.append({len(part) for part in vars(reader).values() if isinstance(part, (dict, list, set))})
    assert sizes[0] == sizes[1] == sizes[2]


@pytest.mark.slow
def test_a_second_ctrl_c_does_not_interrupt_the_exit_of_a_process() -> None:
    """Launch sends SIGINT to its processes, and the terminal does so, too."""
    text = """
        import os, signal
        from rosidl_py_gen import get_message
        from rosidl_py_gen.runtime import Context, Node, Subscription

        def close(self, close=Subscription.close):
            os.kill(os.getpid(), signal.SIGINT)
            close(self)

        Subscription.close = close
        node = Node("open", context=Context(discovery="off"))
        node.create_subscription(get_message("std_msgs/msg/String"), "/t")
        raise KeyboardInterrupt
    """
    done = python(textwrap.dedent(text))
    assert done.returncode == -signal.SIGINT, done.stderr
    assert done.stderr.splitlines().count("KeyboardInterrupt") == 1 and "atexit" not in done.stderr
