"""The messages that ROS derives from services and actions (docs/internals/protocol.md 1.6)."""

from __future__ import annotations

from collections.abc import Sequence

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import (
    SECTIONS,
    ActionDef,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    ServiceDef,
    SourceText,
)

_UUID = "unique_identifier_msgs/msg/UUID"
_TIME = "builtin_interfaces/msg/Time"
_INFO = "service_msgs/msg/ServiceEventInfo"

IMPLIED = {
    "msg": (),
    "srv": ("service_msgs",),
    "action": ("unique_identifier_msgs", "builtin_interfaces", "action_msgs", "service_msgs"),
}
"""Packages that every interface of a kind depends on, though its file does not name them."""
_Fields = Sequence[tuple[str, FieldType, str]]
"""Name, type and comment of fields."""


def derived_name(name: RosName, suffix: str) -> RosName:
    """Return the name of a derived message: ``pkg/srv/X`` and ``Request`` -> ``pkg/srv/X_Request``."""
    return RosName(name.package, name.kind, f"{name.name}_{suffix}")


def section_names(name: RosName, kind: str) -> list[RosName]:
    """Return the names of the messages that the file of an interface defines."""
    return [derived_name(name, suffix) if suffix else name for suffix in SECTIONS[kind]]


def service(name: RosName, request: MessageDef, response: MessageDef, source: SourceText) -> ServiceDef:
    """Return a service with its event message."""
    pair = [("request", str(request.name)), ("response", str(response.name))]
    event = _message(
        derived_name(name, "Event"),
        [
            ("info", FieldType(_INFO), "Type, time, client and number of the call."),
            *(
                (word, FieldType(kind, Arity.BOUNDED, 1), f"The {word}; empty if contents are not published.")
                for word, kind in pair
            ),
        ],
        source,
        f"Event of service introspection for {name}.",
    )
    return ServiceDef(name, request, response, event, source)


def action(name: RosName, goal: MessageDef, result: MessageDef, feedback: MessageDef, source: SourceText) -> ActionDef:
    """Return an action with its feedback message and its two services."""
    goal_id = ("goal_id", FieldType(_UUID), "ID of the goal.")
    send_goal = _service(
        derived_name(name, "SendGoal"),
        [goal_id, ("goal", FieldType(str(goal.name)), "The goal.")],
        [
            ("accepted", FieldType("bool"), "True if the server accepts the goal."),
            ("stamp", FieldType(_TIME), "Time of the acceptance."),
        ],
        source,
    )
    get_result = _service(
        derived_name(name, "GetResult"),
        [goal_id],
        [
            ("status", FieldType("int8"), "A value of action_msgs/msg/GoalStatus."),
            ("result", FieldType(str(result.name)), "The result; default values unless the goal has finished."),
        ],
        source,
    )
    feedback_message = _message(
        derived_name(name, "FeedbackMessage"),
        [goal_id, ("feedback", FieldType(str(feedback.name)), "The feedback.")],
        source,
        f"Feedback message of {name}.",
    )
    return ActionDef(name, goal, result, feedback, feedback_message, send_goal, get_result, source)


def assemble(name: RosName, messages: list[MessageDef], source: SourceText) -> Interface:
    """Return the interface of one message, two sections of a service, or three of an action."""
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
    request: _Fields,
    response: _Fields,
    source: SourceText,
) -> ServiceDef:
    return service(
        name,
        _message(derived_name(name, "Request"), request, source, f"Request of {name}."),
        _message(derived_name(name, "Response"), response, source, f"Response of {name}."),
        source,
    )


def _message(name: RosName, fields: _Fields, source: SourceText, comment: str) -> MessageDef:
    at = Location(source, 1, 1)
    defs = tuple(FieldDef(field, kind, None, (text,), "", at) for field, kind, text in fields)
    return MessageDef(name, defs, (), (comment,), source)
