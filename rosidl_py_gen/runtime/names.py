"""Names of nodes, topics and services: validation, expansion, remap rules, and the resolution of the names of a node.

Rules are checked in the order of rcl and rmw, so that errors point at the same character. A name is validated twice: as
the user wrote it, so that the caret in the error text points into what the user wrote, and after expansion, which can
make the name invalid.

The first remap rule that matches a name applies, once (docs/internals/protocol.md 10.3). `NodeNames.resolve_topic` and
`resolve_service` expand, remap and validate.
Source: docs/internals/protocol.md 10.1, 10.2.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
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


# ------------------------------------------------------------------------------------------------------------ remapping

_TOKEN = r"(?:(?:[A-Za-z]_?)|_)(?:[0-9A-Za-z]_?)*"
_NAME = rf"(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*|~"
_RULE_PREFIX = re.compile(rf"({_TOKEN}):(?!=|//)")
_NAME_TEXT = re.compile(rf"(?:{_NAME})\Z")
TOKEN_TEXT = re.compile(rf"{_TOKEN}\Z")
"""Regular expression for a node name without namespace, in remap rules and in the argument of ``-p``."""
_NAMESPACE_TEXT = re.compile(rf"(?:/|(?:/{_TOKEN})+)\Z")


class InvalidRemapRuleError(InvalidNameError):
    """Raised if a remap rule cannot be parsed."""


class RemapKind(Enum):
    """Kind of name that a remap rule changes."""

    NODE_NAME = "node name"
    NAMESPACE = "namespace"
    TOPIC = "topic"
    SERVICE = "service"
    TOPIC_AND_SERVICE = "topic or service"


_SCHEMES = {"rostopic://": RemapKind.TOPIC, "rosservice://": RemapKind.SERVICE}


@dataclass(frozen=True, slots=True)
class RemapRule:
    """Remap rule, such as ``node:from:=to``.

    Attributes:
        kind: kind of name that the rule changes.
        node: name of the node to which the rule applies; None means every node.
        match: name to replace; empty for rules that change node names and namespaces.
        replacement: new name.
    """

    kind: RemapKind
    node: str | None
    match: str
    replacement: str

    def applies_to_node(self, node_name: str) -> bool:
        """Return True if the rule applies to every node, or to the node of this name, given without namespace."""
        return self.node is None or self.node == node_name


def parse_remap_rule(text: str) -> RemapRule:
    """Parse a remap rule, the argument of ``-r``.

    Raises:
        InvalidRemapRuleError: the rule is invalid, or contains wildcards, which are not supported.
    """
    left, separator, replacement = text.partition(":=")
    if not separator:
        raise _rule_error(text, "there is no ':='")
    prefix = _RULE_PREFIX.match(left)
    node, left = (prefix.group(1), left[prefix.end() :]) if prefix else (None, left)
    if left in ("__node", "__name"):
        if not TOKEN_TEXT.match(replacement):
            raise _rule_error(text, f"{replacement!r} is not a node name")
        return RemapRule(RemapKind.NODE_NAME, node, "", replacement)
    if left == "__ns":
        if not _NAMESPACE_TEXT.match(replacement):
            raise _rule_error(text, f"{replacement!r} is not an absolute namespace")
        return RemapRule(RemapKind.NAMESPACE, node, "", replacement)
    scheme = next((scheme for scheme in _SCHEMES if left.startswith(scheme)), "")
    match = left.removeprefix(scheme)
    for subject, name in (("name to match", match), ("replacement", replacement)):
        if "*" in name or "\\" in name:
            reason = f"wildcards and back references in the {subject} are not supported (nor by ROS)"
            raise _rule_error(text, reason)
        if not _NAME_TEXT.match(name):
            raise _rule_error(
                text, f"the {subject} {name!r} is not a topic or service name (no '__' inside, no '{{}}')"
            )
    return RemapRule(_SCHEMES.get(scheme, RemapKind.TOPIC_AND_SERVICE), node, match, replacement)


def _rule_error(text: str, reason: str) -> InvalidRemapRuleError:
    forms = "[NODE:]from:=to, [NODE:]rostopic://from:=to, [NODE:]rosservice://from:=to, [NODE:]__node:=name, __ns:=/ns"
    return InvalidRemapRuleError(f"invalid remap rule {text!r}: {reason}; expected one of {forms}")


@dataclass(frozen=True, slots=True)
class NodeNames:
    """Name and namespace of a node after remapping, and the remap rules for its entities.

    Attributes:
        name: name without namespace.
        namespace: begins with ``/``.
        rules: rules in order of precedence, the node's own rules first.
    """

    name: str
    namespace: str
    rules: tuple[RemapRule, ...] = ()

    @classmethod
    def create(cls, name: str, namespace: str = "", rules: tuple[RemapRule, ...] = ()) -> NodeNames:
        """Validate and remap the name and namespace of a node, and return the result.

        The node prefix of a rule for the node name is compared with the original name. The node prefix of a rule for
        the namespace is compared with the new name.

        Raises:
            InvalidNameError: name or namespace is invalid.
        """
        validate_node_name(name)
        normalize_namespace(namespace)

        def remapped(kind: RemapKind, value: str) -> str:
            rules_of_kind = (rule for rule in rules if rule.kind is kind and rule.applies_to_node(name))
            return next((rule.replacement for rule in rules_of_kind), value)

        name = remapped(RemapKind.NODE_NAME, name)
        validate_node_name(name)
        return cls(name, normalize_namespace(remapped(RemapKind.NAMESPACE, namespace)), rules)

    @property
    def fully_qualified_name(self) -> str:
        """Namespace and name of the node: ``/ns/name``."""
        return fully_qualified_node_name(self.name, self.namespace)

    def resolve_topic(self, name: str) -> str:
        """Expand, remap and validate a topic name; raise `InvalidNameError` if it is invalid."""
        return self._resolve(name, RemapKind.TOPIC)

    def resolve_service(self, name: str) -> str:
        """Expand, remap and validate a service name; raise `InvalidNameError` if it is invalid."""
        return self._resolve(name, RemapKind.SERVICE)

    def _resolve(self, name: str, kind: RemapKind) -> str:
        subject = f"{kind.value} name"
        full = expand_name(name, self.name, self.namespace, subject)
        for rule in self.rules:
            if rule.kind not in (kind, RemapKind.TOPIC_AND_SERVICE) or not rule.applies_to_node(self.name):
                continue
            if expand_name(rule.match, self.name, self.namespace, subject) == full:
                return expand_name(rule.replacement, self.name, self.namespace, subject)
        return full
