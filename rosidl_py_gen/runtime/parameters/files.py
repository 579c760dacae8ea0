"""Reader of parameter files, in the YAML dialect of rcl.

Scalars differ from YAML: `y` is true, `010` is 8, `08` is 8.0 and `null` is a string. So YAML only separates plain from
quoted scalars, and `plain_scalar` converts the plain ones. Scalars that are quoted or tagged ``!!str`` are strings;
other tags and anchors are ignored (``!!int yes`` is true), and block scalars count as plain, as in `get_value` of
rcl_yaml_param_parser's parse.c. With Lyrical and later, ``!!bool``, ``!!int`` and ``!!float`` decide about the type.
Source: docs/internals/protocol.md 10.5.
"""

from __future__ import annotations

import base64
import math
import re
import sys
from typing import TYPE_CHECKING, NoReturn

from rosidl_py_gen.base.distributions import is_selected_since
from rosidl_py_gen.base.resources import missing_extra_message
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
    raise missing_extra_message(missing) or missing from None

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PARAMETERS_KEY = "ros__parameters"
_BINARY = "tag:yaml.org,2002:binary"
_TYPE_TAGS = {
    "tag:yaml.org,2002:bool": ParameterType.BOOL,
    "tag:yaml.org,2002:int": ParameterType.INTEGER,
    "tag:yaml.org,2002:float": ParameterType.DOUBLE,
}
"""Tags that have an effect since Lyrical."""
_MAX_LEVELS = 500
"""Maximum depth of maps, which names of nodes and parameters may form; rcl has no limit."""
_MAX_BYTES = 1 << 28
"""Maximum size of a parameter file: `writing.dump_parameters` may write large texts, such as maps."""
_TRUE = frozenset(["y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_INTEGER = re.compile(r"[+-]?(?:(?P<hex>0[xX][0-9a-fA-F]+)|(?P<octal>0[0-7]*)|(?P<decimal>[1-9][0-9]*))\Z")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\Z")
_HEX_FLOAT = re.compile(r"[+-]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?\Z")
_NAN = re.compile(r"(?:\.nan|\.NaN|\.NAN|[+-]?[nN][aA][nN])\Z")
_INFINITE = re.compile(r"(?P<sign>[+-]?)(?:\.inf|\.Inf|\.INF|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?)\Z")


# ----------------------------------------------------------------------------------------------------------- scalars


def plain_scalar(text: str) -> ParameterValue:
    """Return the value of an unquoted scalar; raises `InvalidParameterValueError` for an empty one."""
    if not text:
        raise InvalidParameterValueError("empty value; write '' for an empty string")
    if text in _TRUE or text in _FALSE:
        return ParameterValue(ParameterType.BOOL, text in _TRUE)
    integer = _INTEGER.match(text)
    if integer and (integer["decimal"] is None or len(text) <= 70):  # CPython refuses thousands of decimal digits
        number = int(text, 16 if integer["hex"] else 8 if integer["octal"] else 10)
        if INT64_MIN <= number <= INT64_MAX:
            return ParameterValue(ParameterType.INTEGER, number)
    real = _float(text)
    if real is not None:
        return ParameterValue(ParameterType.DOUBLE, real)
    return ParameterValue(ParameterType.STRING, text)


def _float(text: str) -> float | None:
    """Convert like strtod, plus ``.nan`` and ``.inf``; None if the text is not a number, or out of range."""
    infinite = _INFINITE.match(text)
    if infinite:
        return -math.inf if infinite["sign"] == "-" else math.inf
    if _NAN.match(text):
        return math.nan
    try:
        value = float(text) if _FLOAT.match(text) else float.fromhex(text) if _HEX_FLOAT.match(text) else None
    except OverflowError:
        return None
    return None if value is None or math.isinf(value) or underflows(text, value) else value


def underflows(text: str, value: float) -> bool:
    """Return True if glibc's strtod reports ERANGE for a tiny number, so that rcl reads it as a string.

    That happens if digits are lost: for ``1e-310`` and ``1e-400``, not for ``0e-400``. A hexadecimal number counts as
    exact unless it becomes zero.
    """
    is_hex = "x" in text.lower()
    digits = text.lower().partition("p" if is_hex else "e")[0].strip("+-0x.")
    return digits != "" and (value == 0.0 or (abs(value) < sys.float_info.min and not is_hex))


# ----------------------------------------------------------------------------------------------------------- reading


def parse_parameter_file(text: str, name: str = "<text>") -> list[ParameterOverrides]:
    """Parse a parameter file; `name` is its name in errors. Raises `ParameterFileError` with line and column."""
    root = _compose(text, name)
    if root is None:
        return []
    if not isinstance(root, yaml.MappingNode):
        _fail(name, root, "expected node names with parameters below them")
    return list(_nodes(name, root, ""))


def read_parameter_file(path: Path) -> list[ParameterOverrides]:
    """Read and parse a parameter file.

    Raises:
        ParameterFileError: it is not UTF-8, or not a parameter file.
        OSError: it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ParameterFileError(f"{path}: expected UTF-8, found the byte {error.object[error.start]:#04x}") from None
    return parse_parameter_file(text, str(path))


def parse_parameter_value(text: str) -> ParameterValue:
    """Parse the value of a ``-p name:=value`` argument, a scalar or a list; raises `ParameterFileError`."""
    node = _compose(text, "<value>")
    if node is None:
        raise ParameterFileError("<value>: empty value; for an empty string write \"''\" in a shell")
    return _value("<value>", node)


def _compose(text: str, name: str) -> yaml.Node | None:
    try:
        return compose_yaml(text, max_bytes=_MAX_BYTES, max_levels=_MAX_LEVELS, anchors=True)
    except YamlError as error:
        raise ParameterFileError(error.at(name)) from None


def _fail(name: str, node: yaml.Node, text: str) -> NoReturn:
    mark = node.start_mark
    raise ParameterFileError(f"{name}:{mark.line + 1}:{mark.column + 1}: {text}")


def _items(name: str, node: yaml.MappingNode) -> Iterator[tuple[str, yaml.Node]]:
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            _fail(name, key, "a key must be a string")
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
            return _bytes(node) or _scalar(node)
        if not isinstance(node, yaml.SequenceNode):
            _fail(name, node, "expected a value or a list, found a map")
        for item in node.value:
            if not isinstance(item, yaml.ScalarNode):
                _fail(name, item, "a list must contain scalars only")
        return parameter_value([_scalar(item).value for item in node.value])
    except InvalidParameterValueError as error:
        _fail(name, node, str(error))


def _scalar(node: yaml.ScalarNode) -> ParameterValue:
    if node.tag in _TYPE_TAGS and is_selected_since("lyrical"):
        return _tagged_scalar(node.value, _TYPE_TAGS[node.tag])
    if node.tag == STRING or node.style in ("'", '"'):
        return ParameterValue(ParameterType.STRING, node.value)
    return plain_scalar(node.value)


def _tagged_scalar(text: str, wanted: ParameterType) -> ParameterValue:
    value = plain_scalar(text)
    if value.type is ParameterType.INTEGER and wanted is ParameterType.DOUBLE:
        return ParameterValue(wanted, float(value.value))  # type: ignore[arg-type]  # an INTEGER is an int
    if value.type is not wanted:
        raise InvalidParameterValueError(f"the tag requires a value of type {wanted.name}, found {text!r:.100}")
    return value


def _bytes(node: yaml.ScalarNode) -> ParameterValue | None:
    """Return the value of a base64 scalar with the tag ``!!binary``, which `dump_parameters` writes, else None."""
    if node.tag != _BINARY:
        return None
    try:
        return ParameterValue(ParameterType.BYTE_ARRAY, base64.b64decode("".join(node.value.split()), validate=True))
    except ValueError:
        return None
