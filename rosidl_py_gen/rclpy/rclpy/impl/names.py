"""Why ROS refuses a name, in the words of rcl and rmw. The rules are those of `rosidl_py_gen.runtime`."""

from __future__ import annotations

import re
from collections.abc import Callable

from rosidl_py_gen import InvalidNameError, runtime

_GIVEN: dict[str, str] = {
    "it is empty": "topic name must not be empty string",
    "it must not end": "topic name must not end with a forward slash",
    "a part between": "topic name token must not start with a number",
    "character ": "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'",
    "'}' without": "topic name must not have unmatched (unbalanced) curly braces '{}'",
    "'{' without": "topic name must not have unmatched (unbalanced) curly braces '{}'",
    "'~' may only": "topic name must not have tilde '~' unless it is the first character",
    "'~' must be": "topic name must not have a tilde '~' that is not followed by a forward slash '/'",
    "": "substitution name must not contain characters other than alphanumerics or '_'",
}
"""How a reason of ours begins -> rcl's words. The last one is for all others."""
_FULL: dict[str, str] = {
    "it must begin": "topic name must be absolute, it must lead with a '/'",
    "it must not end": "topic name must not end with a '/'",
    "character ": "topic name must not contain characters other than alphanumerics, '_', or '/'",
    "it must not contain": "topic name must not contain repeated '/'",
    "a part between": "topic name must not have a token that starts with a number",
    "": "topic length should not exceed '255U - 8U'",
}
_NAMESPACE: dict[str, str] = {
    "it must begin": "namespace must be absolute, it must lead with a '/'",
    "it must not end": "namespace must not end with a '/', unless only a '/'",
    "character ": "namespace must not contain characters other than alphanumerics, '_', or '/'",
    "it must not contain": "namespace must not contain repeated '/'",
    "a part between": "namespace must not have a token that starts with a number",
    "": "namespace should not exceed 'RMW_NAMESPACE_MAX_NAME_LENGTH'",
}
_NODE: dict[str, str] = {
    "it is empty": "node name must not be empty",
    "character ": "node name must not contain characters other than alphanumerics or '_'",
    "it must not begin": "node name must not start with a number",
    "": "node name length should not exceed '255'",
}
_ONLY_RCL_TAKES = re.compile(r"~[A-Za-z0-9_]|.*\{\}", re.DOTALL)
"""``~x``, which rcl expands as ``~/`` without slash, and ``{}``, which it refuses when it expands."""

Fault = tuple[str, int]
"""Why a name is refused, and where."""


def fault_of_topic_name(name: str) -> Fault | None:
    """Of a name as written, with ``~`` and substitutions; None when it is allowed."""
    fault = _fault(name, runtime.validate_name, _GIVEN)
    if fault is None:
        return None
    text, index = fault
    if text == _GIVEN[""] and name[index : index + 1].isdigit() and name[index - 1 : index] == "{":
        return "substitution name must not start with a number", index
    if text in (_GIVEN[""], _GIVEN["'~' must be"]) and _ONLY_RCL_TAKES.match(name):
        return None
    return fault


def fault_of_full_topic_name(name: str) -> Fault | None:
    """Of a fully qualified name; None when it is allowed."""
    return ("topic name must not be empty", 0) if name == "" else _fault(name, runtime.validate_full_name, _FULL)


def fault_of_namespace(namespace: str) -> Fault | None:
    """Of a namespace that begins with ``/``; None when it is allowed."""
    if namespace == "":
        return "namespace must not be empty", 0
    return _fault(namespace, runtime.validate_namespace, _NAMESPACE)


def fault_of_node_name(name: str) -> Fault | None:
    """Of a name of a node, without namespace; None when it is allowed."""
    return _fault(name, runtime.validate_node_name, _NODE)


def _fault(name: str, validate: Callable[[str], None], texts: dict[str, str]) -> Fault | None:
    if not isinstance(name, str):
        raise TypeError(f"a name must be a str, got {name!r:.100}")
    try:
        validate(name)
    except InvalidNameError as error:
        reason = error.reason or ""
        return next(text for begin, text in texts.items() if reason.startswith(begin)), error.index or 0
    return None
