"""Checks that an object is the class of a message, service or action."""

from typing import Any, TypeVar

from rclpy._classes import Subscriptable
from rclpy.exceptions import NoTypeSupportImportedException

Msg = Any
MsgT = TypeVar("MsgT")
SrvRequestT = TypeVar("SrvRequestT")
SrvResponseT = TypeVar("SrvResponseT")
SrvT = TypeVar("SrvT")
GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")
ImplT = TypeVar("ImplT")
ActionT = TypeVar("ActionT")


class Srv(Subscriptable):
    """Class of a service, for annotations: ``type[Srv[RequestT, ResponseT]]``."""


class Action(Subscriptable):
    """Class of an action, for annotations: ``type[Action[GoalT, ResultT, FeedbackT, ImplT]]``."""


def check_for_type_support(msg_or_srv_type: Any) -> None:
    """Raise AttributeError unless the object is a class of a message, service or action."""
    try:
        type_support = msg_or_srv_type.__class__._TYPE_SUPPORT
    except AttributeError as error:
        text = (
            f"{error.args[0]} This might be a ROS 1 message type but it should be a ROS 2 message type."
            " Make sure to source your ROS 2 workspace after your ROS 1 workspace."
        )
        raise AttributeError(text, *error.args[1:]) from error
    if type_support is None:
        raise NoTypeSupportImportedException


def check_is_valid_msg_type(msg_type: Any) -> None:
    """Raise an exception unless the object is the class of a message.

    Raises:
        RuntimeError: the object is the class of a service or action.
        AttributeError: the object is something else.
    """
    check_for_type_support(msg_type)
    if not hasattr(msg_type, "_encode"):
        raise RuntimeError(f"The message type provided is not valid ({msg_type}), this might be a service or action")


def check_is_valid_srv_type(srv_type: Any) -> None:
    """Raise an exception unless the object is the class of a service.

    Raises:
        RuntimeError: the object is the class of a message or action.
        AttributeError: the object is something else.
    """
    check_for_type_support(srv_type)
    if not (hasattr(srv_type, "Request") and hasattr(srv_type, "Response")):
        raise RuntimeError(f"The service type provided is not valid ({srv_type}), this might be a message or action")


def message_class(msg_type: Any) -> Any:
    """Return the class of a message, given by the class or, as rclpy accepts before Kilted, by a message object."""
    return msg_type if isinstance(msg_type, type) else type(msg_type)
