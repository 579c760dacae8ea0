"""Type descriptions and the RIHS01 hash (docs/internals/protocol.md 3).

The fields of a type come from the compiler's model or from the tables of generated classes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from typing import Any

from rosidl_py_gen.base.fieldtype import FieldType

FieldRow = tuple[str, FieldType, str]
"""Name, type and text of the default value, which may be empty."""
FieldLookup = Callable[[str], Iterable[FieldRow]]
Description = dict[str, Any]

EMPTY_MESSAGE: tuple[FieldRow, ...] = (("structure_needs_at_least_one_member", FieldType("uint8"), ""),)


def service_rows(name: str) -> tuple[FieldRow, ...]:
    """Return the fields of a service's description."""
    return tuple(
        (f"{part.lower()}_message", FieldType(f"{name}_{part}"), "") for part in ("Request", "Response", "Event")
    )


def action_rows(name: str) -> tuple[FieldRow, ...]:
    """Return the fields of an action's description."""
    suffixes = {
        "goal": "Goal",
        "result": "Result",
        "feedback": "Feedback",
        "send_goal_service": "SendGoal",
        "get_result_service": "GetResult",
        "feedback_message": "FeedbackMessage",
    }
    return tuple((field, FieldType(f"{name}_{suffix}"), "") for field, suffix in suffixes.items())


def default_text(value: object) -> str:
    """Return the text of a default value in a description (docs/internals/protocol.md 3.4).

    Args:
        value: a scalar, a tuple, or None for no default value.
    """
    if value is None:
        return ""
    return value if isinstance(value, str) else repr(value)


def individual_description(name: str, rows: Iterable[FieldRow]) -> Description:
    """Return the description of one type without the types that it refers to."""
    fields = [
        {"name": field, "type": kind.description(), "default_value": default}
        for field, kind, default in (tuple(rows) or EMPTY_MESSAGE)
    ]
    return {"type_name": name, "fields": fields}


def build_type_description(name: str, lookup: FieldLookup) -> Description:
    """Return the full description of a type with the types that it refers to, sorted by name.

    Args:
        name: full name.
        lookup: returns the fields of a type.
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
    """Return the hash of a full description; default values have no influence."""
    referenced = map(_hashed_text, description["referenced_type_descriptions"])
    return _hash(_hashed_text(description["type_description"]), referenced)


def individual_descriptions(description: Description) -> dict[str, Description]:
    """Return the descriptions of the single types in a full description by name, the main type first."""
    every = [description["type_description"], *description["referenced_type_descriptions"]]
    return {one["type_name"]: one for one in every}


def _hashed_text(description: Description) -> str:
    fields = [{"name": field["name"], "type": field["type"]} for field in description["fields"]]
    return json.dumps({"type_name": description["type_name"], "fields": fields}, separators=(", ", ": "))


def _hash(top: str, referenced: Iterable[str]) -> str:
    text = f'{{"type_description": {top}, "referenced_type_descriptions": [{", ".join(referenced)}]}}'
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


class TypeHasher:
    """RIHS01 hashes of types that refer to each other; the text of each type is made once.

    Args:
        lookup: returns the fields of a type.
    """

    def __init__(self, lookup: FieldLookup) -> None:
        self._lookup = lookup
        self._texts: dict[str, tuple[str, tuple[str, ...]]] = {}
        self._hashes: dict[str, str] = {}

    def of(self, name: str) -> str:
        """Return the hash of a type whose references all exist."""
        if name not in self._hashes:
            seen: dict[str, str] = {}
            pending = [name]
            while pending:
                current = pending.pop()
                if current not in seen:
                    seen[current], below = self._text(current)
                    pending += below
            top = seen.pop(name)
            self._hashes[name] = _hash(top, (seen[key] for key in sorted(seen)))
        return self._hashes[name]

    def _text(self, name: str) -> tuple[str, tuple[str, ...]]:
        if name not in self._texts:
            rows = tuple(self._lookup(name))
            below = dict.fromkeys(kind.base for _, kind, _ in rows if kind.is_message)
            self._texts[name] = _hashed_text(individual_description(name, rows)), tuple(below)
        return self._texts[name]
