"""The line algorithm of .msg text (docs/internals/protocol.md 1.3): from the lines of one section to a MessageDef.

Quirks of the reference are kept on purpose: a `#` starts a comment even inside quotes, a `=` anywhere behind the type
makes the line a constant, blanks before an element are an error.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import (
    CONSTANT_RULE,
    INTERFACE_RULE,
    PACKAGE_RULE,
    did_you_mean,
    is_constant_name,
    is_field_name,
    is_interface_name,
    is_package_name,
)
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem, parse_default, parse_scalar
from rosidl_py_gen.compiler.frontend.model import ConstantDef, Diagnostics, FieldDef, Location, MessageDef, SourceText
from rosidl_py_gen.compiler.frontend.msg_line_parser import (
    ElementSyntax,
    SyntaxProblem,
    TypeSyntax,
    Word,
    parse_element,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.base.names import RosName

# What a .msg may say; the other keys of PRIMITIVES exist only in .idl files.
_MSG_PRIMITIVES = [name for name in PRIMITIVES if name not in ("idl_char", "wchar")]
_WORDS = (*_MSG_PRIMITIVES, "string", "wstring")
OTHER_WORDS = {
    "float": "float32 or float64",
    "double": "float64",
    "octet": "byte",
    "boolean": "bool",
    "str": "string",
    "int": "int32 or int64",
    "long": "int64",
    "short": "int16",
    "unsigned": "uint32",
    "uint": "uint32 or uint64",
    **{word: word for word in _WORDS},
}
"""The words of other languages, of IDL, C++ and Python, in lower case, and what is written instead."""
_UNIT = re.compile(r"(\s*\[([^,\]]+)\])")
_MAX_SIZE_DIGITS = 20
_MAX_SIZE = 2**64 - 1  # capacities are uint64 in a type description

Element = TypeVar("Element", FieldDef, ConstantDef)


@dataclass(slots=True)
class _Elements:
    """The elements of a section; the comment of the last one may still grow by indented comment lines below it."""

    fields: list[FieldDef] = field(default_factory=list)
    constants: list[ConstantDef] = field(default_factory=list)
    last: FieldDef | ConstantDef | None = None
    comment: list[str] = field(default_factory=list)

    def begin(self, element: FieldDef | ConstantDef, comment: list[str]) -> None:
        self.finish()
        self.last, self.comment = element, comment

    def finish(self) -> None:
        comment, unit = _tidy(self.comment) if self.comment else ((), "")
        if isinstance(self.last, FieldDef):
            self.fields.append(self.last._replace(comment=comment, unit=unit) if comment or unit else self.last)
        elif self.last is not None:
            self.constants.append(self.last._replace(comment=comment, unit=unit) if comment or unit else self.last)
        self.last = None


def parse_section(
    name: RosName, lines: Sequence[str], first_line: int, source: SourceText, findings: Diagnostics
) -> MessageDef:
    """One message body: a whole .msg, or one section of a .srv or .action.

    Args:
        name: of the message the section defines.
        lines: the section's lines.
        first_line: 1-based line of the first one in the file.
        source: for locations.
        findings: receives every problem; the result then lacks the lines that had one.
    """
    lines = [line.replace("\t", " ") for line in lines]
    count = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    head = [line.lstrip("#") for line in lines[:count]]
    done = _Elements()
    waiting: list[str] = []
    for number, line in enumerate(lines[count:], first_line + count):
        if findings.is_full(Location(source, number, 1)):
            break
        _read_line(line.rstrip(), number, name, done, waiting, source, findings)
    done.finish()
    _refuse_duplicates(done.fields, findings)
    _refuse_duplicates(done.constants, findings)
    comment, _ = _tidy(head, with_unit=False)
    return MessageDef(name, tuple(done.fields), tuple(done.constants), comment, source)


def _read_line(
    line: str,
    number: int,
    name: RosName,
    done: _Elements,
    waiting: list[str],
    source: SourceText,
    findings: Diagnostics,
) -> None:
    text, mark, comment = line.partition("#")
    if mark:
        comment = comment.lstrip("#")
        if text and not text.strip():  # indented: belongs to the element above
            if done.last is not None:
                done.comment.append(comment)
            return
        waiting.append(comment)
    text = text.rstrip()
    if not text:
        return
    try:
        element = _element(parse_element(text, number), name, source)
    except (_MsgError, SyntaxProblem) as problem:
        findings.add(Location(source, number, problem.column), _explain(text, problem))
        return
    done.begin(element, waiting[:])
    waiting.clear()


def _explain(text: str, problem: _MsgError | SyntaxProblem) -> str:
    if text[0] == " ":
        return "expected the element to begin in column 1, found blanks before it"
    if text.startswith("---"):
        return 'a separator is exactly "---", and only in .srv and .action files'
    if found := re.match(r"([^/\s]+)/(msg|srv|action)/([^/\s<\[]+)", text):
        package, kind, name = found.groups()
        own = f'write "{package}/{name}", without "msg/"' if kind == "msg" else "only messages are types of fields"
        return f'"{found[0][:80]}" is not a type in a .msg, .srv or .action file; {own}'
    if text[0] == "@":
        return "annotations exist in .idl files only"
    if (
        problem.column > 1
        and text[problem.column - 1 :].startswith("=")
        and problem.text.startswith("expected the end")
    ):
        return 'a "=" makes the line a constant, so a default value cannot contain one'
    return problem.text


class _MsgError(Exception):
    def __init__(self, word: Word, text: str) -> None:
        self.column = word.column
        self.text = text
        super().__init__(text)


def _element(syntax: ElementSyntax, name: RosName, source: SourceText) -> FieldDef | ConstantDef:
    kind = _type(syntax.type, name)
    location = Location(source, syntax.name.line, syntax.name.column)
    if syntax.is_constant:
        if kind.is_message or kind.arity is not Arity.SCALAR or kind.string_bound:
            raise _MsgError(syntax.type.name, f'expected a primitive type or string for a constant, found "{kind}"')
        if not is_constant_name(syntax.name.text):
            raise _MsgError(syntax.name, f'"{syntax.name.text}" is not a constant name; expected {CONSTANT_RULE}')
        value = syntax.value or Word("", syntax.name.line, syntax.name.column)
        try:
            return ConstantDef(syntax.name.text, kind, parse_scalar(kind, value.text), (), "", location)
        except LiteralProblem as problem:
            raise _MsgError(value, str(problem)) from None
    if not is_field_name(syntax.name.text):
        raise _MsgError(syntax.name, f'"{syntax.name.text}" is not a field name; expected {PACKAGE_RULE}')
    try:
        default = parse_default(kind, syntax.value.text) if syntax.value else None
    except LiteralProblem as problem:
        raise _MsgError(syntax.value or syntax.name, str(problem)) from None
    return FieldDef(syntax.name.text, kind, default, (), "", location)


def _type(syntax: TypeSyntax, name: RosName) -> FieldType:
    base = _base(syntax, name)
    bound = _size(syntax.bound) if syntax.bound else 0
    if bound and base not in ("string", "wstring"):
        assert syntax.bound is not None
        raise _MsgError(syntax.bound, f'only string and wstring take a bound, not "{base}"')
    match syntax.array:
        case None:
            return _field_type(base, Arity.SCALAR, 0, bound)
        case "unbounded":
            return _field_type(base, Arity.UNBOUNDED, 0, bound)
        case array:
            assert syntax.size is not None
            arity = Arity.ARRAY if array == "fixed" else Arity.BOUNDED
            return _field_type(base, arity, _size(syntax.size), bound)


_shared_type = lru_cache(maxsize=512)(FieldType)


def _field_type(base: str, arity: Arity, capacity: int, bound: int) -> FieldType:
    """Thousands of fields have few types; names of absurd length are not cached."""
    return (_shared_type if len(base) < 100 else FieldType)(base, arity, capacity, bound)


def _base(syntax: TypeSyntax, name: RosName) -> str:
    text = syntax.name.text
    if syntax.package is None and text in _WORDS:
        return text
    if syntax.package is None and text in ("time", "duration"):
        raise _MsgError(syntax.name, f'"{text}" is a ROS 1 type; use builtin_interfaces/{text.capitalize()}')
    if not is_interface_name(text):
        other = OTHER_WORDS.get(text.lower()) if syntax.package is None else None
        hint = f"; use {other}" if other else did_you_mean(text, _WORDS) if syntax.package is None else ""
        raise _MsgError(
            syntax.name, f'"{text}" is neither a primitive type nor a message name ({INTERFACE_RULE}){hint}'
        )
    if syntax.package is None:
        return f"{name.package}/msg/{text}"
    if not is_package_name(syntax.package.text):
        raise _MsgError(syntax.package, f'"{syntax.package.text}" is not a package name; expected {PACKAGE_RULE}')
    return f"{syntax.package.text}/msg/{text}"


def _size(word: Word) -> int:
    size = -1
    if len(word.text) <= _MAX_SIZE_DIGITS:
        try:
            size = int(word.text)
        except ValueError:
            size = -1
    if not 0 < size <= _MAX_SIZE:
        raise _MsgError(word, f'expected a whole number above 0, found "{word.text[:40]}"')
    return size


def _refuse_duplicates(elements: Sequence[FieldDef | ConstantDef], findings: Diagnostics) -> None:
    seen: dict[str, Location] = {}
    for element in elements:
        first = seen.setdefault(element.name, element.location)
        if first is not element.location:
            findings.add(element.location, f'"{element.name}" is already defined in line {first.line}')


def _tidy(lines: list[str], with_unit: bool = True) -> tuple[tuple[str, ...], str]:
    """Cut the unit out, drop blank lines at both ends and runs of them, and dedent."""
    unit = ""
    if with_unit:
        found = _UNIT.findall("\n".join(lines))
        if len(found) == 1:
            unit = found[0][1].strip()
            lines = [line.replace(found[0][0], "") for line in lines]
    kept: list[str] = []
    for line in lines:
        line = line.rstrip()
        if line or (kept and kept[-1]):
            kept.append(line)
    while kept and not kept[-1]:
        kept.pop()
    return tuple(textwrap.dedent("\n".join(kept)).split("\n")) if kept else (), unit
