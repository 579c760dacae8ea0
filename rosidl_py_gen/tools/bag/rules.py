"""Rules for ``bag migrate``: a small YAML file of names that changed.

Decides what may be written there, and that whatever else is there is an error at its place. The file is a stranger's:
it is read as a tree of texts, without anchors, tags or anything else that could grow or run.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import yaml

from rosidl_py_gen.base.names import did_you_mean, split_ros_name
from rosidl_py_gen.compiler.changes.migration import Rule, Rules
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.tools import ToolError

if TYPE_CHECKING:
    from collections.abc import Iterator

_MAX_BYTES = 1 << 20
_NULL = "tag:yaml.org,2002:null"
_SECTIONS = ("types", "fields")


class _Loader(yaml.SafeLoader):
    """Refuses what refers to something else: a few lines of it can stand for any amount."""

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise yaml.MarkedYAMLError(problem="anchors and aliases are not supported", problem_mark=event.start_mark)
        return super().compose_node(parent, index)  # type: ignore[arg-type]


def read_rules(path: str) -> Rules:
    """The rules of a file.

    Raises:
        ToolError: it is wrong, with file, line and column. OSError: it cannot be read.
    """
    with Path(path).open("rb") as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise ToolError(f"{path}: expected at most {_MAX_BYTES} bytes of rules")
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise ToolError(f"{path}: expected UTF-8, found the byte {data[error.start]:#04x}") from None
    return parse_rules(text, path)


def parse_rules(text: str, name: str = "<rules>") -> Rules:
    """The rules of a text; `name` is shown in errors, which are those of `read_rules`."""
    try:
        root = yaml.compose(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{name}:{mark.line + 1}:{mark.column + 1}" if mark else name
        raise ToolError(f"{place}: {error.problem or 'no YAML'}") from None
    except yaml.YAMLError as error:  # a character that YAML does not allow
        raise ToolError(f"{name}: {str(error).splitlines()[0]}") from None
    except RecursionError:
        raise ToolError(f"{name}: nested far deeper than rules are") from None
    if root is None:
        return Rules()
    types: dict[str, Rule] = {}
    fields: dict[str, dict[str, Rule]] = {}
    for key, value in _entries(root, name, "expected types: and fields:"):
        if key.value == "types":
            for old, new in _entries(value, name, "types: expected the name of then: the name of now"):
                types[_type_name(old, name)] = Rule(_type_name(new, name), _place(new, name))
        elif key.value == "fields":
            for owner, rules in _entries(value, name, "fields: expected a type, and its fields below it"):
                what = f"{owner.value}: expected the field of then: the field of now, or null"
                fields[_type_name(owner, name)] = {
                    _text(old, name): Rule("" if _is_null(new) else _text(new, name), _place(new, name))
                    for old, new in _entries(rules, name, what)
                }
        else:
            _wrong(key, name, f'expected types or fields, found "{key.value[:80]}"{did_you_mean(key.value, _SECTIONS)}')
    return Rules(types, fields)


def _entries(node: yaml.Node, name: str, expected: str) -> Iterator[tuple[yaml.ScalarNode, yaml.Node]]:
    if _is_null(node):
        return
    if not isinstance(node, yaml.MappingNode):
        _wrong(node, name, expected)
    seen: set[str] = set()
    for key, value in node.value:
        text = _text(key, name)
        if text in seen:
            _wrong(key, name, f'"{text}" is there twice')
        seen.add(text)
        yield key, value


def _text(node: yaml.Node, name: str) -> str:
    """What is written there; ``y`` and ``no`` are names here, whatever YAML makes of them."""
    if not isinstance(node, yaml.ScalarNode) or _is_null(node) or len(node.value) > 1000:
        _wrong(node, name, "expected a name")
    return str(node.value)


def _type_name(node: yaml.Node, name: str) -> str:
    try:
        return str(split_ros_name(_text(node, name), "msg"))
    except InvalidNameError as error:
        _wrong(node, name, str(error))


def _is_null(node: yaml.Node) -> bool:
    return isinstance(node, yaml.ScalarNode) and node.tag == _NULL


def _place(node: yaml.Node, name: str) -> str:
    return f"{name}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def _wrong(node: yaml.Node, name: str, text: str) -> NoReturn:
    raise ToolError(f"{_place(node, name)}: {text}")
