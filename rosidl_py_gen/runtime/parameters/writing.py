"""Writer of parameter files, in YAML that `files` and rcl read.

Lines are written without PyYAML's emitter, which takes one second for each MB of a long text, and recurses for each
level. Each value is on one line; scalars are plain if that is unambiguous, else in double quotes with JSON escapes.
"""

from __future__ import annotations

import base64
import json
import math
import re
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.parameters.files import PARAMETERS_KEY, plain_scalar, underflows
from rosidl_py_gen.runtime.parameters.values import ParameterType

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.runtime.parameters.values import ParameterValue

_MAX_LEVELS = 16
"""Maximum depth of maps below a node; the rest of a longer name becomes one key with dots."""
_MAX_SIMPLE_KEY = 900
"""Maximum length of a key before a colon: libyaml accepts 1024 characters. Longer keys follow a question mark."""
_MAX_REPLACED = 16
"""Number of different characters that are escaped by one `replace` each, which takes 0.1 s for 100 MB. More of them are
escaped by `translate`, which takes 0.4 µs for each character of a text that is not ASCII."""
_PLAIN = re.compile(r"[A-Za-z_/](?:[\w./+ -]{0,300}[\w./+-])?\Z", re.ASCII)
"""Text that has the same meaning with and without quotes, also in a list."""


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
    parts = name.split(".", _MAX_LEVELS)
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
    hidden = {char for char in set(quoted) if not char.isprintable()}
    escapes = {char: f"\\u{ord(char):04x}" if char < "\U00010000" else f"\\U{ord(char):08x}" for char in hidden}
    if len(hidden) > _MAX_REPLACED:
        return quoted.translate({ord(char): escape for char, escape in escapes.items()})
    for char, escape in escapes.items():
        quoted = quoted.replace(char, escape)
    return quoted
