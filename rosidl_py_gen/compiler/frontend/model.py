"""Definitions of interfaces as plain values, and diagnostics about them.

`interface_parser` builds these values, `registry` checks the references. Types of fields have full names
(``pkg/msg/Name``). The messages that ROS derives from services and actions are included
(docs/internals/protocol.md 1.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.errors import Diagnostic

MAX_PROBLEMS = 100
"""Maximum diagnostics that are collected for one file, because computing a suggestion takes longer than reading the
line."""
SECTIONS: dict[str, tuple[str, ...]] = {
    "msg": ("",),
    "srv": ("Request", "Response"),
    "action": ("Goal", "Result", "Feedback"),
}
"""Name suffixes of the messages that an interface file defines, by kind (msg, srv, action)."""
Scalar = bool | int | float | str
Default = Scalar | tuple[Scalar, ...]
_DERIVED_SUFFIXES = ("_Request", "_Response", "_Goal", "_Result", "_Feedback")
_UUID = "unique_identifier_msgs/msg/UUID"
_TIME = "builtin_interfaces/msg/Time"
_INFO = "service_msgs/msg/ServiceEventInfo"
IMPLIED = {
    "msg": (),
    "srv": ("service_msgs",),
    "action": ("unique_identifier_msgs", "builtin_interfaces", "action_msgs", "service_msgs"),
}
"""Packages on which every interface of a kind (msg, srv, action) depends, although its file does not name them."""
DERIVED_TYPES_PACKAGES = ("service_msgs", "unique_identifier_msgs", "builtin_interfaces")
"""Packages with the types to which derived messages refer, such as service events; type descriptions may lack these
types."""
_Fields = Sequence[tuple[str, FieldType, str]]
"""Name, type and comment of each field of a message that is derived from a service or action."""


class SyntaxProblem(Exception):
    """Error for text of a definition that breaks a rule of its language; `line` and `column` are 1-based."""

    def __init__(self, line: int, column: int, text: str) -> None:
        self.line = line
        self.column = column
        self.text = text
        super().__init__(text)


class Token(NamedTuple):
    """Lexical token of a definition file, with its 1-based position."""

    text: str
    line: int
    column: int

    def problem(self, text: str) -> SyntaxProblem:
        """Return a `SyntaxProblem` with the given error text at the position of this token."""
        return SyntaxProblem(self.line, self.column, text)


class SourceText(NamedTuple):
    """Text of a definition with its path for display; the format is msg, srv, action, idl, or ``implicit``.

    Type descriptions without a source have the format ``implicit`` and an empty text.
    """

    path: str
    text: str
    format: str


class Location(NamedTuple):
    """Position in the text of a definition; line and column are 1-based."""

    source: SourceText
    line: int
    column: int

    def diagnostic(self, text: str) -> Diagnostic:
        """Return a diagnostic with the given text at this location.

        It includes the source line, for display with a caret.
        """
        lines = self.source.text.splitlines()
        line = lines[self.line - 1].replace("\t", " ") if 0 < self.line <= len(lines) else ""
        return Diagnostic(self.source.path, self.line, self.column, text, line)


class FieldDef(NamedTuple):
    """Definition of a message field; `default` is a tuple for arrays, `unit` is the text in brackets in the comment."""

    name: str
    type: FieldType
    default: Default | None
    comment: tuple[str, ...]
    unit: str
    location: Location

    @property
    def default_text(self) -> str:
        """Default value as text for a type description; "" without a default (docs/internals/protocol.md 3.4)."""
        return "" if self.default is None else _value_text(self.default)


class ConstantDef(NamedTuple):
    """Definition of a constant, whose type is a primitive or an unbounded string."""

    name: str
    type: FieldType
    value: Scalar
    comment: tuple[str, ...]
    unit: str
    location: Location

    @property
    def value_text(self) -> str:
        return _value_text(self.value)


class MessageDef(NamedTuple):
    """Definition of a message from a .msg file, from a section of a .srv or .action file, or derived from a service or
    action.
    """

    name: RosName
    fields: tuple[FieldDef, ...]
    constants: tuple[ConstantDef, ...]
    comment: tuple[str, ...]
    source: SourceText

    @property
    def sections(self) -> tuple[MessageDef, ...]:
        """The messages that the file of the interface defines, without the messages that ROS derives from them."""
        return (self,)

    @property
    def messages(self) -> tuple[MessageDef, ...]:
        """All messages of the interface, with derived messages after the messages that they refer to."""
        return (self,)


class ServiceDef(NamedTuple):
    """Definition of a service; its event message is derived from the sections (docs/internals/protocol.md 1.6)."""

    name: RosName
    request: MessageDef
    response: MessageDef
    event: MessageDef
    source: SourceText

    @property
    def sections(self) -> tuple[MessageDef, ...]:
        return self.request, self.response

    @property
    def messages(self) -> tuple[MessageDef, ...]:
        return *self.sections, self.event


class ActionDef(NamedTuple):
    """Definition of an action; its feedback message and two services are derived (docs/internals/protocol.md 1.6)."""

    name: RosName
    goal: MessageDef
    result: MessageDef
    feedback: MessageDef
    feedback_message: MessageDef
    send_goal: ServiceDef
    get_result: ServiceDef
    source: SourceText

    @property
    def sections(self) -> tuple[MessageDef, ...]:
        return self.goal, self.result, self.feedback

    @property
    def messages(self) -> tuple[MessageDef, ...]:
        return *self.sections, self.feedback_message, *self.send_goal.messages, *self.get_result.messages


Interface = MessageDef | ServiceDef | ActionDef


def nested_types(interface: Interface) -> set[str]:
    """Return the full names of the message types in an interface's fields, except for the interface's own messages."""
    own = {str(message.name) for message in interface.messages}
    fields = (item for message in interface.messages for item in message.fields)
    return {item.type.base for item in fields if item.type.is_message} - own


@dataclass(slots=True)
class Diagnostics:
    """Collected diagnostics of many files, so that one run reports all of them."""

    items: list[Diagnostic] = field(default_factory=list)
    _counts: dict[str, int] = field(default_factory=dict)

    def add(self, location: Location, text: str) -> None:
        """Add a diagnostic at a location.

        If its file has `MAX_PROBLEMS` diagnostics already, the diagnostic is dropped.
        """
        path = location.source.path
        count = self._counts[path] = self._counts.get(path, 0) + 1
        if count <= MAX_PROBLEMS:
            self.items.append(location.diagnostic(text))
        elif count == MAX_PROBLEMS + 1:
            self.items.append(location.diagnostic(f"there are more problems; the first {MAX_PROBLEMS} are shown"))

    def is_full(self, location: Location) -> bool:
        """Return True if the location's file has so many diagnostics that further ones are dropped."""
        return self._counts.get(location.source.path, 0) > MAX_PROBLEMS


def _value_text(value: Default) -> str:
    return value if isinstance(value, str) else repr(value)


def is_interface_name(text: str) -> bool:
    """Return True for a valid file stem of an interface; a prefix ``Sample_`` and one derived suffix are allowed."""
    text = text.removeprefix("Sample_")
    for suffix in _DERIVED_SUFFIXES:
        text = text.removesuffix(suffix)
    return RosName.NAME_RULE.allows(text)


def derived_name(name: RosName, suffix: str) -> RosName:
    """Return the name of a message of a service or action: ``pkg/srv/X`` and ``Request`` -> ``pkg/srv/X_Request``."""
    return RosName(name.package, name.kind, f"{name.name}_{suffix}")


def section_names(name: RosName, kind: str) -> list[RosName]:
    """Return the full names of the messages that the file of an interface defines; its kind is msg, srv or action."""
    return [derived_name(name, suffix) if suffix else name for suffix in SECTIONS[kind]]


def service(name: RosName, request: MessageDef, response: MessageDef, source: SourceText) -> ServiceDef:
    """Return the definition of a service made of its request and response, with the derived event message."""
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
    """Return the definition of an action made of its goal, result and feedback, with the derived feedback message and
    services.
    """
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
    """Return the interface that consists of the given messages: one is a message, two are a service, three
    an action.
    """
    match messages:
        case [message]:
            return message
        case [request, response]:
            return service(name, request, response, source)
        case [goal, result, feedback]:
            return action(name, goal, result, feedback, source)
        case _:
            raise AssertionError(len(messages))


def _service(name: RosName, request: _Fields, response: _Fields, source: SourceText) -> ServiceDef:
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
