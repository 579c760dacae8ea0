"""Remap rules: parse one, and resolve every name of a node through them.

Decides which rule applies (docs/internals/protocol.md 10.3): the first that matches, and never to the result of another
one. Names of endpoints go through `NodeNames.resolve_topic` and `resolve_service`, which expand, remap once and
validate.
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
    validate_full_name,
    validate_node_name,
)

_TOKEN = r"(?:(?:[A-Za-z]_?)|_)(?:[0-9A-Za-z]_?)*"
_NAME = rf"(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*|~"
_RULE_PREFIX = re.compile(rf"({_TOKEN}):(?!=|//)")
_NAME_TEXT = re.compile(rf"(?:{_NAME})\Z")
_TOKEN_TEXT = re.compile(rf"{_TOKEN}\Z")
_NAMESPACE_TEXT = re.compile(rf"(?:/|(?:/{_TOKEN})+)\Z")


class InvalidRemapRuleError(InvalidNameError):
    """The user wrote a remap rule that cannot be understood."""


class RemapKind(Enum):
    """What a rule changes."""

    NODE_NAME = "node name"
    NAMESPACE = "namespace"
    TOPIC = "topic"
    SERVICE = "service"
    TOPIC_AND_SERVICE = "topic or service"


@dataclass(frozen=True, slots=True)
class RemapRule:
    """One rule; `node` None means every node, `match` is empty for node-name and namespace rules."""

    kind: RemapKind
    node: str | None
    match: str
    replacement: str

    def applies_to_node(self, node_name: str) -> bool:
        """True when the rule has no node prefix or names this node (name only, no namespace)."""
        return self.node is None or self.node == node_name


def parse_remap_rule(text: str) -> RemapRule:
    """Parse the argument of ``-r``; raises `InvalidRemapRuleError` that shows the text and the accepted forms."""
    left, separator, replacement = text.partition(":=")
    if not separator:
        raise _bad(text, "there is no ':='")
    node, left = _split_node(left)
    if left in ("__node", "__name"):
        if not _TOKEN_TEXT.match(replacement):
            raise _bad(text, f"{replacement!r} is not a node name")
        return RemapRule(RemapKind.NODE_NAME, node, "", replacement)
    if left == "__ns":
        if not _NAMESPACE_TEXT.match(replacement):
            raise _bad(text, f"{replacement!r} is not an absolute namespace")
        return RemapRule(RemapKind.NAMESPACE, node, "", replacement)
    kind, match = _split_scheme(left)
    for what, name in (("name to match", match), ("replacement", replacement)):
        if "*" in name or "\\" in name:
            raise _bad(text, f"wildcards and back references in the {what} are not implemented, in ROS neither")
        if not _NAME_TEXT.match(name):
            raise _bad(text, f"the {what} {name!r} is not a topic or service name (no '__' inside, no '{{}}')")
    return RemapRule(kind, node, match, replacement)


def _split_node(left: str) -> tuple[str | None, str]:
    found = _RULE_PREFIX.match(left)
    return (found.group(1), left[found.end() :]) if found else (None, left)


def _split_scheme(left: str) -> tuple[RemapKind, str]:
    for scheme, kind in (("rostopic://", RemapKind.TOPIC), ("rosservice://", RemapKind.SERVICE)):
        if left.startswith(scheme):
            return kind, left[len(scheme) :]
    return RemapKind.TOPIC_AND_SERVICE, left


def _bad(text: str, reason: str) -> InvalidRemapRuleError:
    forms = "[NODE:]from:=to, [NODE:]rostopic://from:=to, [NODE:]rosservice://from:=to, [NODE:]__node:=name, __ns:=/ns"
    return InvalidRemapRuleError(f"invalid remap rule {text!r}: {reason}; expected one of {forms}")


@dataclass(frozen=True, slots=True)
class NodeNames:
    """A node's final name and namespace, and how it resolves the names of its endpoints.

    Attributes:
        name: the node name after remapping.
        namespace: with its leading ``/``, after remapping.
        rules: in order of precedence, node-local ones first.
    """

    name: str
    namespace: str
    rules: tuple[RemapRule, ...] = ()

    @classmethod
    def create(cls, name: str, namespace: str = "", rules: tuple[RemapRule, ...] = ()) -> NodeNames:
        """Validate and remap a constructor's name and namespace; raises `InvalidNameError`.

        A node-name rule's prefix is compared with the original name, a namespace rule's with the remapped one.
        """
        validate_node_name(name)
        full_namespace = normalize_namespace(namespace)
        for rule in rules:
            if rule.kind is RemapKind.NODE_NAME and rule.applies_to_node(name):
                name = rule.replacement
                break
        for rule in rules:
            if rule.kind is RemapKind.NAMESPACE and rule.applies_to_node(name):
                full_namespace = rule.replacement
                break
        validate_node_name(name)
        return cls(name, normalize_namespace(full_namespace), rules)

    @property
    def fully_qualified_name(self) -> str:
        """``/ns/name``."""
        return fully_qualified_node_name(self.name, self.namespace)

    def resolve_topic(self, name: str) -> str:
        """Expand, remap and validate a topic name as written; raises `InvalidNameError`."""
        return self._resolve(name, RemapKind.TOPIC)

    def resolve_service(self, name: str) -> str:
        """Expand, remap and validate a service name as written; raises `InvalidNameError`."""
        return self._resolve(name, RemapKind.SERVICE)

    def _resolve(self, name: str, kind: RemapKind) -> str:
        what = f"{kind.value} name"
        full = expand_name(name, self.name, self.namespace, what)
        for rule in self.rules:
            if rule.kind not in (kind, RemapKind.TOPIC_AND_SERVICE) or not rule.applies_to_node(self.name):
                continue
            if expand_name(rule.match, self.name, self.namespace, what) == full:
                full = expand_name(rule.replacement, self.name, self.namespace, what)
                break
        validate_full_name(full, what)
        return full
