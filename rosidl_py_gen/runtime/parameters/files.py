"""Parameter files: reading and writing the YAML that rcl understands.

Decides what a scalar means, and it is not what YAML says: `y` is true, `010` is 8, `08` is 8.0 and `null` is a text
(docs/internals/protocol.md 10.5). So the standard resolver is replaced by one that only tells plain scalars from quoted
ones, and `plain_scalar` decides. Text is what is quoted or tagged ``!!str``; other tags are ignored (``!!int yes`` is
true) and block scalars count as plain, as in `get_value` of rcl_yaml_param_parser's parse.c. Reading files is the
caller's.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
import sys
from typing import TYPE_CHECKING, NoReturn

from rosidl_py_gen.base.resources import extra_missing
from rosidl_py_gen.base.yaml_text import STRING, YamlError, compose_yaml
from rosidl_py_gen.runtime.parameters.overrides import ParameterFileError, ParameterOverrides
from rosidl_py_gen.runtime.parameters.values import (
    INT64_MAX,
    INT64_MIN,
    InvalidParameterValueError,
    ParameterType,
    ParameterValue,
    parameter_value,
)

try:
    import yaml
except ModuleNotFoundError as missing:
    raise extra_missing(missing) or missing from None

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

PARAMETERS_KEY = "ros__parameters"
_BINARY = "tag:yaml.org,2002:binary"
_MAX_LEVELS = 500
"""Maximum depth of maps: names of nodes and parameters may be nested, and rcl has no limit."""
_TRUE = frozenset(["y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_INTEGER = re.compile(r"[+-]?(?:(?P<hex>0[xX][0-9a-fA-F]+)|(?P<octal>0[0-7]*)|(?P<decimal>[1-9][0-9]*))\Z")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\Z")
_HEX_FLOAT = re.compile(r"[+-]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?\Z")
_NAN = re.compile(r"(?:\.nan|\.NaN|\.NAN|[+-]?[nN][aA][nN])\Z")
_INFINITE = re.compile(r"(?P<sign>[+-]?)(?:\.inf|\.Inf|\.INF|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?)\Z")


# ----------------------------------------------------------------------------------------------------------- scalars


def plain_scalar(text: str) -> ParameterValue:
    """The value of an unquoted scalar; raises `InvalidParameterValueError` for an empty one."""
    if not text:
        raise InvalidParameterValueError("an empty value; write '' for an empty text")
    if text in _TRUE or text in _FALSE:
        return ParameterValue(ParameterType.BOOL, text in _TRUE)
    integer = _INTEGER.match(text)
    if integer:
        number = _integer(text, integer)
        if INT64_MIN <= number <= INT64_MAX:
            return ParameterValue(ParameterType.INTEGER, number)
    real = _float(text)
    if real is not None:
        return ParameterValue(ParameterType.DOUBLE, real)
    return ParameterValue(ParameterType.STRING, text)


def _integer(text: str, found: re.Match[str]) -> int:
    base = 16 if found["hex"] else 8 if found["octal"] else 10
    # More digits than any int64 has: CPython refuses to convert thousands of decimal digits.
    return INT64_MAX + 1 if len(text) > 70 and base == 10 else int(text, base)


def _float(text: str) -> float | None:
    """Like strtod, plus the ``.nan`` and ``.inf`` forms; None when the text is no number or out of range."""
    infinite = _INFINITE.match(text)
    if infinite:
        return -math.inf if infinite["sign"] == "-" else math.inf
    if _NAN.match(text):
        return math.nan
    try:
        value = float(text) if _FLOAT.match(text) else float.fromhex(text) if _HEX_FLOAT.match(text) else None
    except OverflowError:
        return None
    return None if value is None or math.isinf(value) or _underflows(text, value) else value


def _underflows(text: str, value: float) -> bool:
    """Whether glibc's strtod reports ERANGE for a tiny number, which makes it a text for rcl.

    It does when digits are lost: ``1e-310`` as ``1e-400``, but not ``0e-400``. Hexadecimal ones are taken for exact
    unless they become zero.
    """
    is_hex = "x" in text.lower()
    digits = text.lower().partition("p" if is_hex else "e")[0].strip("+-0x.")
    return digits != "" and (value == 0.0 or (abs(value) < sys.float_info.min and not is_hex))


# ----------------------------------------------------------------------------------------------------------- reading


def parse_parameter_file(text: str, name: str = "<text>") -> list[ParameterOverrides]:
    """Parse a parameter file; `name` is shown in errors. Raises `ParameterFileError` with line and column."""
    root = _compose(text, name)
    if root is None:
        return []
    if not isinstance(root, yaml.MappingNode):
        _fail(name, root, "expected node names with parameters below them")
    return list(_nodes(name, root, ""))


def parse_parameter_value(text: str) -> ParameterValue:
    """The value of a ``-p name:=value`` argument: a scalar or a list. Raises `ParameterFileError`."""
    node = _compose(text, "<value>")
    if node is None:
        raise ParameterFileError("<value>: an empty value; write '' for an empty text")
    return _value("<value>", node)


def _compose(text: str, name: str) -> yaml.Node | None:
    try:
        return compose_yaml(text, max_levels=_MAX_LEVELS)
    except YamlError as error:
        raise ParameterFileError(error.at(name)) from error


def _fail(name: str, node: yaml.Node, text: str) -> NoReturn:
    mark = node.start_mark
    raise ParameterFileError(f"{name}:{mark.line + 1}:{mark.column + 1}: {text}")


def _items(name: str, node: yaml.MappingNode) -> Iterator[tuple[str, yaml.Node]]:
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            _fail(name, key, "a key must be a text")
        yield key.value, value


def _nodes(name: str, mapping: yaml.MappingNode, prefix: str) -> Iterator[ParameterOverrides]:
    for key, node in _items(name, mapping):
        if key.startswith(PARAMETERS_KEY):
            if not prefix:
                _fail(name, node, f"{PARAMETERS_KEY} must be below the name of a node")
            if not isinstance(node, yaml.MappingNode):
                _fail(name, node, f"expected parameter names with values below {key}")
            yield ParameterOverrides(prefix, dict(_parameters(name, node, "")), name)
        elif isinstance(node, yaml.MappingNode):
            yield from _nodes(name, node, f"{prefix}/{key.strip('/')}")
        else:
            _fail(name, node, f"expected {PARAMETERS_KEY} below {key!r}, found a value")


def _parameters(name: str, mapping: yaml.MappingNode, prefix: str) -> Iterator[tuple[str, ParameterValue]]:
    for key, node in _items(name, mapping):
        if isinstance(node, yaml.MappingNode):
            yield from _parameters(name, node, f"{prefix}{key}.")
        else:
            yield prefix + key, _value(name, node)


def _value(name: str, node: yaml.Node) -> ParameterValue:
    try:
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node)
        if not isinstance(node, yaml.SequenceNode):
            _fail(name, node, "expected a value or a list, found a map")
        for item in node.value:
            if not isinstance(item, yaml.ScalarNode):
                _fail(name, item, "a list must hold plain values, no lists and no maps")
        return parameter_value([_scalar(item).value for item in node.value])
    except InvalidParameterValueError as error:
        _fail(name, node, str(error))


def _scalar(node: yaml.ScalarNode) -> ParameterValue:
    if node.tag == _BINARY:
        try:
            return ParameterValue(
                ParameterType.BYTE_ARRAY, base64.b64decode("".join(node.value.split()), validate=True)
            )
        except (binascii.Error, ValueError) as error:
            raise InvalidParameterValueError(f"not base64: {error}") from error
    if node.tag == STRING or node.style in ("'", '"'):
        return ParameterValue(ParameterType.STRING, node.value)
    return plain_scalar(node.value)


# ----------------------------------------------------------------------------------------------------------- writing


class _Dumper(yaml.Dumper):
    """Never writes an anchor; the resolver adds nothing, so that plain means what `plain_scalar` says."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012 (PyYAML's own name)

    def ignore_aliases(self, data: object) -> bool:
        return True


def dump_parameters(fully_qualified_name: str, values: Mapping[str, ParameterValue]) -> str:
    """The text of a parameter file for one node; reading it gives the same values back.

    Byte arrays are written as ``!!binary``, which only this package reads; rcl has no form for them. The type of an
    empty list is lost, declaring restores it. Parameters without a value are left out.
    """
    tree: dict[str, object] = {}
    for name, value in values.items():
        if value.is_set:
            _insert(tree, name, _value_node(value))
    body = _map_node([(PARAMETERS_KEY, _tree_node(tree))])
    return yaml.serialize(_map_node([(fully_qualified_name, body)]), Dumper=_Dumper, allow_unicode=True, width=120)


def _insert(tree: dict[str, object], name: str, node: yaml.Node) -> None:
    """Put `node` below nested maps; where a parameter has the name of a group, the dots stay in the key."""
    parts = name.split(".")
    for index, part in enumerate(parts[:-1]):
        below = tree.setdefault(part, {})
        if not isinstance(below, dict):
            tree[".".join(parts[index:])] = node
            return
        tree = below
    last = parts[-1]
    if isinstance(tree.get(last), dict):
        group = tree.pop(last)
        assert isinstance(group, dict)
        for key, value in _flat(group, f"{last}."):
            tree[key] = value
    tree[last] = node


def _flat(group: dict[str, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in group.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _tree_node(tree: dict[str, object]) -> yaml.Node:
    return _map_node([(key, _tree_node(value) if isinstance(value, dict) else value) for key, value in tree.items()])


def _map_node(items: list[tuple[str, object]]) -> yaml.Node:
    pairs = [(_text_node(key, quoted=False), node) for key, node in items]
    return yaml.MappingNode("tag:yaml.org,2002:map", pairs, flow_style=False)


def _value_node(value: ParameterValue) -> yaml.Node:
    content = value.value
    if isinstance(content, bytes):
        return yaml.ScalarNode(_BINARY, base64.b64encode(content).decode("ascii"))
    if isinstance(content, tuple):
        items = [_scalar_node(item) for item in content]
        return yaml.SequenceNode("tag:yaml.org,2002:seq", items, flow_style=True)
    assert content is not None
    return _scalar_node(content)


def _scalar_node(value: bool | int | float | str) -> yaml.Node:
    if isinstance(value, str):
        return _text_node(value, quoted=not value or plain_scalar(value).type is not ParameterType.STRING)
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, float) and not math.isfinite(value):
        text = ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    elif isinstance(value, float) and _underflows(repr(value), value):
        text = value.hex()  # a decimal number of that size is a text
    else:
        text = repr(value)
    return yaml.ScalarNode(STRING, text)


def _text_node(text: str, *, quoted: bool) -> yaml.Node:
    # Line breaks, the exotic ones too, survive only where the emitter escapes them: between double quotes.
    return yaml.ScalarNode(STRING, text, style='"' if quoted or not text.isprintable() else None)
