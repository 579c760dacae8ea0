"""Which names ROS allows, and how a name as written becomes a fully qualified one.

Decides validation and expansion (docs/internals/protocol.md 10.1, 10.2). Rules are looked at in the order of rcl and
rmw, so that the place we tell is theirs. Remapping is `remap.py`, what DDS calls a name is `dds.py`. A name is
validated twice: as written, so that the caret points into the text the user typed, and again after expansion, because
substitutions and namespaces can break it.
"""

from __future__ import annotations

import re
from typing import NoReturn

from rosidl_py_gen.errors import InvalidNameError

MAX_TOPIC_LENGTH = 247
MAX_NAMESPACE_LENGTH = 245
MAX_NODE_NAME_LENGTH = 255

_NAME_CHARACTER = re.compile(r"[A-Za-z0-9_/]")
_GIVEN_CHARACTER = re.compile(r"[A-Za-z0-9_/~{}]")
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")


def _fail(what: str, name: str, index: int, reason: str) -> NoReturn:
    """Raise with the name and a caret below the offending character; `index` is 0-based."""
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
    what = "node name"
    _check_type(what, name)
    if not name:
        _fail(what, name, 0, "it is empty")
    for index, character in enumerate(name):
        if not _NAME_CHARACTER.match(character) or character == "/":
            _fail(what, name, index, f"character {character!r} is not allowed, only A-Z, a-z, 0-9 and _ are")
    if name[0].isdigit():
        _fail(what, name, 0, "it must not begin with a digit")
    if len(name) > MAX_NODE_NAME_LENGTH:
        _fail(
            what, name, MAX_NODE_NAME_LENGTH - 1, f"it has {len(name)} characters, at most {MAX_NODE_NAME_LENGTH} fit"
        )


def validate_namespace(namespace: str) -> None:
    """Refuse a namespace that rmw would refuse: ``/`` or ``/a/b``; raises `InvalidNameError`."""
    _check_type("namespace", namespace)
    if namespace != "/":
        _check_full("namespace", namespace, MAX_NAMESPACE_LENGTH)


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
    _check_full(what, name, MAX_TOPIC_LENGTH)


def _check_full(what: str, name: str, max_length: int) -> None:
    if not name.startswith("/"):
        _fail(what, name, 0, "it must begin with '/'")
    if name.endswith("/"):
        _fail(what, name, len(name) - 1, "it must not end with '/'")
    for index, character in enumerate(name):
        if not _NAME_CHARACTER.match(character):
            _fail(what, name, index, f"character {character!r} is not allowed, only A-Z, a-z, 0-9, _ and / are")
    for index in range(1, len(name)):
        if name[index - 1] == "/":
            if name[index] == "/":
                _fail(what, name, index, "it must not contain '//'")
            _check_token_start(what, name, index)
    if len(name) > max_length:
        _fail(what, name, max_length - 1, f"it has {len(name)} characters, at most {max_length} fit")


def _check_token_start(what: str, name: str, index: int) -> None:
    if name[index] in "0123456789":
        _fail(what, name, index, "a part between slashes must not begin with a digit")


def validate_name(name: str, what: str = "topic name") -> None:
    """Refuse a topic or service name as written by a user, with ``~`` and ``{...}``; raises `InvalidNameError`.

    Args:
        what: what it is called in the error.
    """
    _check_type(what, name)
    if not name:
        _fail(what, name, 0, "it is empty")
    _check_token_start(what, name, 0)
    if name.endswith("/"):
        _fail(what, name, len(name) - 1, "it must not end with '/'")
    _check_given_characters(what, name)
    for index in range(1, len(name)):
        if name[index - 1] == "/":
            _check_token_start(what, name, index)
        elif name[0] == "~" and index == 1 and name[1] != "/":
            _fail(what, name, 1, "'~' must be followed by '/'")
    if "{}" in name:  # rcl finds it when it expands
        _fail(what, name, name.index("{}") + 1, "'' is not a substitution name")


def _check_given_characters(what: str, name: str) -> None:
    opened = -1
    for index, character in enumerate(name):
        if character == "}":
            if opened < 0:
                _fail(what, name, index, "'}' without '{'")
            opened = -1
        elif opened >= 0:
            if character == "{":
                _fail(what, name, index, "substitutions must not be nested")
            _check_substitution(what, name, opened + 1, index)
        elif character == "{":
            opened = index
        elif not _GIVEN_CHARACTER.match(character):
            reason = f"character {character!r} is not allowed, only A-Z, a-z, 0-9, _, /, ~ and {{}} are"
            _fail(what, name, index, reason)
        elif character == "~" and index > 0:
            _fail(what, name, index, "'~' may only be the first character")
    if opened >= 0:
        _fail(what, name, opened, "'{' without '}'")


def _check_substitution(what: str, name: str, start: int, index: int) -> None:
    """Of the name of a substitution that begins at `start`, the character at `index`."""
    if not _IDENTIFIER.match(name[start : index + 1]):
        inner = name[start:].partition("}")[0]
        _fail(what, name, index, f"{inner!r} is not a substitution name")


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
            _fail(what, name, found.start(), f"unknown substitution {found.group()}; known are {known}")
    full = _SUBSTITUTION.sub(lambda found: values[found.group(1)], full)
    if not full.startswith("/"):
        full = f"/{full}" if namespace == "/" else f"{namespace}/{full}"
    validate_full_name(full, what)
    return full
