"""Reasons why a name is invalid, with the texts of rcl and rmw. The runtime of rosidl_py_gen contains the rules."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal

from rosidl_py_gen.runtime._rclpy_support import (
    NameFault,
    NameRule,
    find_full_name_fault,
    find_name_fault,
    find_namespace_fault,
    find_node_name_fault,
)

_RULES: dict[str, tuple[Callable[[str], NameFault | None], dict[NameRule, str]]] = {
    "topic name": (
        find_name_fault,
        {
            NameRule.EMPTY: "topic name must not be empty string",
            NameRule.TRAILING_SLASH: "topic name must not end with a forward slash",
            NameRule.TOKEN_FIRST_DIGIT: "topic name token must not start with a number",
            NameRule.CHARACTER: "topic name must not contain characters other than alphanumerics,"
            " '_', '~', '{', or '}'",
            NameRule.BRACES: "topic name must not have unmatched (unbalanced) curly braces '{}'",
            NameRule.TILDE_PLACE: "topic name must not have tilde '~' unless it is the first character",
            NameRule.TILDE_SLASH: "topic name must not have a tilde '~' that is not followed by a forward slash '/'",
            NameRule.SUBSTITUTION: "substitution name must not contain characters other than alphanumerics or '_'",
        },
    ),
    "full topic name": (
        find_full_name_fault,
        {
            NameRule.EMPTY: "topic name must not be empty",
            NameRule.LEADING_SLASH: "topic name must be absolute, it must lead with a '/'",
            NameRule.TRAILING_SLASH: "topic name must not end with a '/'",
            NameRule.CHARACTER: "topic name must not contain characters other than alphanumerics, '_', or '/'",
            NameRule.REPEATED_SLASH: "topic name must not contain repeated '/'",
            NameRule.TOKEN_FIRST_DIGIT: "topic name must not have a token that starts with a number",
            NameRule.LENGTH: "topic length should not exceed '255U - 8U'",
        },
    ),
    "namespace": (
        find_namespace_fault,
        {
            NameRule.EMPTY: "namespace must not be empty",
            NameRule.LEADING_SLASH: "namespace must be absolute, it must lead with a '/'",
            NameRule.TRAILING_SLASH: "namespace must not end with a '/', unless only a '/'",
            NameRule.CHARACTER: "namespace must not contain characters other than alphanumerics, '_', or '/'",
            NameRule.REPEATED_SLASH: "namespace must not contain repeated '/'",
            NameRule.TOKEN_FIRST_DIGIT: "namespace must not have a token that starts with a number",
            NameRule.LENGTH: "namespace should not exceed 'RMW_NAMESPACE_MAX_NAME_LENGTH'",
        },
    ),
    "node name": (
        find_node_name_fault,
        {
            NameRule.EMPTY: "node name must not be empty",
            NameRule.CHARACTER: "node name must not contain characters other than alphanumerics or '_'",
            NameRule.FIRST_DIGIT: "node name must not start with a number",
            NameRule.LENGTH: "node name length should not exceed '255'",
        },
    ),
}
"""Rules by kind of name: the function of rosidl_py_gen.runtime that checks the name, and the error text of rcl or rmw
for each rule."""
_VALID_IN_RCL_ONLY = re.compile(r"~[A-Za-z0-9_]|.*\{\}", re.DOTALL)
"""Pattern of names that only rcl accepts: ``~x``, which it expands as ``~/x``, and ``{}``, which it refuses later."""


def name_error(kind: str, name: str) -> tuple[str, int] | None:
    """Return the reason why a name is invalid, and the index of the invalid character; None if the name is valid.

    Args:
        kind: ``topic name`` (also of services, before expansion), ``full topic name``, ``namespace`` or ``node name``.
        name: name to check.

    Raises:
        TypeError: the name is not a string.
    """
    if not isinstance(name, str):
        raise TypeError(f"name must be a str, got {name!r:.100}")
    find_fault, texts = _RULES[kind]
    if not name:
        return texts[NameRule.EMPTY], 0
    fault = find_fault(name)
    if fault is None:
        return None
    index, rule, _ = fault
    if rule is NameRule.SUBSTITUTION and name[index : index + 1].isdigit() and name[index - 1 : index] == "{":
        return "substitution name must not start with a number", index
    if rule in (NameRule.SUBSTITUTION, NameRule.TILDE_SLASH) and _VALID_IN_RCL_ONLY.match(name):
        return None
    return texts[rule], index


def require_valid(kind: str, name: str, error: Callable[[str, str, int], Exception]) -> Literal[True]:
    """Return True for a valid name.

    For an invalid name raise the exception that `error` makes of name, reason and index.
    """
    fault = name_error(kind, name)
    if fault is not None:
        raise error(name, *fault)
    return True
