"""Remap rules, and the resolution of the names of a node and its entities.

The first rule that matches a name applies, once (docs/internals/protocol.md 10.3). `NodeNames.resolve_topic` and
`resolve_service` expand, remap and validate.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.runtime.names.validation import (
    expand_name,
    fully_qualified_node_name,
    normalize_namespace,
    validate_node_name,
)

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
