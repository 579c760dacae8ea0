"""Action types, the names of an action's services and topics, and the common base of action clients and servers.

Goals, results and feedback are messages if the type is a generated class, and dicts if the type is given by its name.
Goal ids and stamps must not be all zeros, because zeros select every goal in a cancel request.
Source: docs/internals/protocol.md 8.1, 8.4.

Servers, clients and goals are generic in one variable, the action class. Their methods find the types of goal, result
and feedback by annotating `self`: ``self: ServerGoal[Action[GoalT, Any, Any]]``.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, TypeVar, get_args, overload

import numpy as np

from rosidl_py_gen.cdr import Action, Message
from rosidl_py_gen.cdr.message import is_of_type
from rosidl_py_gen.errors import EncodeError, RosidlError
from rosidl_py_gen.msgs.action_msgs import msg
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity, user_callback
from rosidl_py_gen.runtime.entities.message_types import (
    DictMessage,
    MessageType,
    ServiceType,
    generated_class,
    message_type,
    service_type,
)
from rosidl_py_gen.runtime.entities.services import ServiceEndpoint
from rosidl_py_gen.runtime.time_values import Time

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.introspection import IntrospectionState
    from rosidl_py_gen.runtime.graph import TypeCheck
    from rosidl_py_gen.runtime.loop.callbacks import UserCallback
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.transport.qos import QoSLike

GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")
ActionT = TypeVar("ActionT", bound=Action[Any, Any, Any])
ActionT_co = TypeVar("ActionT_co", bound=Action[Any, Any, Any], covariant=True)
"""Type variable for an action class. It is covariant, so that ``ServerGoal[Fibonacci]`` is a
``ServerGoal[Action[Fibonacci_Goal, ...]]``."""


UntypedAction: TypeAlias = Action[DictMessage, DictMessage, DictMessage]
"""Action whose type is given by its name: goals, results and feedback are dicts."""


class ActionClass(Protocol[ActionT_co, GoalT, ResultT, FeedbackT]):
    """Type of a generated action class for type checkers, which infer the types of goal, result and feedback from it.

    Python has no type for "a class whose base is `Action[GoalT, ResultT, FeedbackT]`"; the two overloads of `__call__`
    express that a call returns the class itself and its base.
    """

    @overload
    def __call__(self) -> ActionT_co: ...
    @overload
    def __call__(self) -> Action[GoalT, ResultT, FeedbackT]: ...  # type: ignore[overload-cannot-match]


@dataclass(frozen=True, slots=True)
class ActionMessageType:
    """Goal, result or feedback type of an action, with the conversions between the user's values and messages.

    Attributes:
        cls: generated message class.
        to_message: converts a message or dict of the user; raises `TypeError` for a value of another type,
            `EncodeError` for a dict that does not fit.
        to_value: converts a message to the value that the user gets.
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
    cancel: ServiceType[CancelGoal.Request, CancelGoal.Response]
    status: MessageType[msg.GoalStatusArray]

    def encode_result(self, status: int, result: object | None) -> bytes:
        """Serialize a get_result response.

        Args:
            status: number of the final `GoalStatus`.
            result: result of the user; None is a default result.

        Raises:
            TypeError, EncodeError: the result does not fit its type.
        """
        message = self.result.cls() if result is None else self.result.to_message(result)
        try:
            return self.get_result.response.encode(self.cls.GetResult.Response(status=int(status), result=message))
        except EncodeError:
            message._encode()  # raises the error without the names of the enclosing fields
            raise


def action_type(source: object, *, arrays: bool = False) -> ActionType:
    """Return the `ActionType` of an action class or a type name.

    Args:
        source: class, or a name such as ``"example_interfaces/action/Fibonacci"``.
        arrays: decode sequences of fixed-size messages as structured arrays; not with a name.

    Raises:
        TypeError, TypeNotFoundError: as in `message_type`.
    """
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
        message_type(msg.GoalStatusArray),
    )


def _class_type(cls: type[Message]) -> ActionMessageType:
    def check(value: Any) -> Message:
        if value.__class__ is not cls and not is_of_type(value, cls):
            raise TypeError(f"expected a {cls.__name__} ({cls._TYPE.name}), got {type(value).__name__}: {value!r:.100}")
        return value  # type: ignore[no-any-return]

    return ActionMessageType(cls, check, lambda message: message)


def _dict_type(cls: type[Message]) -> ActionMessageType:
    from rosidl_py_gen import from_dict, to_dict

    return ActionMessageType(cls, lambda value: from_dict(cls, value), to_dict)


@dataclass(frozen=True, slots=True)
class ActionNames:
    """Fully qualified names of an action, its services and topics; each is expanded and remapped separately."""

    action: str
    send_goal: str
    cancel_goal: str
    get_result: str
    feedback: str
    status: str

    @classmethod
    def resolve(cls, names: NodeNames, action: str) -> ActionNames:
        """Expand and remap the names of an action, its services and topics.

        Raises:
            InvalidNameError: the name of the action is invalid.
        """
        return cls(
            names.resolve_topic(action),
            names.resolve_service(f"{action}/_action/send_goal"),
            names.resolve_service(f"{action}/_action/cancel_goal"),
            names.resolve_service(f"{action}/_action/get_result"),
            names.resolve_topic(f"{action}/_action/feedback"),
            names.resolve_topic(f"{action}/_action/status"),
        )


def set_goal_id(message: Any, goal_id: bytes) -> None:
    """Set the field `goal_id` of a message to an array of 16 bytes: messages with rclpy's API do not accept `bytes`."""
    message.goal_id.uuid = np.frombuffer(goal_id, np.uint8)


def goal_id_of(message: Any) -> bytes:
    """Return the 16 bytes of the field `goal_id` of a message."""
    return bytes(message.goal_id.uuid)


Policy = Literal["parallel", "reject", "preempt", "queue"]
"""Type of the setting `goal_policy` of an action server, for goals that arrive while another goal runs."""

_ID_BYTES = 16
_CANCEL_ALL_HINT = "all zeros select every goal; use cancel_all() for that"


class ActionArgumentError(RosidlError, ValueError):
    """Raised for an invalid value of an argument of an action client or server; the text names the argument."""


def require_depth(name: str, value: int) -> int:
    """Return an argument that must be an integer of at least 1.

    Raises:
        TypeError: the value is not an integer.
        ActionArgumentError: the value is less than 1.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} must be an int, got {value!r:.100}")
    if value < 1:
        raise ActionArgumentError(f"{name} must be 1 or more, got {value!r}")
    return int(value)


def require_goal_id(goal_id: bytes) -> bytes:
    """Return a goal id, which must be 16 bytes that are not all zero.

    Raises:
        TypeError: the value is not `bytes`.
        ActionArgumentError: the value has another length, or is all zero.
    """
    if not isinstance(goal_id, bytes | bytearray):
        raise TypeError(f"goal_id must be 16 bytes (the attribute bytes of a uuid.UUID), got {goal_id!r:.100}")
    if len(goal_id) != _ID_BYTES:
        raise ActionArgumentError(f"goal_id must be 16 bytes, got {len(goal_id)}: {goal_id.hex()[:64]}")
    if not any(goal_id):
        raise ActionArgumentError(f"goal_id must not be 16 zero bytes: {_CANCEL_ALL_HINT}")
    return bytes(goal_id)


def require_stamp(stamp: Any) -> Time:
    """Return a stamp, which may be a `Time` or a message, as a `Time`.

    Raises:
        TypeError: the value is neither a `Time` nor a ``builtin_interfaces/Time``.
        ActionArgumentError: the time is zero.
    """
    if not isinstance(stamp, Time):
        if not all(isinstance(getattr(stamp, name, None), Integral) for name in ("sec", "nanosec")):
            raise TypeError(f"stamp must be a Time or a builtin_interfaces/Time message, got {stamp!r:.100}")
        stamp = Time.from_msg(stamp)
    time: Time = stamp
    if time.nanoseconds == 0:
        raise ActionArgumentError(
            f"stamp must not be zero, which ROS time is before the first /clock: {_CANCEL_ALL_HINT}"
        )
    return time


def server_callbacks(
    scope: EntityScope,
    action: str,
    execute: Callable[[Any], Any] | None,
    goal_callback: Callable[[Any], Any] | None,
    cancel_callback: Callable[[Any], Any] | bool,
    goal_policy: object,
) -> tuple[UserCallback | None, UserCallback | bool]:
    """Check the callbacks and the policy of an action server, and return its goal callback and its cancel callback.

    Returns:
        goal callback, or None; cancel callback, or True to accept and False to refuse every cancel request.

    Raises:
        TypeError: a callback is not callable with its argument, or `goal_callback` is given without `execute`.
        ValueError: `goal_policy` is unknown.
    """
    if not (isinstance(cancel_callback, bool) or callable(cancel_callback)):
        raise TypeError(
            f"cancel_callback of action {action} must be True, False or a function, got {cancel_callback!r:.100}"
        )
    user_callback(scope, execute, f"execute of action {action}", "the goal")  # a check: `ExecuteFunction` calls it
    on_goal = user_callback(scope, goal_callback, f"goal_callback of action {action}", "the goal message")
    on_cancel: UserCallback | bool = cancel_callback is True
    if not isinstance(cancel_callback, bool):
        on_cancel = user_callback(scope, cancel_callback, f"cancel_callback of action {action}", "the goal") or False
    if goal_callback is not None and execute is None:
        raise TypeError(
            f"goal_callback of action {action} needs execute, else accepted goals are not executed; without execute, "
            "iterate over the server and answer each request: async for request in server"
        )
    if goal_policy not in get_args(Policy):
        raise ValueError(f"goal_policy must be one of {', '.join(get_args(Policy))}, got {goal_policy!r}")
    return on_goal, on_cancel


class ActionEntity(CompositeEntity):
    """Base of action clients and servers, which consist of three services and two topics."""

    def __init__(
        self, scope: EntityScope, action_type: ActionType, names: ActionNames, type_hash_check: TypeCheck | None
    ) -> None:
        super().__init__(scope, type_hash_check=type_hash_check)
        self._type = action_type
        self.name: str = names.action
        """Fully qualified name of the action."""
        self.action_type: str = action_type.ros_name
        """Name of the action's type: ``pkg/action/Name``."""
        self.action_class: type[Action[Any, Any, Any]] = action_type.cls
        """Generated class of the action's type, with `Goal`, `Result` and `Feedback`."""

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish the requests and responses of the action's services on ``<service>/_service_event`` from now on.

        ``ros2 action echo`` of Kilted and later shows them. Arguments and exceptions are the same as for a `Client` or
        a service.
        """
        self._require_open()
        for entity in list(self._parts.owned.values()):
            if isinstance(entity, ServiceEndpoint):
                entity.configure_introspection(clock, qos, state)
