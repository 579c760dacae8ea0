"""Python text from the definitions: literals, docstrings and comments, and the names inside a generated module.

Definition files are untrusted: all of their text that reaches generated code passes through this module and becomes a
literal of a plain type, text inside a docstring, or a valid name. Literals are spelled as `ruff format` spells them.

Fields, constants and classes have the names of the definition. In a conflict, an import gets a leading underscore and a
local variable a trailing underscore, so a field may be called `np`, `int`, `field` or `classmethod`.
"""

from __future__ import annotations

import builtins
import keyword
import math
import re
import textwrap
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import count

from rosidl_py_gen.cdr import support
from rosidl_py_gen.cdr.rclpy_messages import arrays as rclpy_arrays

_SHORT = {"\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}


def py_literal(value: bool | int | float | str) -> str:
    """Return Python source that evaluates to the scalar, as an object of the same type."""
    if isinstance(value, str):
        return py_string(value)
    if isinstance(value, float):
        if math.isnan(value):
            return 'float("nan")'
        if math.isinf(value):
            return 'float("inf")' if value > 0 else 'float("-inf")'
        return repr(value).replace("e+", "e")
    return repr(value)


def py_string(text: str) -> str:
    """Return text as a Python string literal: double quotes unless they need more escapes, unprintables escaped."""
    quote = "'" if text.count('"') > text.count("'") else '"'
    if text.isascii() and text.isprintable():
        return quote + text.replace("\\", "\\\\").replace(quote, "\\" + quote) + quote
    return quote + "".join(_character(char, quote) for char in text) + quote


def _character(char: str, quote: str) -> str:
    if char == quote:
        return "\\" + char
    if char in _SHORT:
        return _SHORT[char]
    if char.isprintable() and unicodedata.category(char) != "Cf":
        return char
    code = ord(char)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def docstring(lines: Iterable[str], indent: str) -> str:
    """Return a docstring with its quotes; all lines but the first are indented by `indent`."""
    safe = [_doc_line(line) for line in lines]
    while safe and not safe[0]:
        safe.pop(0)
    while safe and not safe[-1]:
        safe.pop()
    if not safe:
        return '""""""'
    safe[0] = safe[0].lstrip()
    if safe[0].startswith('"'):  # as formatters do for four quotes in a row
        safe[0] = " " + safe[0]
    if len(safe) == 1:
        open_quote = safe[0].endswith('"') and not safe[0].endswith('\\"\\"\\"')  # the second is escaped
        end = " " if open_quote else ""
        return f'"""{safe[0]}{end}"""'
    rest = textwrap.dedent("\n".join(safe[1:])).split("\n")  # formatters put the least indented line at the margin
    body = "\n".join(indent + line if line else "" for line in rest)
    return f'"""{safe[0]}\n{body}\n{indent}"""'


def visible(lines: tuple[str, ...]) -> tuple[str, ...]:
    """Return the docstring lines unchanged, or an empty tuple if nothing in them would be visible."""
    return lines if any(_doc_line(line) for line in lines) else ()


def _doc_line(line: str) -> str:
    """Return a line of text in a form that is safe in a docstring: it cannot end the docstring, start an escape, or
    hide characters.
    """
    line = line.expandtabs(4).rstrip().replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    if not line.isprintable():
        line = "".join(char if char.isprintable() else " " for char in line).rstrip()
    return line


_METHOD_NAMES = {
    *("append", "arrays", "cls", "copy", "data", "dataclass", "end", "error", "field", "head", "message", "np"),
    *("parts", "pos", "raw", "self", "view", "decode_slow", "encode_slow"),
    *(name for name in vars(support) if not name.startswith("_")),
    *support.NUMPY_NAMES,
    *(name for name in vars(rclpy_arrays) if "_" in name.strip("_")),
}
"""Names of globals, parameters and fixed variables in generated methods, which other local variables must not hide."""
_MAX_LOCAL_NAME = 28
"""Maximum length of the name of a local variable in generated code, which keeps lines short."""


@dataclass(slots=True)
class Imports:
    """Import statements of a generated module, with the alias of each name.

    Attributes:
        classes: names of the classes that the generated module defines.
        members: names of their fields and constants, which hide module names inside a class body but not in methods.
    """

    classes: frozenset[str]
    members: frozenset[str]
    runtime: dict[str, dict[str, str]] = field(default_factory=dict)
    typing: dict[str, dict[str, str]] = field(default_factory=dict)
    _aliases: set[str] = field(default_factory=set)

    def use(self, module: str, name: str, *, for_typing: bool = False, in_class: bool = True) -> str:
        """Import a name of a module, or the module itself if the name is empty, and return the alias in generated code.

        Args:
            for_typing: only type checkers need the name.
            in_class: a class body mentions the name, not only methods.
        """
        for table in (self.runtime, self.typing):
            known = table.get(module, {}).get(name)
            if known is not None and (for_typing or table is self.runtime):
                return known
        used = (self._aliases, self.classes, self.members if in_class else ())
        alias = next(one for one in self._candidates(module, name) if not any(one in names for names in used))
        (self.typing if for_typing else self.runtime).setdefault(module, {})[name] = alias
        self._aliases.add(alias)
        return alias

    def builtin(self, name: str) -> str:
        """Return the name by which generated code can call a builtin: an alias if a field or class has the builtin's
        name.
        """
        return name if name not in self.members and name not in self.classes else self.use("builtins", name)

    @staticmethod
    def _candidates(module: str, name: str) -> Iterable[str]:
        name = name or ("np" if module == "numpy" else module)
        yield name
        yield "_" + name
        yield "_" + module.replace(".", "_").strip("_") + "_" + name
        yield from (f"_{name}_{number}" for number in count(2))

    def lines(self, *, for_typing: bool = False) -> list[str]:
        """Return the import statements of the module, sorted; with `for_typing`, only imports that type
        checkers need.
        """
        result = []
        for module, names in sorted((self.typing if for_typing else self.runtime).items()):
            if "" in names:
                result.append(f"import {module} as {names['']}")
            imported = sorted((name, alias) for name, alias in names.items() if name)
            if words := ", ".join(name if name == alias else f"{name} as {alias}" for name, alias in imported):
                result.append(f"from {module} import {words}")
        return result


def sort_key(word: str) -> tuple[int, list[tuple[int, str]], str]:
    """Return the key by which ruff sorts the names of `__all__`: constants, classes, other names.

    Numbers inside names by value.
    """
    name = word.split(" ")[0]
    rank = 0 if name.isupper() and len(name) > 1 else 1 if name[:1].isupper() else 2
    pieces = [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in re.split(r"(\d+)", name) if piece]
    return rank, pieces, name


class Locals:
    """Local variable names in use in one generated method."""

    def __init__(self) -> None:
        self._used = set(_METHOD_NAMES)
        self._numbers: dict[str, int] = {}  # the next number of each name: names that are cut are often the same

    def name(self, wanted: str) -> str:
        """Return an unused local variable name: `wanted`, or `wanted` with an underscore or number appended."""
        wanted = wanted[:_MAX_LOCAL_NAME].rstrip("_") or "value"
        candidate = wanted
        number = self._numbers.get(wanted, 2)
        while candidate in self._used or keyword.iskeyword(candidate) or hasattr(builtins, candidate):
            candidate = wanted.rstrip("_") + "_" if number == 2 else f"{wanted.rstrip('_')}_{number - 1}"
            number += 1
        self._numbers[wanted] = number
        self._used.add(candidate)
        return candidate


def singular(name: str) -> str:
    """Return a variable name for one element of the field `name`: poses -> pose, data -> data_item."""
    return name[:-1] if len(name) > 2 and name.endswith("s") and not name.endswith("ss") else name + "_item"
