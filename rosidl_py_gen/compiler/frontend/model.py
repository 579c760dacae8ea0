"""What an interface file says, as plain values.

`parse` and `idl` build these, `derive` adds the messages ROS derives from services and actions, `resolve` checks the
references. Types inside fields already carry full names (``pkg/msg/Name``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import Diagnostic

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.base.names import RosName

MAX_PROBLEMS = 100
"""Of one file; what may have been meant instead costs more to find out than it does to read the line."""

Scalar = bool | int | float | str
Default = Scalar | tuple[Scalar, ...]


class SourceText(NamedTuple):
    """The text a definition came from.

    Attributes:
        path: as shown to the user; a name in angle brackets when it came from no file.
        text: the whole file, as it was read.
        format: the suffix: msg, srv, action or idl; ``implicit`` for derived types.
    """

    path: str
    text: str
    format: str


class Location(NamedTuple):
    """A place in a source; line and column are 1-based."""

    source: SourceText
    line: int
    column: int

    def problem(self, text: str) -> Diagnostic:
        """A finding here, with the source line for the caret."""
        lines = self.source.text.splitlines()
        line = lines[self.line - 1].replace("\t", " ") if 0 < self.line <= len(lines) else ""
        return Diagnostic(self.source.path, self.line, self.column, text, line)


class FieldDef(NamedTuple):
    """One field. `default` is None when there is none, a tuple for arrays; `unit` is the text in brackets."""

    name: str
    type: FieldType
    default: Default | None
    comment: tuple[str, ...]
    unit: str
    location: Location


class ConstantDef(NamedTuple):
    """One constant; `type` is a primitive or an unbounded string."""

    name: str
    type: FieldType
    value: Scalar
    comment: tuple[str, ...]
    unit: str
    location: Location


class MessageDef(NamedTuple):
    """A message: from a .msg file, a section of another file, or derived. No fields means an empty message."""

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
    def messages(self) -> tuple[MessageDef, ...]:
        return (self.request, self.response, self.event)


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
    def messages(self) -> tuple[MessageDef, ...]:
        return (
            self.goal,
            self.result,
            self.feedback,
            self.feedback_message,
            *self.send_goal.messages,
            *self.get_result.messages,
        )


Interface = MessageDef | ServiceDef | ActionDef


def messages_of(interface: Interface) -> tuple[MessageDef, ...]:
    """Every message class an interface becomes, dependencies first."""
    return (interface,) if isinstance(interface, MessageDef) else interface.messages


@dataclass(slots=True)
class Diagnostics:
    """Collects problems over many files, so that one run shows them all."""

    problems: list[Diagnostic] = field(default_factory=list)
    _counts: dict[str, int] = field(default_factory=dict)

    def add(self, location: Location, text: str) -> None:
        """Note a problem; of one file the first ones."""
        path = location.source.path
        count = self._counts[path] = self._counts.get(path, 0) + 1
        if count <= MAX_PROBLEMS:
            self.problems.append(location.problem(text))
        elif count == MAX_PROBLEMS + 1:
            self.problems.append(location.problem(f"there are more problems; the first {MAX_PROBLEMS} are shown"))

    def is_full(self, location: Location) -> bool:
        """Whether so much is wrong in the location's file that further problems are not shown."""
        return self._counts.get(location.source.path, 0) > MAX_PROBLEMS
