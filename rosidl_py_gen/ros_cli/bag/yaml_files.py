"""Small YAML files for ``bag`` commands, as trees whose nodes know their location, and the rules for ``bag migrate``.

The files are not trusted: they are parsed as trees of texts, without anchors or tags, and errors name the location. A
file of rules has renamed types and fields.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias

import yaml

from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.base.yaml_text import YamlError, YamlText
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.errors import InvalidNameError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.ros_cli.bag.migration import MigrationRules, RenameRule

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
        return YamlText(text, max_bytes=_MAX_BYTES).compose()
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
    return (
        isinstance(node, yaml.ScalarNode) and node.tag == YamlText.UNTAGGED and not node.style and node.value in _NULLS
    )


def place(node: yaml.Node, name: str) -> str:
    """Return the location of a YAML node as ``name:line:column``."""
    return f"{name}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def wrong(node: yaml.Node, name: str, reason: str) -> NoReturn:
    """Raise `CommandError` with the location of a YAML node and the reason."""
    raise CommandError(f"{place(node, name)}: {reason}")


_SECTIONS = ("types", "fields")


def read_rules(path: str) -> MigrationRules:
    """Read a file of rules for ``bag migrate``.

    Raises `CommandError` for an invalid file, OSError for one that cannot be read.
    """
    return parse_rules(read_text(path, "rules"), path)


def parse_rules(source: str, name: str = "<rules>") -> MigrationRules:
    """Parse a text with rules for ``bag migrate``. Raises `CommandError` with `name` and line if it is invalid."""
    from rosidl_py_gen.ros_cli.bag.migration import MigrationRules, RenameRule

    types: dict[str, RenameRule] = {}
    fields: dict[str, dict[str, RenameRule]] = {}
    for key, value in entries(parse(source, name), name, "expected types: and fields:"):
        if key.value == "types":
            for old, new in entries(value, name, "types: expected the old name: the new name"):
                types[_type_name(old, name)] = RenameRule(_type_name(new, name), place(new, name))
        elif key.value == "fields":
            for owner, rules in entries(value, name, "fields: expected a type, and its fields below it"):
                what = f"{owner.value}: expected the old field: the new field, or null"
                fields[_type_name(owner, name)] = {
                    text(old, name): RenameRule("" if is_null(new) else text(new, name), place(new, name))
                    for old, new in entries(rules, name, what)
                }
        else:
            wrong(key, name, f'expected types or fields, found "{key.value[:80]}"{did_you_mean(key.value, _SECTIONS)}')
    return MigrationRules(types, fields)


def _type_name(node: YamlNode, name: str) -> str:
    try:
        return str(RosName.parse(text(node, name), "msg"))
    except InvalidNameError as error:
        wrong(node, name, str(error))
