"""Action types, and the names of an action's services and topics.

Goals, results and feedback are messages if the type is a generated class, and dicts if it is given as text.
Source of the names: docs/internals/protocol.md 8.1.

Servers, clients and goals are generic in one variable, the action class. Their methods find the types of goal, result
and feedback by annotating `self`: ``self: ServerGoal[Action[GoalT, Any, Any]]``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar, overload

import numpy as np

from rosidl_py_gen.cdr import Action, Message
from rosidl_py_gen.cdr.message import is_of_type
from rosidl_py_gen.errors import EncodeError
from rosidl_py_gen.msgs.action_msgs.msg import GoalStatusArray
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal, CancelGoal_Request, CancelGoal_Response
from rosidl_py_gen.runtime.entities.message_types import (
    DictMessage,
    MessageType,
    ServiceType,
    generated_class,
    message_type,
    service_type,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.names.remapping import NodeNames

GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")
ActionT = TypeVar("ActionT", bound=Action[Any, Any, Any])
ActionT_co = TypeVar("ActionT_co", bound=Action[Any, Any, Any], covariant=True)
"""Covariant, so that ``ServerGoal[Fibonacci]`` is a ``ServerGoal[Action[Fibonacci_Goal, ...]]``."""


UntypedAction: TypeAlias = Action[DictMessage, DictMessage, DictMessage]
"""Action whose type is given as text: goals, results and feedback are dicts."""


class ActionClass(Protocol[ActionT_co, GoalT, ResultT, FeedbackT]):
    """Generated action class, for type checkers: the class itself, and the types of goal, result and feedback.

    Python has no type for "a class whose base is `Action` of these"; the two overloads of calling it express both.
    """

    @overload
    def __call__(self) -> ActionT_co: ...
    @overload
    def __call__(self) -> Action[GoalT, ResultT, FeedbackT]: ...  # type: ignore[overload-cannot-match]


@dataclass(frozen=True, slots=True)
class ActionMessageType:
    """Goal, result or feedback type: its class, and the conversion between values of the user and messages.

    Attributes:
        to_message: raises `TypeError` for a value of another type, `EncodeError` for a dict that does not fit.
    """

    cls: type[Message]
    to_message: Callable[[Any], Message]
    to_value: Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class ActionType:
    """Action type, with the message and service types of its endpoints.

    Attributes:
        cls: the generated action class, with `SendGoal`, `GetResult` and `FeedbackMessage`.
    """

    ros_name: str
    cls: Any
    goal: ActionMessageType
    result: ActionMessageType
    feedback: ActionMessageType
    send_goal: ServiceType[Any, Any]
    get_result: ServiceType[Any, Any]
    feedback_message: MessageType[Any]
    cancel: ServiceType[CancelGoal_Request, CancelGoal_Response]
    status: MessageType[GoalStatusArray]

    def encode_result(self, status: int, result: object | None) -> bytes:
        """Encode a get_result response; None is a default result. Raises `TypeError`, `EncodeError`."""
        message = self.result.cls() if result is None else self.result.to_message(result)
        try:
            return self.get_result.response.encode(self.cls.GetResult.Response(status=int(status), result=message))
        except EncodeError:
            message._encode()  # raises the error without the names of the enclosing fields
            raise


def action_type(source: object, *, arrays: bool = False) -> ActionType:
    """Return the `ActionType` of a class or a type name; `arrays` and errors as in `message_type`."""
    cls = generated_class(source, Action, "example_interfaces/action/Fibonacci", arrays=arrays)
    convert = _dict_type if isinstance(source, str) else _class_type
    return ActionType(
        cls._TYPE.name,
        cls,
        convert(cls.Goal),
        convert(cls.Result),
        convert(cls.Feedback),
        service_type(cls.SendGoal, arrays=arrays),
        service_type(cls.GetResult, arrays=arrays),
        message_type(cls.FeedbackMessage, arrays=arrays),
        service_type(CancelGoal),
        message_type(GoalStatusArray),
    )


def _class_type(cls: type[Message]) -> ActionMessageType:
    def check(value: Any) -> Message:
        if not is_of_type(value, cls):
            raise TypeError(f"expected a {cls.__name__} ({cls._TYPE.name}), got {type(value).__name__}: {value!r:.100}")
        return value  # type: ignore[no-any-return]

    return ActionMessageType(cls, check, lambda message: message)


def _dict_type(cls: type[Message]) -> ActionMessageType:
    from rosidl_py_gen import from_dict, to_dict

    return ActionMessageType(cls, lambda value: from_dict(cls, value), to_dict)


@dataclass(frozen=True, slots=True)
class ActionNames:
    """Fully qualified names; each is expanded and remapped separately, as in ROS."""

    action: str
    send_goal: str
    cancel_goal: str
    get_result: str
    feedback: str
    status: str

    @classmethod
    def resolve(cls, names: NodeNames, action: str) -> ActionNames:
        """Expand and remap the names of an action; raises `InvalidNameError`."""
        return cls(
            names.resolve_topic(action),
            names.resolve_service(f"{action}/_action/send_goal"),
            names.resolve_service(f"{action}/_action/cancel_goal"),
            names.resolve_service(f"{action}/_action/get_result"),
            names.resolve_topic(f"{action}/_action/feedback"),
            names.resolve_topic(f"{action}/_action/status"),
        )


def set_goal_id(message: Any, goal_id: bytes) -> None:
    """Set the field `goal_id`, as an array: messages with rclpy's API do not accept bytes."""
    message.goal_id.uuid = np.frombuffer(goal_id, np.uint8)


def goal_id_of(message: Any) -> bytes:
    """Return the 16 bytes of the field `goal_id`."""
    return bytes(message.goal_id.uuid)
