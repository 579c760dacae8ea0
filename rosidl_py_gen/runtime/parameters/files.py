"""Reader and writer of parameter files, in the YAML dialect of rcl.

Scalars differ from YAML: `y` is true, `010` is 8, `08` is 8.0 and `null` is a string. So YAML only separates plain from
quoted scalars, and `plain_scalar` converts the plain ones. Scalars that are quoted or tagged ``!!str`` are strings;
other tags and anchors are ignored (``!!int yes`` is true), and block scalars count as plain, as in `get_value` of
parse.c of rcl_yaml_param_parser. With Lyrical and later, ``!!bool``, ``!!int`` and ``!!float`` decide about the type.

Lines are written without the emitter of PyYAML, which takes one second for each MB of a long text, and recurses for
each level. Each value is on one line; scalars are plain if that is unambiguous, else in double quotes with JSON
escapes. Source: docs/internals/protocol.md 10.5.
"""

from __future__ import annotations

import base64
import json
import math
import re
import sys
from typing import TYPE_CHECKING, NoReturn

from rosidl_py_gen.base.distributions import is_selected_since
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.base.yaml_text import STRING, YamlError, compose_yaml
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, ParameterOverrides
from rosidl_py_gen.runtime.parameters.values import (
    INT64_MAX,
    INT64_MIN,
    InvalidParameterValueError,
    ParameterType,
    ParameterValue,
    parameter_value,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

try:
    import yaml
except ModuleNotFoundError as missing:
    raise missing_extra_message(missing) or missing from None


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
"""Maximum size of a parameter file: `dump_parameters` may write large texts, such as maps."""
_TRUE = frozenset(["y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_INTEGER = re.compile(r"[+-]?(?:(?P<hex>0[xX][0-9a-fA-F]+)|(?P<octal>0[0-7]*)|(?P<decimal>[1-9][0-9]*))\Z")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\Z")
_HEX_FLOAT = re.compile(r"[+-]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?\Z")
_NAN = re.compile(r"(?:\.nan|\.NaN|\.NAN|[+-]?[nN][aA][nN])\Z")
_INFINITE = re.compile(r"(?P<sign>[+-]?)(?:\.inf|\.Inf|\.INF|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?)\Z")
_MAX_WRITTEN_LEVELS = 16
"""Maximum depth of maps below a node; the rest of a longer name becomes one key with dots."""
_MAX_SIMPLE_KEY = 900
"""Maximum length of a key before a colon: libyaml accepts 1024 characters. Longer keys follow a question mark."""
_PLAIN = re.compile(r"[A-Za-z_/](?:[\w./+ -]{0,300}[\w./+-])?\Z", re.ASCII)
"""Text that has the same meaning with and without quotes, also in a list."""


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
    """Read and parse a parameter file; raises `ParameterFileError`, also if it is not UTF-8, and `OSError`."""
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


def dump_parameters(fully_qualified_name: str, values: Mapping[str, ParameterValue]) -> str:
    """Return the text of a parameter file for one node, which contains all parameters that have a value.

    Byte arrays are written as ``!!binary``, which only this package reads; rcl has no form for them. The type of an
    empty list is lost; its declaration restores it.
    """
    tree: dict[str, object] = {}
    for name, value in values.items():
        if value.is_set:
            *groups, key = _path(name, values)
            branch = tree
            for group in groups:
                branch = branch.setdefault(group, {})  # type: ignore[assignment]
            branch[key] = _value_text(value)
    lines = [f"{_key(fully_qualified_name, '')}", f"  {PARAMETERS_KEY}:", *_lines(tree, "    ")]
    if not tree:
        lines[-1] += " {}"
    return "\n".join(lines) + "\n"


def _path(name: str, values: Mapping[str, ParameterValue]) -> list[str]:
    """Split a name at its dots, up to a group whose name is also a parameter's."""
    parts = name.split(".", _MAX_WRITTEN_LEVELS)
    prefix = ""
    for index, part in enumerate(parts[:-1]):
        prefix += part
        if prefix in values:
            return [*parts[:index], ".".join(parts[index:])]
        prefix += "."
    return parts


def _lines(tree: dict[str, object], indent: str) -> Iterator[str]:
    for name, item in tree.items():
        key = _key(name, indent)
        if isinstance(item, dict):
            yield key
            yield from _lines(item, f"{indent}  ")
        else:
            yield f"{key} {item}"


def _key(name: str, indent: str) -> str:
    text = name if _PLAIN.match(name) or name.isdigit() else _quoted(name)
    return f"{indent}{text}:" if len(text) <= _MAX_SIMPLE_KEY else f"{indent}? {text}\n{indent}:"


def _value_text(value: ParameterValue) -> str:
    content = value.value
    if isinstance(content, bytes):
        return f'!!binary "{base64.b64encode(content).decode("ascii")}"'
    if isinstance(content, tuple):
        return f"[{', '.join(map(_scalar_text, content))}]"
    assert content is not None
    return _scalar_text(content)


def _scalar_text(value: bool | int | float | str) -> str:
    if isinstance(value, str):
        is_plain = _PLAIN.match(value) and plain_scalar(value).type is ParameterType.STRING
        return value if is_plain else _quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        if not math.isfinite(value):
            return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
        if underflows(repr(value), value):
            return value.hex()  # as a decimal number it would be read as a string
    return repr(value)


def _quoted(text: str) -> str:
    """Return the text in double quotes, with escapes for all characters that are not printable."""
    quoted = json.dumps(text, ensure_ascii=False)
    if quoted.isprintable():
        return quoted
    hidden = "".join(char for char in set(quoted) if not char.isprintable())

    def escape(match: re.Match[str]) -> str:
        char = match.group()
        return f"\\u{ord(char):04x}" if char < "\U00010000" else f"\\U{ord(char):08x}"

    return re.sub(f"[{re.escape(hidden)}]", escape, quoted)
