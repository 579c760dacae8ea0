"""From type descriptions, as nodes send them, to the interfaces they describe.

A description says what the RIHS01 hash covers: names, types and the order of fields. Constants and comments are only in
the source that may come with it. A source is used when it says the same fields; the hash tells nothing of the rest of
it. Both are untrusted: whatever no definition could have led to is refused, and how much may be described is limited.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache

from rosidl_py_gen.base.descriptions import EMPTY_MESSAGE, Description, individual_description
from rosidl_py_gen.base.fieldtype import PRIMITIVES, STRINGS, Arity, FieldType
from rosidl_py_gen.base.names import RosName, py_name, split_ros_name
from rosidl_py_gen.compiler.frontend import derived_interfaces
from rosidl_py_gen.compiler.frontend.interface_parser import parse_interface
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem, parse_scalar, python_value
from rosidl_py_gen.compiler.frontend.model import (
    Default,
    Diagnostics,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    Scalar,
    SourceText,
    messages_of,
)
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check, raise_diagnostics
from rosidl_py_gen.compiler.frontend.search_path import SearchPath, scan_search_path
from rosidl_py_gen.errors import DefinitionError, Diagnostic, InvalidNameError

MAX_TYPES = 500
MAX_FIELDS = 5000
"""Of all types together."""
MAX_OF_ONE = 1000
"""Fields of one type; CPython takes 0.2 s for its class then, and far more than twice as long for twice as many."""
MAX_TEXT = 1 << 18
"""Characters of all sources together, and of all default values; more are not looked at."""

Sources = Mapping[str, tuple[str, str]]
"""Type name -> encoding (``msg``, ``srv``, ``action``, ``idl``, ``implicit``) and text."""

_FIELD_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z", re.ASCII)
_WSTRINGS = 22 + Arity.BOUNDED.value
_ENOUGH = ("service_msgs", "unique_identifier_msgs", "builtin_interfaces")
"""Packages whose types derived messages refer to, though the descriptions of their neighbours do not."""
_BASES = {1: "", **{one.type_id: name for name, one in PRIMITIVES.items() if name != "char"}}
_BOUNDED = (21, 22)
_BASES |= {number: name for name, number in STRINGS.items()} | dict(zip(_BOUNDED, STRINGS, strict=True))


def written_messages(name: RosName, is_service: bool) -> tuple[str, ...]:
    """The messages that make up an interface; everything else of it is derived from these."""
    if is_service:
        return tuple(str(derived_interfaces.derived_name(name, part)) for part in ("Request", "Response"))
    if name.kind == "action" and "_" not in name.name:
        return tuple(str(derived_interfaces.derived_name(name, part)) for part in ("Goal", "Result", "Feedback"))
    return (str(name),)


def registry_from_descriptions(
    name: RosName, individuals: Mapping[str, Description], sources: Sources, is_service: bool = False
) -> InterfaceRegistry:
    """The interface `name` and all it refers to, checked.

    Args:
        individuals: the description of each type alone, by name; those that are not needed do not matter.
        is_service: the name is that of a service.

    Raises:
        DefinitionError: no definition could have led to this, or it is too large.
    """
    _limit(name, individuals)
    registry = InterfaceRegistry(_implied())
    described = _Described(individuals)
    texts = _within_size_limits(sources)
    own = written_messages(name, is_service)
    top = _from_source(name, texts, individuals, own) or _assembled(name, [described.message(one) for one in own])
    registry.add(name, top)
    for needed in _reachable(messages_of(top), individuals):
        part = split_ros_name(needed)
        registry.add(part, _from_source(part, texts, individuals, (needed,)) or described.message(needed))
    check(registry, [name])
    raise_diagnostics(registry)
    return registry


def _limit(name: RosName, individuals: Mapping[str, Description]) -> None:
    counts = [len(one["fields"]) for one in individuals.values()]
    if len(counts) > MAX_TYPES or sum(counts) > MAX_FIELDS or max(counts, default=0) > MAX_OF_ONE:
        raise _problem(
            str(name),
            f"expected a description of at most {MAX_TYPES} types with {MAX_OF_ONE} fields each and {MAX_FIELDS} "
            f"together, found {len(counts)} types with up to {max(counts)} fields and {sum(counts)} together",
        )


def _within_size_limits(sources: Sources) -> Sources:
    return sources if sum(len(text) for _, text in sources.values()) <= MAX_TEXT else {}


@cache
def _implied() -> SearchPath:
    found = scan_search_path((), ament="")
    return SearchPath({name: found.packages[name] for name in _ENOUGH}, [], ["the description"])


def _assembled(name: RosName, messages: list[MessageDef]) -> Interface:
    return derived_interfaces.assemble(name, messages, messages[0].source)


def _reachable(start: Iterable[MessageDef], individuals: Mapping[str, Description]) -> Iterator[str]:
    """Names of the types that messages refer to, those that belong to `start` itself left out."""
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
    """What the source of a type says, if there is one that says what the description does."""
    encoding, text = sources.get(str(name), ("", ""))
    if encoding not in (name.kind, "idl") or not text or _elements(encoding, text) > 2 * MAX_OF_ONE:
        return None
    source = SourceText(f"<{name}>", text.replace("\r\n", "\n").replace("\r", "\n"), encoding)
    try:
        found = parse_interface(name, source, _RaiseOnFirst())
    except DefinitionError:
        return None
    known = {str(message.name): message for message in messages_of(found)} if found else {}
    is_same = all(one in known and _fields_of(individuals.get(one)) == _rows(known[one]) for one in own)
    return found if is_same else None


def _elements(encoding: str, text: str) -> int:
    """About how many fields and constants there are, before any of them is looked at."""
    if encoding == "idl":
        return text.count(";")
    return sum(line[:1] not in ("", "#") for line in map(str.lstrip, text.splitlines()))


class _RaiseOnFirst(Diagnostics):
    """The first problem ends it: showing the line of each would take the square of their number."""

    def add(self, location: Location, text: str) -> None:
        raise DefinitionError(location.diagnostic(text))


def _rows(message: MessageDef) -> list[tuple[object, object]]:
    rows = [(item.name, item.type, "") for item in message.fields]
    return _fields_of(individual_description(str(message.name), rows))


def _fields_of(one: Description | None) -> list[tuple[object, object]]:
    return [] if one is None else [(item["name"], item["type"]) for item in one["fields"]]


# --- from the description -------------------------------------------------------------------------------------------


class _Described:
    """Messages of descriptions; default values of one answer share a limit."""

    def __init__(self, individuals: Mapping[str, Description]) -> None:
        self._individuals = individuals
        self._left = MAX_TEXT

    def message(self, name: str) -> MessageDef:
        """Raises `DefinitionError`."""
        one = self._individuals.get(name)
        if one is None:
            raise _problem(name, "the type is not described")
        source = SourceText(f"<{name}>", "", "implicit")
        fields = tuple(self._field(name, item, Location(source, 1, 1)) for item in one["fields"])
        if not fields:
            raise _problem(name, "expected at least one field, found none")
        if len({py_name(item.name) for item in fields}) < len(fields):
            raise _problem(name, "two fields have the same name")
        if [(item.name, item.type) for item in fields] == [EMPTY_MESSAGE[0][:2]]:
            fields = ()
        return MessageDef(split_ros_name(name), fields, (), (), source)

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


def _type(where: str, told: Description) -> FieldType:
    number, capacity, bound = told["type_id"], told["capacity"], told["string_capacity"]
    base = _BASES.get(number % 48)
    if base is None or number // 48 > 3:
        raise _problem(where, f"the type id {number} is not supported")
    nested = told["nested_type_name"]
    if not base:
        try:
            split_ros_name(nested)
        except InvalidNameError as error:
            raise _problem(where, str(error)[:400]) from None
    arity = Arity(number // 48 * 48)
    if number == _WSTRINGS and capacity == bound:
        # So the reference describes wstring<=N[] (docs/internals/protocol.md 1.7).
        arity, capacity = Arity.UNBOUNDED, 0
    kind = FieldType(base or nested, arity, capacity, bound)
    is_right = (capacity > 0) is (arity in (Arity.ARRAY, Arity.BOUNDED)) and (bound > 0) is (number % 48 in _BOUNDED)
    if not is_right or kind.description() != told:
        raise _problem(where, f"no field has the type {told}"[:400])
    return kind


def _default(kind: FieldType, text: str) -> Default:
    """The inverse of `default_text`."""
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
