"""Conversion of the type descriptions that nodes send to interfaces.

A description contains what the RIHS01 hash covers: names, types and the order of fields. Constants and comments are
only in the source that may be sent with it. The source is used if it has the same fields; the hash does not cover the
rest of the source. Both are untrusted: a description that no definition can have is refused, and the size is limited.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache

from rosidl_py_gen.base.descriptions import Description, TypeDescriptions
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.compiler.frontend.interface_parser import parse_interface
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem, parse_scalar, python_value
from rosidl_py_gen.compiler.frontend.model import (
    DERIVED_TYPES_PACKAGES,
    Default,
    Diagnostics,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    Scalar,
    SourceText,
    assemble,
    section_names,
)
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.errors import DefinitionError, Diagnostic, InvalidNameError

MAX_TYPES = 500
MAX_FIELDS = 5000
"""Maximum number of fields of all types of a received type description together."""
MAX_OF_ONE = 1000
"""Maximum number of fields of one type in a received type description. CPython takes 0.2 s to create its class, and far
more than twice the time for twice the fields."""
MAX_TEXT = 1 << 18
"""Maximum characters of all sources of a received type description together, and of all its default values together. If
there are more, the sources, or the further default values, are ignored."""

Sources = Mapping[str, tuple[str, str]]
"""Dictionary from type name to the encoding (``msg``, ``srv``, ``action``, ``idl``, ``implicit``) and text of its
source."""

_FIELD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z", re.ASCII)


class DescribedInterface:
    """Interface that type descriptions describe.

    Attributes:
        messages: names of the messages that the interface's file states, without the messages that ROS derives from
            them.
    """

    def __init__(
        self, name: RosName, individuals: Mapping[str, Description], sources: Sources, is_service: bool = False
    ) -> None:
        """Store the descriptions.

        Args:
            name: name of the interface.
            individuals: descriptions of single types by name; descriptions of unneeded types are ignored.
            sources: definition texts of the types.
            is_service: `name` is a service.
        """
        self._name, self._individuals, self._sources = name, individuals, sources
        is_action = name.kind == "action" and "_" not in name.name
        kind = "srv" if is_service else "action" if is_action else "msg"
        self.messages = tuple(map(str, section_names(name, kind)))

    def registry(self) -> InterfaceRegistry:
        """Return a checked registry with the interface and all types that it refers to.

        Raises:
            DefinitionError: no definition can have this description, or it is too large.
        """
        name, individuals = self._name, self._individuals
        _check_size(name, individuals)
        registry = InterfaceRegistry(_implied_packages())
        descriptions = _DescriptionConverter(individuals)
        texts = self._sources if sum(len(text) for _, text in self._sources.values()) <= MAX_TEXT else {}
        top = _from_source(name, texts, individuals, self.messages)
        if top is None:
            messages = [descriptions.message(one) for one in self.messages]
            top = assemble(name, messages, messages[0].source)
        registry.add(name, top)
        for needed in _reachable(top.messages, individuals):
            nested = RosName.parse(needed)
            registry.add(nested, _from_source(nested, texts, individuals, (needed,)) or descriptions.message(needed))
        check(registry, [name])
        registry.raise_diagnostics()
        return registry


def _check_size(name: RosName, individuals: Mapping[str, Description]) -> None:
    counts = [len(one["fields"]) for one in individuals.values()]
    if len(counts) > MAX_TYPES or sum(counts) > MAX_FIELDS or max(counts, default=0) > MAX_OF_ONE:
        raise _problem(
            str(name),
            f"expected a description of at most {MAX_TYPES} types with {MAX_OF_ONE} fields each and {MAX_FIELDS} "
            f"together, found {len(counts)} types with up to {max(counts)} fields and {sum(counts)} together",
        )


@cache
def _implied_packages() -> SearchPath:
    found = SearchPath.scan((), ament="")
    return SearchPath({name: found.packages[name] for name in DERIVED_TYPES_PACKAGES}, [], ["the description"])


def _reachable(start: Iterable[MessageDef], individuals: Mapping[str, Description]) -> Iterator[str]:
    """Yield the names of the described types that messages refer to, at any depth; `start` itself is not included."""
    own = {str(one.name) for one in start}
    seen = set(own)
    pending = [item.type.base for message in start for item in message.fields if item.type.is_message]
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        if name in individuals:
            yield name
            nested = (item["type"]["nested_type_name"] for item in individuals[name]["fields"])
            pending += [one for one in nested if one]


def _problem(name: str, text: str) -> DefinitionError:
    return DefinitionError(Diagnostic(f"<{name[:300]}>", 0, 0, text))


# --- from the source ------------------------------------------------------------------------------------------------


def _from_source(
    name: RosName, sources: Sources, individuals: Mapping[str, Description], own: tuple[str, ...]
) -> Interface | None:
    """Return the interface that a type's source defines; None if its fields differ from the description's."""
    encoding, text = sources.get(str(name), ("", ""))
    if encoding not in (name.kind, "idl") or not text or _elements(encoding, text) > 2 * MAX_OF_ONE:
        return None
    source = SourceText(f"<{name}>", text.replace("\r\n", "\n").replace("\r", "\n"), encoding)
    try:
        found = parse_interface(name, source, _RaiseOnFirst())
    except DefinitionError:
        return None
    known = {str(message.name): message for message in found.messages} if found else {}
    is_same = all(one in known and _fields_of(individuals.get(one)) == _rows(known[one]) for one in own)
    return found if is_same else None


def _elements(encoding: str, text: str) -> int:
    if encoding == "idl":
        return text.count(";")
    return sum(line[:1] not in ("", "#") for line in map(str.lstrip, text.splitlines()))


class _RaiseOnFirst(Diagnostics):
    """Collection of diagnostics that raises the first one as `DefinitionError`.

    Collecting many diagnostics would take quadratic time, as each contains its source line.
    """

    def add(self, location: Location, text: str) -> None:
        raise DefinitionError(location.diagnostic(text))


def _rows(message: MessageDef) -> list[tuple[object, object]]:
    rows = [(item.name, item.type) for item in message.fields] or [TypeDescriptions.EMPTY_MESSAGE]
    return [(name, kind.description()) for name, kind in rows]


def _fields_of(one: Description | None) -> list[tuple[object, object]]:
    return [] if one is None else [(item["name"], item["type"]) for item in one["fields"]]


# --- from the description -------------------------------------------------------------------------------------------


class _DescriptionConverter:
    """Converter of type descriptions to messages, with a limit for the text of all their default values together."""

    def __init__(self, individuals: Mapping[str, Description]) -> None:
        self._individuals = individuals
        self._left = MAX_TEXT

    def message(self, name: str) -> MessageDef:
        one = self._individuals.get(name)
        if one is None:
            raise _problem(name, "the type is not described")
        source = SourceText(f"<{name}>", "", "implicit")
        fields = tuple(self._field(name, item, Location(source, 1, 1)) for item in one["fields"])
        if not fields:
            raise _problem(name, "expected at least one field, found none")
        if len({py_name(item.name) for item in fields}) < len(fields):
            raise _problem(name, "two fields have the same name")
        if [(item.name, item.type) for item in fields] == [TypeDescriptions.EMPTY_MESSAGE]:
            fields = ()
        return MessageDef(RosName.parse(name), fields, (), (), source)

    def _field(self, name: str, item: Description, at: Location) -> FieldDef:
        field = item["name"]
        if not _FIELD_NAME.match(field):
            raise _problem(name, f"{field[:100]!r} is not a field name")
        kind = _type(f"{name}.{field}", item["type"])
        return FieldDef(field, kind, self._default(f"{name}.{field}", kind, item["default_value"]), (), "", at)

    def _default(self, where: str, kind: FieldType, text: str) -> Default | None:
        self._left -= len(text)
        if not text or self._left < 0:
            return None
        try:
            return _default(kind, text)
        except LiteralProblem as problem:
            raise _problem(where, f"default value: {problem}") from None


def _type(where: str, description: Description) -> FieldType:
    kind = FieldType.of_description(description)
    if kind is None:
        raise _problem(where, f"the type id {description['type_id']} is not supported")
    if kind.base == description["nested_type_name"]:
        try:
            RosName.parse(kind.base)
        except InvalidNameError as error:
            raise _problem(where, str(error)[:400]) from None
    has_capacity = kind.arity in (Arity.ARRAY, Arity.BOUNDED)
    is_right = (kind.capacity > 0) is has_capacity and (kind.string_bound == 0 or kind.is_string)
    if not is_right or kind.description() != description:
        raise _problem(where, f"no field has the type {description}"[:400])
    return kind


def _default(kind: FieldType, text: str) -> Default:
    if kind.is_message:
        raise LiteralProblem(f'a field of type "{kind}" cannot have a default')
    if kind.arity is Arity.SCALAR:
        return _scalar(kind, text)
    values = python_value(text)
    if not isinstance(values, tuple) or any(isinstance(one, str) is not kind.is_string for one in values):
        raise LiteralProblem(f"expected a tuple for {kind}, found {text[:60]!r}")
    fits = len(values) == kind.capacity if kind.arity is Arity.ARRAY else len(values) <= (kind.capacity or len(values))
    if not fits:
        raise LiteralProblem(f"expected {kind.capacity} values for {kind}, found {len(values)}")
    return tuple(_scalar(kind.element, one if isinstance(one, str) else repr(one)) for one in values)


def _scalar(kind: FieldType, text: str) -> Scalar:
    if not kind.is_string:
        return parse_scalar(kind, text)
    if kind.string_bound and len(text) > kind.string_bound:
        raise LiteralProblem(f"expected at most {kind.string_bound} characters, found {len(text)}")
    return text
