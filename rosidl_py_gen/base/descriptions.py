"""Type descriptions and the RIHS01 hash (docs/internals/protocol.md 3), from any source that can name the fields of a
type.

The compiler calls this with its model, type support with the field tables of generated classes: one algorithm for both.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from typing import Any

from rosidl_py_gen.base.fieldtype import FieldType

# name, type, text of the default value ("" when there is none)
FieldRow = tuple[str, FieldType, str]
FieldLookup = Callable[[str], Iterable[FieldRow]]
Description = dict[str, Any]

EMPTY_MESSAGE: tuple[FieldRow, ...] = (("structure_needs_at_least_one_member", FieldType("uint8"), ""),)


def service_rows(name: str) -> tuple[FieldRow, ...]:
    """The three members of a service's description."""
    return tuple(
        (f"{part.lower()}_message", FieldType(f"{name}_{part}"), "") for part in ("Request", "Response", "Event")
    )


def action_rows(name: str) -> tuple[FieldRow, ...]:
    """The six members of an action's description."""
    parts = (
        ("goal", "Goal"),
        ("result", "Result"),
        ("feedback", "Feedback"),
        ("send_goal_service", "SendGoal"),
        ("get_result_service", "GetResult"),
        ("feedback_message", "FeedbackMessage"),
    )
    return tuple((field, FieldType(f"{name}_{suffix}"), "") for field, suffix in parts)


def default_text(value: object) -> str:
    """`default_value` of a description; `value` is None, a scalar or a tuple (docs/internals/protocol.md 3.4)."""
    if value is None:
        return ""
    return value if isinstance(value, str) else repr(value)


def individual_description(name: str, rows: Iterable[FieldRow]) -> Description:
    """The description of one type without the types it refers to."""
    fields = [
        {"name": field, "type": kind.description(), "default_value": default}
        for field, kind, default in (tuple(rows) or EMPTY_MESSAGE)
    ]
    return {"type_name": name, "fields": fields}


def build_type_description(name: str, lookup: FieldLookup) -> Description:
    """The full description of a type: itself and everything it refers to, sorted by name.

    Args:
        name: full name.
        lookup: gives the rows of any type named on the way.
    """
    seen: dict[str, Description] = {}
    pending = [name]
    while pending:
        current = pending.pop()
        if current in seen:
            continue
        rows = tuple(lookup(current))
        seen[current] = individual_description(current, rows)
        pending.extend(kind.base for _, kind, _ in rows if kind.is_message)
    top = seen.pop(name)
    return {"type_description": top, "referenced_type_descriptions": [seen[key] for key in sorted(seen)]}


def rihs01(description: Description) -> str:
    """The hash of a full description; default values do not take part."""
    return _hash(
        _hashed_text(description["type_description"]),
        [_hashed_text(one) for one in description["referenced_type_descriptions"]],
    )


def _hashed_text(one: Description) -> str:
    fields = [{"name": field["name"], "type": field["type"]} for field in one["fields"]]
    return json.dumps({"type_name": one["type_name"], "fields": fields}, ensure_ascii=True, separators=(", ", ": "))


def _hash(top: str, referenced: Iterable[str]) -> str:
    text = f'{{"type_description": {top}, "referenced_type_descriptions": [{", ".join(referenced)}]}}'
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


class TypeHasher:
    """RIHS01 of many types that refer to each other: each is looked up and written once.

    Args:
        lookup: as for `describe`.
    """

    def __init__(self, lookup: FieldLookup) -> None:
        self._lookup = lookup
        self._texts: dict[str, tuple[str, tuple[str, ...]]] = {}
        self._found: dict[str, str] = {}

    def of(self, name: str) -> str:
        """The hash of a type whose references all exist."""
        if name not in self._found:
            seen: dict[str, str] = {}
            pending = [name]
            while pending:
                current = pending.pop()
                if current not in seen:
                    seen[current], below = self._one(current)
                    pending += below
            top = seen.pop(name)
            self._found[name] = _hash(top, (seen[key] for key in sorted(seen)))
        return self._found[name]

    def _one(self, name: str) -> tuple[str, tuple[str, ...]]:
        """A type as it is hashed, and the types of its fields."""
        if name not in self._texts:
            rows = tuple(self._lookup(name))
            below = dict.fromkeys(kind.base for _, kind, _ in rows if kind.is_message)
            self._texts[name] = _hashed_text(individual_description(name, rows)), tuple(below)
        return self._texts[name]
