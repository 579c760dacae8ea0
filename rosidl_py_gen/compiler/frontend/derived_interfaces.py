"""The messages ROS derives from services and actions (docs/internals/protocol.md 1.6)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import (
    ActionDef,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    ServiceDef,
    SourceText,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

_UUID = "unique_identifier_msgs/msg/UUID"
_TIME = "builtin_interfaces/msg/Time"
_INFO = "service_msgs/msg/ServiceEventInfo"

# Packages every interface of a kind needs though no line names them.
IMPLIED = {
    "msg": (),
    "srv": ("service_msgs",),
    "action": ("unique_identifier_msgs", "builtin_interfaces", "action_msgs", "service_msgs"),
}


def derived_name(name: RosName, suffix: str) -> RosName:
    """``pkg/srv/X`` and ``Request`` -> ``pkg/srv/X_Request``."""
    return RosName(name.package, name.kind, f"{name.name}_{suffix}")


def service(name: RosName, request: MessageDef, response: MessageDef, source: SourceText) -> ServiceDef:
    """A service with its event message."""
    pair = [("request", str(request.name)), ("response", str(response.name))]
    event = _message(
        derived_name(name, "Event"),
        [
            ("info", FieldType(_INFO), "Who sent or received what, and when."),
            *(
                (word, FieldType(kind, Arity.BOUNDED, 1), f"The {word}; empty when contents are not recorded.")
                for word, kind in pair
            ),
        ],
        source,
        f"What service introspection publishes about {name}.",
    )
    return ServiceDef(name, request, response, event, source)


def action(name: RosName, goal: MessageDef, result: MessageDef, feedback: MessageDef, source: SourceText) -> ActionDef:
    """An action with its feedback message and its two services."""
    goal_id = ("goal_id", FieldType(_UUID), "The goal this belongs to.")
    send_goal = _service(
        derived_name(name, "SendGoal"),
        [goal_id, ("goal", FieldType(str(goal.name)), "What is to be done.")],
        [
            ("accepted", FieldType("bool"), "Whether the server takes the goal on."),
            ("stamp", FieldType(_TIME), "When it was accepted."),
        ],
        source,
    )
    get_result = _service(
        derived_name(name, "GetResult"),
        [goal_id],
        [
            ("status", FieldType("int8"), "A value of action_msgs/msg/GoalStatus."),
            ("result", FieldType(str(result.name)), "The outcome; default values unless the goal finished."),
        ],
        source,
    )
    feedback_message = _message(
        derived_name(name, "FeedbackMessage"),
        [goal_id, ("feedback", FieldType(str(feedback.name)), "How far it is.")],
        source,
        f"Feedback of {name} on the wire.",
    )
    return ActionDef(name, goal, result, feedback, feedback_message, send_goal, get_result, source)


def assemble(name: RosName, messages: list[MessageDef], source: SourceText) -> Interface:
    """One message, two of a service or three of an action as the interface they form."""
    match messages:
        case [message]:
            return message
        case [request, response]:
            return service(name, request, response, source)
        case [goal, result, feedback]:
            return action(name, goal, result, feedback, source)
        case _:
            raise AssertionError(len(messages))


def _service(
    name: RosName,
    request: Sequence[tuple[str, FieldType, str]],
    response: Sequence[tuple[str, FieldType, str]],
    source: SourceText,
) -> ServiceDef:
    return service(
        name,
        _message(derived_name(name, "Request"), request, source, f"Request of {name}."),
        _message(derived_name(name, "Response"), response, source, f"Response of {name}."),
        source,
    )


def _message(
    name: RosName, fields: Sequence[tuple[str, FieldType, str]], source: SourceText, comment: str
) -> MessageDef:
    at = Location(source, 1, 1)
    defs = tuple(FieldDef(field, kind, None, (text,), "", at) for field, kind, text in fields)
    return MessageDef(name, defs, (), (comment,), source)
