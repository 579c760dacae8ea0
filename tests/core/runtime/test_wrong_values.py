"""Arguments of wrong types and values: the error states what was found and expected."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from std_msgs.msg import Int32

from rosidl_py_gen import runtime
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.runtime import Context, MemoryTransport, Node
from rosidl_py_gen.runtime.node.context import open_contexts
from rosidl_py_gen.runtime.node.settings import EnvironmentSettingError
from rosidl_py_gen.runtime.transport.qos import DEFAULT, InvalidQoSError, QoSProfile, Reliability

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.worlds import World


@pytest.mark.parametrize("bad", [MemoryTransport, 5, "memory"])
def test_transport_must_be_a_transport_object_or_name(bad: Any) -> None:
    with pytest.raises(TypeError, match=r"transport must be .* a transport object such as MemoryTransport\(\), got"):
        Context(transport=bad)


def test_context_argument_of_node_must_be_a_context(memory: World) -> None:
    for bad in (MemoryTransport(), 0, Context):
        with pytest.raises(TypeError, match=r"context must be a Context, such as Context\(transport=\.\.\.\), got"):
            Node("n", context=bad)  # type: ignore[arg-type]
    assert not any(core.is_default for core in open_contexts)


@pytest.mark.parametrize("bad", [None, 5, "", "bad name", "/a//b/n", "/ns/"])
async def test_wait_for_node_refuses_invalid_node_names(memory: World, bad: Any) -> None:
    with pytest.raises(InvalidNameError):
        await memory.node("n").wait_for_node(bad, timeout_s=0.01)


@pytest.mark.parametrize(
    "create",
    [
        lambda node, qos: node.create_publisher(Int32, "t", qos),
        lambda node, qos: node.create_subscription(Int32, "t", qos=qos),
        lambda node, qos: node.create_service("std_srvs/srv/Trigger", "s", qos=qos),
        lambda node, qos: node.create_client("std_srvs/srv/Trigger", "s", qos=qos),
    ],
    ids=["publisher", "subscription", "service", "client"],
)
def test_entities_refuse_invalid_qos(memory: World, create: Callable[[Node, Any], object]) -> None:
    node = memory.node("n")
    for bad in (QoSProfile(reliability=Reliability.UNKNOWN), "best_effort", 1.5):
        with pytest.raises(InvalidQoSError):
            create(node, bad)
    create(node, DEFAULT)


@pytest.mark.parametrize("bad", [5, 1.5, True, "--ros-args", b"x", object()])
def test_args_must_be_a_list_of_strings(bad: Any) -> None:
    with pytest.raises(TypeError, match=r"args must be a list of arguments such as \['program', '--ros-args'\], got"):
        Context(args=bad, transport=MemoryTransport())
    with pytest.raises(TypeError, match="args must be texts, got 5"):
        Context(args=["p", 5], transport=MemoryTransport())  # type: ignore[list-item]


def test_args_may_be_an_iterator() -> None:
    args: Any = iter(["p", "--ros-args", "-r", "__node:=m"])
    with Context(args=args, transport=MemoryTransport()) as context:
        assert Node("n", context=context).fully_qualified_name == "/m"


@pytest.mark.parametrize("discovery", ["LOCALHOST", "localhost", "Localhost"])
def test_discovery_argument_is_case_insensitive(monkeypatch: pytest.MonkeyPatch, discovery: str) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")  # the argument wins, or the guard fails
    with Context(discovery=discovery) as context:
        assert not context.is_closed


@pytest.mark.parametrize("bad", ["LOCAL", "", 5, b"off"])
def test_an_unknown_discovery_is_refused(bad: Any) -> None:
    with pytest.raises(EnvironmentSettingError, match=r"discovery must be one of .*'localhost'.*, got"):
        Context(discovery=bad, transport=MemoryTransport())


@pytest.mark.parametrize("number", [np.int64(91), np.uint8(91), 91])
def test_domain_id_may_be_any_integer_type(number: Any) -> None:
    with Context(number, transport=MemoryTransport()) as context:
        assert context.domain_id == 91
        assert type(context.domain_id) is int


@pytest.mark.parametrize("bad", [True, np.bool_(True), -1, np.int64(233), 1.0, np.float64(1), "5", np.arange(3)])
def test_invalid_domain_ids_are_refused(bad: Any) -> None:
    with pytest.raises(EnvironmentSettingError, match="domain_id must be a whole number from 0 to 232"):
        Context(bad, transport=MemoryTransport())


def modules() -> Iterator[Any]:
    """Yield every module of the runtime except the pytest plugin."""
    for found in pkgutil.walk_packages(runtime.__path__, f"{runtime.__name__}."):
        if not found.name.endswith("pytest_plugin"):
            yield importlib.import_module(found.name)


INTERNAL_ERRORS = {"AttachmentError", "RefusedError", "RequestTimedOutError", "VirtualTimeDeadlockError"}
"""Caught where they are raised; the last one fails a test."""
OF_OTHER_MODULES = {"DefinitionError", "ExtraMissingError", "YamlError", "ZenohConfigError"}


def test_every_error_of_the_runtime_is_exported() -> None:
    errors = {
        value
        for module in modules()
        for name, value in vars(module).items()
        if inspect.isclass(value) and issubclass(value, RosidlError) and not name.startswith("_")
    }
    missing = {error.__name__ for error in errors if getattr(runtime, error.__name__, None) is not error}
    assert missing == INTERNAL_ERRORS | OF_OTHER_MODULES
    for name in ("FloatRange", "IntRange", "Parameter", "GoalRequest", "CancelRequest", "GoalResult", "ClosedError"):
        assert name in runtime.__all__
    assert {error.__name__ for error in errors} - missing <= set(runtime.__all__)
