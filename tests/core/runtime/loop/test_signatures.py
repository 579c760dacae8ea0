"""Callbacks with a wrong signature are refused when they are passed."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any
from unittest.mock import AsyncMock, Mock

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import String
from std_srvs.srv import SetBool

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime import CallbackSignatureError, Clock, Context, LifecycleNode, MemoryTransport, Node

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@pytest.fixture
def node() -> Iterator[Node]:
    with Context(0, transport=MemoryTransport(), args=["test"]) as context:
        yield Node("n", context=context)


def none() -> None: ...


def one(_: Any) -> Any: ...


def two(_: Any, __: Any) -> None: ...


async def later(_: Any, __: Any) -> None: ...


@dataclass
class Speed:
    top: Annotated[float, none] = 1.0


@dataclass
class Plain:
    top: float = 1.0


PLACES: dict[str, Callable[[Node, Any], object]] = {
    "the callback of /t": lambda node, f: node.create_subscription(String, "t", f),
    "the handler of service /s": lambda node, f: node.create_service(SetBool, "s", f),
    "a timer's callback": lambda node, f: node.create_timer(1.0, f),
    "execute of action /a": lambda node, f: node.create_action_server(Fibonacci, "a", f),
    "goal_callback of action /a": lambda node, f: node.create_action_server(Fibonacci, "a", one, goal_callback=f),
    "cancel_callback of action /a": lambda node, f: node.create_action_server(Fibonacci, "a", one, cancel_callback=f),
    "the pre-set callback": lambda node, f: node.add_pre_set_callback(f),
    "the on-set callback": lambda node, f: node.add_on_set_callback(f),
    "the post-set callback": lambda node, f: node.add_post_set_callback(f),
    "the validator": lambda node, f: node.declare_parameters(Plain, validator=f),
    "the pre callback of a time jump": lambda node, f: node.clock.create_jump_callback(pre=f),
    "the post callback of a time jump": lambda node, f: Clock().create_jump_callback(post=f),
}


@pytest.mark.parametrize("what", PLACES)
def test_wrong_signature_is_refused_by_every_method_that_takes_a_callback(node: Node, what: str) -> None:
    for function in (one if "timer" in what else none, two):
        with pytest.raises(CallbackSignatureError) as caught:
            PLACES[what](node, function)
        assert str(caught.value).startswith(what) and f"{function.__name__}(" in str(caught.value)
        assert isinstance(caught.value, TypeError) and isinstance(caught.value, RosidlError)
    assert [name for name, _ in node.get_topic_names_and_types() if name in ("/t", "/a/_action/status")] == []


def test_signature_error_states_passed_arguments_and_fix(node: Node) -> None:
    wrong: Any = two
    with pytest.raises(CallbackSignatureError, match=r"gets 1 argument \(the request\), which two\(.* makes the resp"):
        node.create_service(SetBool, "s", wrong)
    with pytest.raises(CallbackSignatureError, match="receive_with_info"):
        node.create_subscription(String, "t", wrong)
    with pytest.raises(CallbackSignatureError, match="gets no argument"):
        node.create_timer(1.0, wrong)
    with pytest.raises(RosidlError, match="the validator 'none' gets 1 argument"):
        node.declare_parameters(Speed)


def test_lifecycle_node_with_wrong_callback_signature_is_refused_and_closed() -> None:
    class Wrong(LifecycleNode):
        def on_activate(self) -> None:  # type: ignore[override]
            ...

    with Context(0, transport=MemoryTransport(), args=["test"]) as context:
        with pytest.raises(CallbackSignatureError, match="on_activate of a lifecycle node"):
            Wrong("n", context=context)
        assert Node("other", context=context).get_node_names() == ["/other"]


class Part:
    def method(self, message: String) -> None: ...

    def wrong(self) -> None: ...

    @classmethod
    def of_class(cls, message: String) -> None: ...

    @staticmethod
    def static(message: String) -> None: ...

    def __call__(self, message: String) -> None: ...


def injecting(function: Callable[..., object]) -> Callable[..., object]:
    @functools.wraps(function)
    def wrapper(*arguments: object) -> object:
        return function("lock", *arguments)

    return wrapper


@pytest.mark.parametrize(
    "function",
    [
        Part().method,
        Part.of_class,
        Part.static,
        Part(),
        functools.partial(two, 1),
        functools.partial(Part.method, Part()),
        lambda message, number=3: None,
        lambda *messages: None,
        lambda message, **options: None,
        [].append,
        print,
        dict,
        Mock(),
        AsyncMock(),
        injecting(two),
    ],
)
def test_every_callable_that_accepts_a_message_is_accepted(node: Node, function: Any) -> None:
    node.create_subscription(String, "t", function)


@pytest.mark.parametrize(
    "function", [Part().wrong, functools.partial(one, 1), lambda *, message: None, [].clear, later]
)
def test_callables_that_cannot_accept_one_message_are_refused(node: Node, function: Any) -> None:
    with pytest.raises(CallbackSignatureError):
        node.create_subscription(String, "t", function)
