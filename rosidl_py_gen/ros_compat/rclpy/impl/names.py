"""Reasons why a name is invalid, with the texts of rcl and rmw. The rules are those of the runtime."""

from __future__ import annotations

import re

from rosidl_py_gen.runtime._rclpy_support import (
    NameFault,
    NameRule,
    find_full_name_fault,
    find_name_fault,
    find_namespace_fault,
    find_node_name_fault,
)

_TOPIC_TEXTS: dict[NameRule, str] = {
    NameRule.EMPTY: "topic name must not be empty string",
    NameRule.TRAILING_SLASH: "topic name must not end with a forward slash",
    NameRule.TOKEN_FIRST_DIGIT: "topic name token must not start with a number",
    NameRule.CHARACTER: "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'",
    NameRule.BRACES: "topic name must not have unmatched (unbalanced) curly braces '{}'",
    NameRule.TILDE_PLACE: "topic name must not have tilde '~' unless it is the first character",
    NameRule.TILDE_SLASH: "topic name must not have a tilde '~' that is not followed by a forward slash '/'",
    NameRule.SUBSTITUTION: "substitution name must not contain characters other than alphanumerics or '_'",
}
"""Rule of a name before expansion -> text of rcl. The tables below are analogous."""
_FULL_TOPIC_TEXTS: dict[NameRule, str] = {
    NameRule.LEADING_SLASH: "topic name must be absolute, it must lead with a '/'",
    NameRule.TRAILING_SLASH: "topic name must not end with a '/'",
    NameRule.CHARACTER: "topic name must not contain characters other than alphanumerics, '_', or '/'",
    NameRule.REPEATED_SLASH: "topic name must not contain repeated '/'",
    NameRule.TOKEN_FIRST_DIGIT: "topic name must not have a token that starts with a number",
    NameRule.LENGTH: "topic length should not exceed '255U - 8U'",
}
_NAMESPACE_TEXTS: dict[NameRule, str] = {
    NameRule.LEADING_SLASH: "namespace must be absolute, it must lead with a '/'",
    NameRule.TRAILING_SLASH: "namespace must not end with a '/', unless only a '/'",
    NameRule.CHARACTER: "namespace must not contain characters other than alphanumerics, '_', or '/'",
    NameRule.REPEATED_SLASH: "namespace must not contain repeated '/'",
    NameRule.TOKEN_FIRST_DIGIT: "namespace must not have a token that starts with a number",
    NameRule.LENGTH: "namespace should not exceed 'RMW_NAMESPACE_MAX_NAME_LENGTH'",
}
_NODE_TEXTS: dict[NameRule, str] = {
    NameRule.EMPTY: "node name must not be empty",
    NameRule.CHARACTER: "node name must not contain characters other than alphanumerics or '_'",
    NameRule.FIRST_DIGIT: "node name must not start with a number",
    NameRule.LENGTH: "node name length should not exceed '255'",
}
_VALID_IN_RCL_ONLY = re.compile(r"~[A-Za-z0-9_]|.*\{\}", re.DOTALL)
"""Names that rcl accepts: ``~x``, which it expands as ``~/x``, and ``{}``, which it refuses later."""

Fault = tuple[str, int]
"""Reason and index of an error in a name."""


def topic_name_error(name: str) -> Fault | None:
    """Return the error of a topic or service name before expansion, None if it is valid."""
    fault = find_name_fault(_require_str(name))
    if fault is None:
        return None
    index, rule, _ = fault
    if rule is NameRule.SUBSTITUTION and name[index : index + 1].isdigit() and name[index - 1 : index] == "{":
        return "substitution name must not start with a number", index
    if rule in (NameRule.SUBSTITUTION, NameRule.TILDE_SLASH) and _VALID_IN_RCL_ONLY.match(name):
        return None
    return _TOPIC_TEXTS[rule], index


def full_topic_name_error(name: str) -> Fault | None:
    """Return the error of a fully qualified topic or service name, None if it is valid."""
    if name == "":
        return "topic name must not be empty", 0
    return _with_text(find_full_name_fault(_require_str(name)), _FULL_TOPIC_TEXTS)


def namespace_error(namespace: str) -> Fault | None:
    """Return the error of a namespace that begins with ``/``, None if it is valid."""
    if namespace == "":
        return "namespace must not be empty", 0
    return _with_text(find_namespace_fault(_require_str(namespace)), _NAMESPACE_TEXTS)


def node_name_error(name: str) -> Fault | None:
    """Return the error of a node name without namespace, None if it is valid."""
    return _with_text(find_node_name_fault(_require_str(name)), _NODE_TEXTS)


def _require_str(name: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"name must be a str, got {name!r:.100}")
    return name


def _with_text(fault: NameFault | None, texts: dict[NameRule, str]) -> Fault | None:
    return None if fault is None else (texts[fault.rule], fault.position)
