"""Rules for ``bag migrate``: a YAML file of renamed types and fields."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean, split_ros_name
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.ros_cli.bag.yaml_tree import entries, is_null, parse, place, read_text, text, wrong

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.migration import MigrationRules, RenameRule
    from rosidl_py_gen.ros_cli.bag.yaml_tree import YamlNode

_SECTIONS = ("types", "fields")


def read_rules(path: str) -> MigrationRules:
    """Read a file of rules for ``bag migrate``.

    Raises `CommandError` for an invalid file, OSError for one that cannot be read.
    """
    return parse_rules(read_text(path, "rules"), path)


def parse_rules(source: str, name: str = "<rules>") -> MigrationRules:
    """Parse a text with rules for ``bag migrate``. Raises `CommandError` with `name` and line if it is invalid."""
    from rosidl_py_gen.compiler.migration import MigrationRules, RenameRule

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
        return str(split_ros_name(text(node, name), "msg"))
    except InvalidNameError as error:
        wrong(node, name, str(error))
