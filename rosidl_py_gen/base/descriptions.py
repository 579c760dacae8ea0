"""Type descriptions and the RIHS01 hash (docs/internals/protocol.md 3).

The fields of a type come from the compiler's model or from the tables of generated classes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from rosidl_py_gen.base.fieldtype import FieldType

FieldRow = tuple[str, FieldType, str]
"""Field of a type for type descriptions: name, type, and text of the default value, which may be empty."""
FieldLookup = Callable[[str], Iterable[FieldRow]]
Description = dict[str, Any]
T = TypeVar("T")


def _nested_types(individual: Description) -> Iterable[str]:
    return (nested for field in individual["fields"] if (nested := field["type"]["nested_type_name"]))


def _closure(name: str, get: Callable[[str], T], below: Callable[[T], Iterable[str]]) -> dict[str, T]:
    """Return the values of a type and of all types to which it refers, by name: first the type, then the others in name
    order.

    `get` returns the value of a type, `below` the names of the types that a value refers to.
    """
    found: dict[str, T] = {}
    pending = [name]
    while pending:
        current = pending.pop()
        if current not in found:
            found[current] = get(current)
            pending += below(found[current])
    return {name: found.pop(name), **{key: found[key] for key in sorted(found)}}


def _hashed_text(description: Description) -> str:
    fields = [{"name": field["name"], "type": field["type"]} for field in description["fields"]]
    return json.dumps({"type_name": description["type_name"], "fields": fields}, separators=(", ", ": "))


def _hash(top: str, referenced: Iterable[str]) -> str:
    text = f'{{"type_description": {top}, "referenced_type_descriptions": [{", ".join(referenced)}]}}'
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


class TypeDescriptions:
    """Type descriptions and RIHS01 hashes of types that refer to each other, made from the fields of each type.

    The function that looks up fields must know all types that a type contains, or raise an exception. The hashed text
    of each type is made only once.
    """

    EMPTY_MESSAGE = ("structure_needs_at_least_one_member", FieldType("uint8"))
    """Name and type of the field that messages without fields have in type descriptions."""

    def __init__(self, lookup: FieldLookup) -> None:
        self._lookup = lookup
        self._texts: dict[str, tuple[str, tuple[str, ...]]] = {}
        self._hashes: dict[str, str] = {}

    @classmethod
    def of_fields(cls, name: str, rows: Iterable[FieldRow]) -> Description:
        """Return the type description of one type from its fields, without the types that it refers to."""
        fields = [
            {"name": field, "type": kind.description(), "default_value": default}
            for field, kind, default in (tuple(rows) or [(*cls.EMPTY_MESSAGE, "")])
        ]
        return {"type_name": name, "fields": fields}

    @staticmethod
    def by_name(description: Description) -> dict[str, Description]:
        """Return the descriptions of all types in a type description by name, the described type first."""
        every = [description["type_description"], *description["referenced_type_descriptions"]]
        return {one["type_name"]: one for one in every}

    @staticmethod
    def rihs01(description: Description) -> str:
        """Return the RIHS01 hash of a type description, which must include all types to which the type refers.

        Defaults do not count.
        """
        referenced = map(_hashed_text, description["referenced_type_descriptions"])
        return _hash(_hashed_text(description["type_description"]), referenced)

    @staticmethod
    def service_rows(name: str) -> tuple[FieldRow, ...]:
        """Return the fields in the type description of a service: its request, response and event."""
        return tuple(
            (f"{part.lower()}_message", FieldType(f"{name}_{part}"), "") for part in ("Request", "Response", "Event")
        )

    @staticmethod
    def action_rows(name: str) -> tuple[FieldRow, ...]:
        """Return the fields in the type description of an action: its messages and services."""
        fields = ("goal", "result", "feedback", "send_goal_service", "get_result_service", "feedback_message")
        suffixes = ("Goal", "Result", "Feedback", "SendGoal", "GetResult", "FeedbackMessage")
        return tuple((field, FieldType(f"{name}_{part}"), "") for field, part in zip(fields, suffixes, strict=True))

    def of(self, name: str) -> Description:
        """Return the type description of a type and of all types to which it refers."""
        return self.assemble(name, lambda part: self.of_fields(part, self._lookup(part)))

    @staticmethod
    def assemble(name: str, individual: Callable[[str], Description]) -> Description:
        """Return the type description of a type and of all types to which it refers, made from descriptions of single
        types.
        """
        top, *referenced = _closure(name, individual, _nested_types).values()
        return {"type_description": top, "referenced_type_descriptions": referenced}

    def hash_of(self, name: str) -> str:
        """Return the RIHS01 hash of a type."""
        if name not in self._hashes:
            (top, _), *others = _closure(name, self._text, lambda found: found[1]).values()
            self._hashes[name] = _hash(top, (text for text, _ in others))
        return self._hashes[name]

    def _text(self, name: str) -> tuple[str, tuple[str, ...]]:
        if name not in self._texts:
            rows = tuple(self._lookup(name))
            below = dict.fromkeys(kind.base for _, kind, _ in rows if kind.is_message)
            self._texts[name] = _hashed_text(self.of_fields(name, rows)), tuple(below)
        return self._texts[name]
