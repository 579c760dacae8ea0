"""Nodes on Zenoh: choice of the transport, threads, end of calls and processes, QoS."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
import time
from typing import Any

import pytest
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String
from support.folders import ROOT
from support.inner_state import transport_end_of
from support.local_network import zenoh_environment, zenoh_router
from support.processes import running_process
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import compile_definition, type_hash
from rosidl_py_gen.runtime import Context, Node, QoSProfile
from rosidl_py_gen.runtime.node.context import resolve_transport
from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneTransport
from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohTransport


def run_program(text: str) -> tuple[int, str, str]:
    """Run a program to its end; return its code, output and errors."""
    path = os.pathsep.join((str(ROOT), *(entry for entry in sys.path if "runtime-tests-" in entry)))
    with running_process(sys.executable, "-c", text, **zenoh_environment(), PYTHONPATH=path) as process:
        output, errors = process.communicate(timeout=60)
    return process.returncode, output, errors


# -------------------------------------------------------------------------------------------------------------- choice


@pytest.mark.parametrize(
    ("transport", "variable", "kind"),
    [
        (None, "", CycloneTransport),
        (None, "rmw_fastrtps_cpp", CycloneTransport),
        (None, "rmw_cyclonedds_cpp", CycloneTransport),
        (None, "rmw_zenoh_cpp", ZenohTransport),
        ("zenoh", "rmw_cyclonedds_cpp", ZenohTransport),
        ("dds", "rmw_zenoh_cpp", CycloneTransport),
    ],
)
def test_transport_argument_overrides_rmw_implementation(
    transport: str | None, variable: str, kind: type[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", variable)
    assert type(resolve_transport(transport)) is kind


def test_zenoh_is_the_default_if_only_zenoh_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rosidl_py_gen.runtime.node.settings.library.is_found", lambda: False)
    assert isinstance(resolve_transport(None), ZenohTransport)


def test_unknown_rmw_implementation_warns_and_unknown_transport_raises(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_desert")
    assert isinstance(resolve_transport(None), CycloneTransport)
    assert "RMW_IMPLEMENTATION='rmw_desert' ignored: unknown" in caplog.text
    with pytest.raises(TypeError, match=r"transport must be 'dds', 'zenoh' or .* got 'zenho'"):
        Context(transport="zenho")


_CYCLONE = "rosidl_py_gen.runtime.transport.cyclone.participant"


@pytest.mark.parametrize(
    ("text", "unwanted"),
    [
        ("import rosidl_py_gen.compiler.generate, rosidl_py_gen.generator_cli", ("zenoh", "xxhash", _CYCLONE)),
        ("from rosidl_py_gen.runtime import Context; Context(transport='dds')", ("zenoh", "xxhash")),
        ("from rosidl_py_gen.runtime import Context; Context(transport='zenoh')", (_CYCLONE,)),
    ],
)
def test_only_the_selected_middleware_is_imported(text: str, unwanted: tuple[str, ...]) -> None:
    code, output, errors = run_program(f"{text}\nimport sys\nprint(sorted(sys.modules.keys() & set({unwanted!r})))")
    assert (code, output) == (0, "[]\n"), errors


def test_context_without_zenoh_router_opens_with_a_warning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", 'connect/endpoints=["tcp/127.0.0.1:1"];listen/endpoints=[]')
    Context(transport="zenoh").close()
    assert "no Zenoh router answers at tcp/127.0.0.1:1" in caplog.text and "rosidl-py zenoh-router" in caplog.text
    caplog.clear()
    monkeypatch.setenv("ZENOH_ROUTER_CHECK_ATTEMPTS", "-1")
    Context(transport="zenoh").close()
    assert caplog.text == ""


def test_zenoh_client_mode_without_router_raises_transport_error(monkeypatch: pytest.MonkeyPatch) -> None:
    override = 'mode="client";connect/endpoints=["tcp/127.0.0.1:1"];listen/endpoints=[]'
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", override)
    with pytest.raises(TransportError, match=r"It was configured to connect to tcp/127\.0\.0\.1:1"):
        Context(transport="zenoh")


# --------------------------------------------------------------------------------------------------------------- calls


async def test_unanswered_requests_are_removed_when_their_client_closes(zenoh: World) -> None:
    server = zenoh.node("server").create_service(AddTwoInts, "add")
    caller = zenoh.node("caller")
    client = caller.create_client(AddTwoInts, "add")
    calling = asyncio.ensure_future(client.call(AddTwoInts.Request(), timeout_s=20))
    await anext(server)
    reader: Any = transport_end_of(server)
    assert len(reader.queries) == 1
    caller.context.close()
    await until(lambda: not reader.queries)
    with pytest.raises(Exception, match="closed"):
        await calling


async def test_service_and_action_types_of_peers_are_resolved_by_their_own_hash(
    zenoh: World,
) -> None:
    robot, asker = zenoh.pair()
    ask: Any = compile_definition("robot_msgs/srv/Ask", "string question\n---\nint32 answer")
    go: Any = compile_definition("robot_msgs/action/Go", "float64 far\n---\nbool arrived\n---\nfloat64 left")
    robot.create_service(ask, "ask", lambda request: ask.Response(answer=len(request.question)))
    robot.create_action_server(go, "go", lambda goal: None)
    found = await asker.resolve_service_type("ask", timeout_s=10)
    assert type_hash(found) == type_hash(ask)
    response = await asker.create_client(found, "ask").call(found.Request(question="four"), timeout_s=20)
    assert response.answer == 4
    assert type_hash(await asker.resolve_action_type("go", timeout_s=10)) == type_hash(go)
    description = await asker.get_type_description("/alice", "robot_msgs/srv/Ask", timeout_s=20)
    assert description.type_description.type_description.type_name == "robot_msgs/srv/Ask"


# --------------------------------------------------------------------------------------------------- threads, processes


async def test_endpoints_start_no_threads(zenoh: World) -> None:
    alice, bob = zenoh.pair()
    before = threading.active_count()
    for number in range(20):
        alice.create_subscription(String, f"t{number}", lambda message: None)
        alice.create_service(AddTwoInts, f"s{number}", lambda request: AddTwoInts.Response())
    client = bob.create_client(AddTwoInts, "s3")
    await client.call(AddTwoInts.Request(), timeout_s=20)
    assert threading.active_count() == before


NODE = """
import asyncio, os, signal, sys, threading
from std_msgs.msg import String
from rosidl_py_gen.runtime import Context, Node, run
node = Node("left")
node.create_subscription(String, "t", lambda message: None)
node.create_publisher(String, "t", qos=10).publish(String(data="x"))
latched = node.create_publisher(String, "t2")
"""
ENDS = {
    "nothing is closed": ("", 0),
    "an exception in the loop": ("async def main():\n    raise SystemExit(4)\nasyncio.run(main())", 4),
    "a forked child that ends": ("pid = os.fork()\nif pid: sys.exit(os.waitpid(pid, 0)[1])", 0),
    "a forked child that opens a context": (
        "pid = os.fork()\n"
        "if pid: sys.exit(os.waitpid(pid, 0)[1] >> 8)\n"
        "try: Context()\nexcept Exception as error: sys.exit(5 if 'forked' in str(error) else 6)",
        5,
    ),
    "a forked child that forgets its parent's router": (
        "from rosidl_py_gen.runtime import ZenohRouter\n"
        "router = ZenohRouter({}, print, listen=['tcp/127.0.0.1:0'])\n"
        "pid = os.fork()\n"
        "if pid: sys.exit(os.waitpid(pid, 0)[1] >> 8)\n"
        "router.close()\ndel router\nsys.exit(7)",
        7,
    ),
    "SIGTERM of run": (
        "async def main():\n    os.kill(os.getpid(), signal.SIGTERM)\n    await asyncio.Event().wait()\nrun(main)",
        None,
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_processes_with_zenoh_end_promptly_in_every_way(name: str) -> None:
    text, expected = ENDS[name]
    began = time.monotonic()
    code, _, errors = run_program(f"{NODE}\n{text}")
    assert expected is None or code == expected, errors
    assert "Traceback" not in errors and "panicked" not in errors
    assert time.monotonic() - began < 15


# ----------------------------------------------------------------------------------------------------------------- QoS


async def test_endpoints_of_any_qos_exchange_messages(zenoh: World) -> None:
    alice, bob = zenoh.pair()
    best_effort = alice.create_publisher(String, "t", qos=QoSProfile().best_effort())
    subscription = bob.create_subscription(String, "t", qos=QoSProfile().reliable().transient_local().deadline(1))
    assert await best_effort.wait_for_subscribers(20) and await subscription.wait_for_publishers(20)
    best_effort.publish(String(data="arrives"))
    assert (await subscription.receive(20)).data == "arrives"


def test_test_router_and_contexts_are_restricted_to_loopback() -> None:
    assert zenoh_router().startswith("tcp/127.0.0.1:")
    with pytest.raises(AssertionError, match="not bound to loopback"), pytest.MonkeyPatch.context() as patch:
        patch.setenv("ZENOH_CONFIG_OVERRIDE", 'listen/endpoints=["tcp/[::]:0"]')
        Node("n", context=Context(transport="zenoh"))
