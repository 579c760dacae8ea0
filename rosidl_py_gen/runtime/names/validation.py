"""Validation and expansion of names.

Rules are checked in the order of rcl and rmw, so that errors point at the same character. A name is validated twice: as
the user wrote it, so that the caret in the error text points into what the user wrote, and after expansion, which can
make the name invalid.
Source: docs/internals/protocol.md 10.1, 10.2.
"""

from __future__ import annotations

import re
from enum import Enum, auto
from typing import NamedTuple

from rosidl_py_gen.errors import InvalidNameError

MAX_TOPIC_LENGTH = 247
MAX_NAMESPACE_LENGTH = 245
MAX_NODE_NAME_LENGTH = 255

_NAME_CHARACTER = re.compile(r"[A-Za-z0-9_/]")
_UNEXPANDED_NAME_CHARACTER = re.compile(r"[A-Za-z0-9_/~{}]")
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")


class NameRule(Enum):
    """Rule that a name can break; rcl and rmw have an error text for each rule."""

    EMPTY = auto()
    CHARACTER = auto()
    FIRST_DIGIT = auto()
    LENGTH = auto()
    LEADING_SLASH = auto()
    TRAILING_SLASH = auto()
    REPEATED_SLASH = auto()
    TOKEN_FIRST_DIGIT = auto()
    BRACES = auto()
    SUBSTITUTION = auto()
    TILDE_PLACE = auto()
    TILDE_SLASH = auto()


class NameFault(NamedTuple):
    """First rule that a name breaks; `position` is the index of the offending character."""

    position: int
    rule: NameRule
    reason: str


def _raise_for(fault: NameFault | None, subject: str, name: str) -> None:
    """Raise `InvalidNameError` if `fault` is not None; the error text has a caret below the offending character."""
    if fault is None:
        return
    index, _, reason = fault
    start = max(0, index - 60)
    # The repr of a character may be wider than one column, so control characters are replaced by "?".
    line = "".join(c if c.isprintable() else "?" for c in name[start : start + 120])
    text = f"invalid {subject} {name!r:.300}: {reason}\n    {line}\n    {' ' * (index - start)}^"
    raise InvalidNameError(text, name=name, index=index, reason=reason)


def _check_type(subject: str, name: object) -> None:
    if not isinstance(name, str):
        raise InvalidNameError(f"invalid {subject}: expected a str, got {type(name).__name__} {name!r:.300}")


def validate_node_name(name: str) -> None:
    """Raise `InvalidNameError` if rmw would refuse a node name, given without namespace."""
    _check_type("node name", name)
    _raise_for(find_node_name_fault(name), "node name", name)


def find_node_name_fault(name: str) -> NameFault | None:
    """Return the rule of rmw that a node name (without namespace) breaks; None if the name is valid."""
    if not name:
        return NameFault(0, NameRule.EMPTY, "it is empty")
    for index, character in enumerate(name):
        if not _NAME_CHARACTER.match(character) or character == "/":
            reason = f"character {character!r} is not allowed, only A-Z, a-z, 0-9 and _ are"
            return NameFault(index, NameRule.CHARACTER, reason)
    if name[0].isdigit():
        return NameFault(0, NameRule.FIRST_DIGIT, "it must not begin with a digit")
    return _length_fault(name, MAX_NODE_NAME_LENGTH)


def _length_fault(name: str, max_length: int) -> NameFault | None:
    if len(name) <= max_length:
        return None
    return NameFault(max_length - 1, NameRule.LENGTH, f"it has {len(name)} characters, at most {max_length} fit")


def validate_namespace(namespace: str) -> None:
    """Raise `InvalidNameError` if rmw would refuse a namespace such as ``/`` or ``/a/b``."""
    _check_type("namespace", namespace)
    _raise_for(find_namespace_fault(namespace), "namespace", namespace)


def validate_enclave(name: str) -> None:
    """Raise `InvalidNameError` if rcl would refuse the name of an enclave such as ``/`` or ``/robot/arm``."""
    _check_type("enclave", name)
    _raise_for(find_namespace_fault(name), "enclave", name)


def find_namespace_fault(namespace: str) -> NameFault | None:
    """Return the rule of rmw that a namespace breaks; None if the namespace is valid."""
    return None if namespace == "/" else _full_fault(namespace, MAX_NAMESPACE_LENGTH)


def normalize_namespace(namespace: str) -> str:
    """Return a namespace with a leading ``/``, which the argument may lack; raise `InvalidNameError` if invalid."""
    _check_type("namespace", namespace)
    full = namespace if namespace.startswith("/") else f"/{namespace}"
    validate_namespace(full)
    return full


def validate_full_name(name: str, what: str = "topic name") -> None:
    """Raise `InvalidNameError` if rmw would refuse a fully qualified topic or service name.

    Args:
        name: fully qualified name.
        what: kind of the name for the error text.
    """
    _check_type(what, name)
    _raise_for(find_full_name_fault(name), what, name)


def find_full_name_fault(name: str) -> NameFault | None:
    """Return the rule of rmw that a fully qualified topic or service name breaks; None if the name is valid."""
    return _full_fault(name, MAX_TOPIC_LENGTH)


def _full_fault(name: str, max_length: int) -> NameFault | None:
    if not name.startswith("/"):
        return NameFault(0, NameRule.LEADING_SLASH, "it must begin with '/'")
    if name.endswith("/"):
        return NameFault(len(name) - 1, NameRule.TRAILING_SLASH, "it must not end with '/'")
    for index, character in enumerate(name):
        if not _NAME_CHARACTER.match(character):
            reason = f"character {character!r} is not allowed, only A-Z, a-z, 0-9, _ and / are"
            return NameFault(index, NameRule.CHARACTER, reason)
    for index in range(1, len(name)):
        if name[index - 1] == "/":
            if name[index] == "/":
                return NameFault(index, NameRule.REPEATED_SLASH, "it must not contain '//'")
            if fault := _token_fault(name, index):
                return fault
    return _length_fault(name, max_length)


def _token_fault(name: str, index: int) -> NameFault | None:
    if name[index] not in "0123456789":
        return None
    return NameFault(index, NameRule.TOKEN_FIRST_DIGIT, "a part between slashes must not begin with a digit")


def validate_name(name: str, what: str = "topic name") -> None:
    """Raise `InvalidNameError` if a topic or service name, before expansion of ``~`` and ``{...}``, is invalid.

    Args:
        name: name as the user wrote it.
        what: kind of the name for the error text.
    """
    _check_type(what, name)
    _raise_for(find_name_fault(name), what, name)


def find_name_fault(name: str) -> NameFault | None:
    """Return the rule of rcl that a topic or service name with ``~`` and ``{...}`` breaks; None if it is valid."""
    if not name:
        return NameFault(0, NameRule.EMPTY, "it is empty")
    if fault := _token_fault(name, 0):
        return fault
    if name.endswith("/"):
        return NameFault(len(name) - 1, NameRule.TRAILING_SLASH, "it must not end with '/'")
    if fault := _unexpanded_character_fault(name):
        return fault
    for index in range(1, len(name)):
        if name[index - 1] == "/":
            if fault := _token_fault(name, index):
                return fault
        elif name[0] == "~" and index == 1 and name[1] != "/":
            return NameFault(1, NameRule.TILDE_SLASH, "'~' must be followed by '/'")
    if "{}" in name:  # rcl reports it when it expands the name
        return NameFault(name.index("{}") + 1, NameRule.SUBSTITUTION, "'' is not a substitution name")
    return None


def _unexpanded_character_fault(name: str) -> NameFault | None:
    brace_index = -1
    for index, character in enumerate(name):
        if character == "}":
            if brace_index < 0:
                return NameFault(index, NameRule.BRACES, "'}' without '{'")
            brace_index = -1
        elif brace_index >= 0:
            if character == "{":
                return NameFault(index, NameRule.SUBSTITUTION, "substitutions must not be nested")
            if not _IDENTIFIER.match(name[brace_index + 1 : index + 1]):
                inner = name[brace_index + 1 :].partition("}")[0]
                return NameFault(index, NameRule.SUBSTITUTION, f"{inner!r} is not a substitution name")
        elif character == "{":
            brace_index = index
        elif not _UNEXPANDED_NAME_CHARACTER.match(character):
            reason = f"character {character!r} is not allowed, only A-Z, a-z, 0-9, _, /, ~ and {{}} are"
            return NameFault(index, NameRule.CHARACTER, reason)
        elif character == "~" and index > 0:
            return NameFault(index, NameRule.TILDE_PLACE, "'~' may only be the first character")
    return None if brace_index < 0 else NameFault(brace_index, NameRule.BRACES, "'{' without '}'")


def fully_qualified_node_name(name: str, namespace: str) -> str:
    """Return ``/ns/name`` for a node name and a namespace, which must begin with ``/``."""
    return f"/{name}" if namespace == "/" else f"{namespace}/{name}"


def resolve_node_name(name: str, namespace: str) -> str:
    """Return the full name ``/ns/name`` of a node, which is given as ``name`` in `namespace`, or as ``/ns/name``."""
    _check_type("node name", name)
    above, slash, plain = name.rpartition("/")
    validate_node_name(plain)
    return fully_qualified_node_name(plain, normalize_namespace(above if slash else namespace))


def expand_name(name: str, node_name: str, namespace: str, what: str = "topic name") -> str:
    """Return the fully qualified name of a topic or service, without remapping: ``~/x`` becomes ``/ns/node/x``.

    Args:
        name: name as the user wrote it.
        node_name: name of the node, without namespace.
        namespace: namespace of the node.
        what: kind of the name for the error text.

    Raises:
        InvalidNameError: the name as written, or after expansion, is invalid.
    """
    validate_name(name, what)
    full = name
    if full.startswith("~"):
        full = fully_qualified_node_name(node_name, namespace) + full[1:]
    values = {"node": node_name, "ns": namespace, "namespace": namespace}
    for match in _SUBSTITUTION.finditer(name):
        if match.group(1) not in values:
            reason = f"unknown substitution {match.group()}; expected one of {{node}}, {{ns}}, {{namespace}}"
            _raise_for(NameFault(match.start(), NameRule.SUBSTITUTION, reason), what, name)
    full = _SUBSTITUTION.sub(lambda match: values[match.group(1)], full)
    if not full.startswith("/"):
        full = f"/{full}" if namespace == "/" else f"{namespace}/{full}"
    validate_full_name(full, what)
    return full
