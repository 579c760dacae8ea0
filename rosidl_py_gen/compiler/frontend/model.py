"""Contents of interface files as plain values, and diagnostics about them.

`interface_parser` builds these values, `derived_interfaces` adds the messages that ROS derives from services and
actions, `registry` checks the references. Types of fields have full names (``pkg/msg/Name``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import Diagnostic

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.base.names import RosName

MAX_PROBLEMS = 100
"""Maximum diagnostics of a file: a suggestion costs more time than reading the line."""
SECTIONS: dict[str, tuple[str, ...]] = {
    "msg": ("",),
    "srv": ("Request", "Response"),
    "action": ("Goal", "Result", "Feedback"),
}
"""Suffixes of the messages that an interface file defines, by kind."""

Scalar = bool | int | float | str
Default = Scalar | tuple[Scalar, ...]


class SourceText(NamedTuple):
    """The text of a definition.

    Attributes:
        path: for display; a name in angle brackets for text that is not from a file.
        text: the whole file.
        format: msg, srv, action or idl; ``implicit`` for a type description without text.
    """

    path: str
    text: str
    format: str


class Location(NamedTuple):
    """A position in a source; line and column are 1-based."""

    source: SourceText
    line: int
    column: int

    def diagnostic(self, text: str) -> Diagnostic:
        """Return a diagnostic for the location, with the source line for the caret."""
        lines = self.source.text.splitlines()
        line = lines[self.line - 1].replace("\t", " ") if 0 < self.line <= len(lines) else ""
        return Diagnostic(self.source.path, self.line, self.column, text, line)


class FieldDef(NamedTuple):
    """A field; `default` is a tuple for arrays, `unit` the text in brackets of the comment."""

    name: str
    type: FieldType
    default: Default | None
    comment: tuple[str, ...]
    unit: str
    location: Location


class ConstantDef(NamedTuple):
    """A constant; `type` is a primitive or an unbounded string."""

    name: str
    type: FieldType
    value: Scalar
    comment: tuple[str, ...]
    unit: str
    location: Location


class MessageDef(NamedTuple):
    """A message: from a .msg file, a section of another file, or derived."""

    name: RosName
    fields: tuple[FieldDef, ...]
    constants: tuple[ConstantDef, ...]
    comment: tuple[str, ...]
    source: SourceText


class ServiceDef(NamedTuple):
    """A service; the event message is derived (docs/internals/protocol.md 1.6)."""

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
    """An action; feedback message and the two services are derived (docs/internals/protocol.md 1.6)."""

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


def messages_of(interface: Interface) -> tuple[MessageDef, ...]:
    """Return the messages of an interface, dependencies first."""
    return (interface,) if isinstance(interface, MessageDef) else interface.messages


def sections_of(interface: Interface) -> tuple[MessageDef, ...]:
    """Return the messages that the file of an interface defines, without derived ones."""
    return (interface,) if isinstance(interface, MessageDef) else interface.sections


def nested_types(interface: Interface) -> set[str]:
    """Return the full names of the types of an interface's fields, without its own messages."""
    own = {str(message.name) for message in messages_of(interface)}
    fields = (item for message in messages_of(interface) for item in message.fields)
    return {item.type.base for item in fields if item.type.is_message} - own


@dataclass(slots=True)
class Diagnostics:
    """Collected diagnostics of many files, so that one run reports all of them."""

    items: list[Diagnostic] = field(default_factory=list)
    _counts: dict[str, int] = field(default_factory=dict)

    def add(self, location: Location, text: str) -> None:
        """Add a diagnostic, unless the file has too many."""
        path = location.source.path
        count = self._counts[path] = self._counts.get(path, 0) + 1
        if count <= MAX_PROBLEMS:
            self.items.append(location.diagnostic(text))
        elif count == MAX_PROBLEMS + 1:
            self.items.append(location.diagnostic(f"there are more problems; the first {MAX_PROBLEMS} are shown"))

    def is_full(self, location: Location) -> bool:
        """Return True if further diagnostics of the location's file are not reported."""
        return self._counts.get(location.source.path, 0) > MAX_PROBLEMS
