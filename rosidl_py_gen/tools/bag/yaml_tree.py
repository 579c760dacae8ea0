"""Small YAML files that commands of ``bag`` are given: as trees whose nodes know their places.

Decides what may be written there at all. The files are a stranger's: they are read as trees of texts, without anchors,
tags or anything else that could grow or run, and whatever is wrong is an error at its place.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias

import yaml

from rosidl_py_gen.tools import ToolError

if TYPE_CHECKING:
    from collections.abc import Iterator

Node: TypeAlias = yaml.Node
ScalarNode: TypeAlias = yaml.ScalarNode
_MAX_BYTES = 1 << 20
_MAX_TEXT = 1000
_NULL = "tag:yaml.org,2002:null"


class _Loader(yaml.SafeLoader):
    """Refuses what refers to something else: a few lines of it can stand for any amount."""

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise yaml.MarkedYAMLError(problem="anchors and aliases are not supported", problem_mark=event.start_mark)
        return super().compose_node(parent, index)  # type: ignore[arg-type]


def read_text(path: str, what: str) -> str:
    """The text of a file of `what`.

    Raises:
        ToolError: it is too long or no text. OSError: it cannot be read.
    """
    with Path(path).open("rb") as file:
        data = file.read(_MAX_BYTES + 1)
    if len(data) > _MAX_BYTES:
        raise ToolError(f"{path}: expected at most {_MAX_BYTES} bytes of {what}")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise ToolError(f"{path}: expected UTF-8, found the byte {data[error.start]:#04x}") from None


def parse(text: str, name: str, what: str) -> yaml.Node | None:
    """The tree of a text, None for an empty one; `name` is shown in errors. Raises `ToolError`."""
    try:
        return yaml.compose(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        at = f"{name}:{mark.line + 1}:{mark.column + 1}" if mark else name
        raise ToolError(f"{at}: {error.problem or 'no YAML'}") from None
    except yaml.YAMLError as error:  # a character that YAML does not allow
        raise ToolError(f"{name}: {str(error).splitlines()[0]}") from None
    except RecursionError:
        raise ToolError(f"{name}: nested far deeper than {what} are") from None


def entries(node: yaml.Node, name: str, expected: str) -> Iterator[tuple[yaml.ScalarNode, yaml.Node]]:
    """Keys and values of a mapping; none for null. Raises `ToolError`."""
    if is_null(node):
        return
    if not isinstance(node, yaml.MappingNode):
        wrong(node, name, expected)
    seen: set[str] = set()
    for key, value in node.value:
        written = text(key, name)
        if written in seen:
            wrong(key, name, f'"{written}" is there twice')
        seen.add(written)
        yield key, value


def text(node: yaml.Node, name: str, expected: str = "expected a name") -> str:
    """What is written there; ``y`` and ``no`` are texts here, whatever YAML makes of them. Raises `ToolError`."""
    if not isinstance(node, yaml.ScalarNode) or is_null(node) or len(node.value) > _MAX_TEXT:
        wrong(node, name, expected)
    return str(node.value)


def is_null(node: yaml.Node) -> bool:
    """Whether nothing is written there, or null."""
    return isinstance(node, yaml.ScalarNode) and node.tag == _NULL


def place(node: yaml.Node, name: str) -> str:
    """File, line and column."""
    return f"{name}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def wrong(node: yaml.Node, name: str, reason: str) -> NoReturn:
    """Raise `ToolError` that names the place."""
    raise ToolError(f"{place(node, name)}: {reason}")
