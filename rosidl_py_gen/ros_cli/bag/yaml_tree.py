"""Parser of small YAML files for ``bag`` commands, which returns trees whose nodes know their location.

The files are not trusted: they are parsed as trees of texts, without anchors or tags, and errors name the location.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias

import yaml

from rosidl_py_gen.base.yaml_text import UNTAGGED, YamlError, compose_yaml
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Iterator

YamlNode: TypeAlias = yaml.Node
YamlScalar: TypeAlias = yaml.ScalarNode
_MAX_BYTES = 1 << 20
_MAX_TEXT = 1000
_NULLS = ("", "~", "null", "Null", "NULL")


def read_text(path: str, what: str) -> str:
    """Return the text of a file; raises `CommandError` if it is too large or not UTF-8.

    `what` describes the file, such as "rules".
    """
    with Path(path).open("rb") as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise CommandError(f"{path}: expected at most {_MAX_BYTES} bytes of {what}")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise CommandError(f"{path}: expected UTF-8, found the byte {data[error.start]:#04x}") from None


def parse(text: str, name: str) -> yaml.Node | None:
    """Parse a YAML text and return the root node, None if the text is empty.

    Raises `CommandError` that names the file `name`.
    """
    try:
        return compose_yaml(text, max_bytes=_MAX_BYTES)
    except YamlError as error:
        raise CommandError(error.at(name)) from None


def entries(node: yaml.Node | None, name: str, expected: str) -> Iterator[tuple[yaml.ScalarNode, yaml.Node]]:
    """Yield keys and values of a YAML mapping, nothing for null.

    Raises `CommandError` with the text `expected` for other nodes.
    """
    if node is None or is_null(node):
        return
    if not isinstance(node, yaml.MappingNode):
        wrong(node, name, expected)
    seen: set[str] = set()
    for key, value in node.value:
        written = text(key, name)
        if written in seen:
            wrong(key, name, f'"{written}" is defined twice')
        seen.add(written)
        yield key, value


def text(node: yaml.Node, name: str, expected: str = "expected a name") -> str:
    """Return the text of a scalar YAML node as written, so ``no`` is not False.

    Raises `CommandError` for any other node.
    """
    if not isinstance(node, yaml.ScalarNode) or is_null(node) or len(node.value) > _MAX_TEXT:
        wrong(node, name, expected)
    return str(node.value)


def is_null(node: yaml.Node) -> bool:
    """Return True if the value of a YAML node is missing or null."""
    return isinstance(node, yaml.ScalarNode) and node.tag == UNTAGGED and not node.style and node.value in _NULLS


def place(node: yaml.Node, name: str) -> str:
    """Return the location of a YAML node as ``name:line:column``."""
    return f"{name}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def wrong(node: yaml.Node, name: str, reason: str) -> NoReturn:
    """Raise `CommandError` with the location of a YAML node and the reason."""
    raise CommandError(f"{place(node, name)}: {reason}")
