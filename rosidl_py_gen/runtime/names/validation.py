"""Which names ROS allows, and how a name as written becomes a fully qualified one.

Decides validation and expansion (docs/internals/protocol.md 10.1, 10.2). Rules are looked at in the order of rcl and
rmw, so that the place we tell is theirs. Remapping is `remap.py`, what DDS calls a name is `dds.py`. A name is
validated twice: as written, so that the caret points into the text the user typed, and again after expansion, because
substitutions and namespaces can break it.
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
_GIVEN_CHARACTER = re.compile(r"[A-Za-z0-9_/~{}]")
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")


class NameRule(Enum):
    """Rule that a name breaks; rcl and rmw have a text of their own for each."""

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
    """First thing that is wrong with a name."""

    position: int
    """Index of the offending character."""
    rule: NameRule
    reason: str
    """The text for people."""


def _raise_for(fault: NameFault | None, what: str, name: str) -> None:
    """Raise with the name and a caret below the offending character, if there is a fault."""
    if fault is None:
        return
    index, _, reason = fault
    start = max(0, index - 60)
    shown = name[start : start + 120]
    # repr() of a character may be wider than one column, so control characters are shown as "?".
    line = "".join(c if c.isprintable() else "?" for c in shown)
    text = f"invalid {what} {name!r:.300}: {reason}\n    {line}\n    {' ' * (index - start)}^"
    raise InvalidNameError(text, name=name, index=index, reason=reason)


def _check_type(what: str, name: object) -> None:
    if not isinstance(name, str):
        raise InvalidNameError(f"invalid {what}: expected a str, got {type(name).__name__} {name!r:.300}")


def validate_node_name(name: str) -> None:
    """Refuse a node name, without namespace, that rmw would refuse; raises `InvalidNameError`."""
    _check_type("node name", name)
    _raise_for(find_node_name_fault(name), "node name", name)


def find_node_name_fault(name: str) -> NameFault | None:
    """Return the reason why rmw refuses a node name, without namespace; None if it accepts it."""
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
    """Refuse a namespace that rmw would refuse: ``/`` or ``/a/b``; raises `InvalidNameError`."""
    _check_type("namespace", namespace)
    _raise_for(find_namespace_fault(namespace), "namespace", namespace)


def find_namespace_fault(namespace: str) -> NameFault | None:
    """Return the reason why rmw refuses a namespace; None if it accepts it."""
    return None if namespace == "/" else _full_fault(namespace, MAX_NAMESPACE_LENGTH)


def normalize_namespace(namespace: str) -> str:
    """The namespace with its leading ``/``; empty becomes ``/``. Raises `InvalidNameError`."""
    _check_type("namespace", namespace)
    full = namespace if namespace.startswith("/") else f"/{namespace}"
    validate_namespace(full)
    return full


def validate_full_name(name: str, what: str = "topic name") -> None:
    """Refuse a fully qualified topic or service name that rmw would refuse; raises `InvalidNameError`.

    Args:
        what: what it is called in the error.
    """
    _check_type(what, name)
    _raise_for(find_full_name_fault(name), what, name)


def find_full_name_fault(name: str) -> NameFault | None:
    """Return the reason why rmw refuses a fully qualified topic or service name; None if it accepts it."""
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
    """Refuse a topic or service name as written by a user, with ``~`` and ``{...}``; raises `InvalidNameError`.

    Args:
        what: what it is called in the error.
    """
    _check_type(what, name)
    _raise_for(find_name_fault(name), what, name)


def find_name_fault(name: str) -> NameFault | None:
    """Return the reason why rcl refuses a topic or service name as written by a user; None if it accepts it."""
    if not name:
        return NameFault(0, NameRule.EMPTY, "it is empty")
    if fault := _token_fault(name, 0):
        return fault
    if name.endswith("/"):
        return NameFault(len(name) - 1, NameRule.TRAILING_SLASH, "it must not end with '/'")
    if fault := _given_character_fault(name):
        return fault
    for index in range(1, len(name)):
        if name[index - 1] == "/":
            if fault := _token_fault(name, index):
                return fault
        elif name[0] == "~" and index == 1 and name[1] != "/":
            return NameFault(1, NameRule.TILDE_SLASH, "'~' must be followed by '/'")
    if "{}" in name:  # rcl finds it when it expands
        return NameFault(name.index("{}") + 1, NameRule.SUBSTITUTION, "'' is not a substitution name")
    return None


def _given_character_fault(name: str) -> NameFault | None:
    opened = -1
    for index, character in enumerate(name):
        if character == "}":
            if opened < 0:
                return NameFault(index, NameRule.BRACES, "'}' without '{'")
            opened = -1
        elif opened >= 0:
            if character == "{":
                return NameFault(index, NameRule.SUBSTITUTION, "substitutions must not be nested")
            if not _IDENTIFIER.match(name[opened + 1 : index + 1]):
                inner = name[opened + 1 :].partition("}")[0]
                return NameFault(index, NameRule.SUBSTITUTION, f"{inner!r} is not a substitution name")
        elif character == "{":
            opened = index
        elif not _GIVEN_CHARACTER.match(character):
            reason = f"character {character!r} is not allowed, only A-Z, a-z, 0-9, _, /, ~ and {{}} are"
            return NameFault(index, NameRule.CHARACTER, reason)
        elif character == "~" and index > 0:
            return NameFault(index, NameRule.TILDE_PLACE, "'~' may only be the first character")
    return None if opened < 0 else NameFault(opened, NameRule.BRACES, "'{' without '}'")


def fully_qualified_node_name(name: str, namespace: str) -> str:
    """``/ns/name``; `namespace` begins with ``/``."""
    return f"/{name}" if namespace == "/" else f"{namespace}/{name}"


def resolve_node_name(name: str, namespace: str) -> str:
    """``/ns/name`` for a node given as ``name``, which is looked for in `namespace`, or as ``/ns/name``.

    Raises `InvalidNameError`.
    """
    _check_type("node name", name)
    above, slash, plain = name.rpartition("/")
    validate_node_name(plain)
    return fully_qualified_node_name(plain, normalize_namespace(above if slash else namespace))


def expand_name(name: str, node_name: str, namespace: str, what: str = "topic name") -> str:
    """Turn a name as written into a fully qualified one, without remapping: ``~/x`` into ``/ns/node/x``.

    Args:
        what: what it is called in the error.

    Raises:
        InvalidNameError: the name, as written or as it came out, is not allowed; its `name` is the one that is not.

    Source: docs/internals/protocol.md 10.2.
    """
    validate_name(name, what)
    full = name
    if full.startswith("~"):
        full = fully_qualified_node_name(node_name, namespace) + full[1:]
    values = {"node": node_name, "ns": namespace, "namespace": namespace}
    for found in _SUBSTITUTION.finditer(name):
        if found.group(1) not in values:
            known = ", ".join(f"{{{key}}}" for key in values)
            reason = f"unknown substitution {found.group()}; known are {known}"
            _raise_for(NameFault(found.start(), NameRule.SUBSTITUTION, reason), what, name)
    full = _SUBSTITUTION.sub(lambda found: values[found.group(1)], full)
    if not full.startswith("/"):
        full = f"/{full}" if namespace == "/" else f"{namespace}/{full}"
    validate_full_name(full, what)
    return full
