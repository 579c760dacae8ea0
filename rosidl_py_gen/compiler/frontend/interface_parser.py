"""Parser of one interface file or text, which returns a MessageDef, ServiceDef or ActionDef.

The parser splits .srv and .action files at their separators and selects the language by format; `idl_parser` reads .idl
files. Diagnostics are collected, not raised, so that a run over many files reports all of them.

The language of a field or constant in .msg notation is regular, so a table defines it: the pattern of each token, and
the tokens that may follow. Spaces separate type, name and default, so they are tokens, too. Names and values are
checked later, where an error can state the rule. Rules: docs/internals/protocol.md 1.3.

Quirks of rosidl are reproduced on purpose: a `#` starts a comment even inside quotes, a `=` anywhere after the type
makes the line a constant, blanks before an element are an error.
"""

from __future__ import annotations

import re
import textwrap
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem, parse_default, parse_scalar
from rosidl_py_gen.compiler.frontend.model import (
    SECTIONS,
    ConstantDef,
    Diagnostics,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    SourceText,
    SyntaxProblem,
    Token,
    assemble,
    is_interface_name,
    section_names,
)
from rosidl_py_gen.errors import Diagnostic

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_TYPE, _SIZE = r"[^\s/<=\[\]]+", r"[^\s<=\[\]]+"
_END = "the end"
FOREIGN_TYPES = {
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
    **{word: word for word in FieldType.MSG_BASES},
}
"""Type names of IDL, C++ and Python in lower case, each with the .msg type that an error suggests instead."""
_OPTIONAL = re.compile(r"@optional +(?=[^ ])")
_UNIT = re.compile(r"(\s*\[([^,\]]+)\])")
_MAX_SIZE_DIGITS = 20
_MAX_SIZE = 2**64 - 1
"""Maximum array size or string bound in a type of a .msg file, because a type description stores it as uint64."""


class _Rule(NamedTuple):
    """Grammar rule of a token in a .msg line: its pattern, its name in errors, and the kinds of tokens that may follow.

    The patterns of the tokens that may follow exclude each other.
    """

    pattern: str
    display: str
    following: tuple[str, ...]


_RULES = {
    "start": _Rule("", "", ("type",)),
    "type": _Rule(_TYPE, "a type", ("space", "slash", "at most", "open")),
    "slash": _Rule("/", '"/"', ("member",)),
    "member": _Rule(_TYPE, "a type", ("space", "at most", "open")),
    "at most": _Rule("<=", '"<="', ("bound",)),
    "bound": _Rule(_SIZE, "a number", ("space", "open")),
    "open": _Rule(r"\[", '"["', ("close", "fixed", "limit")),
    "limit": _Rule("<=", '"<="', ("bounded",)),
    "bounded": _Rule(_SIZE, "a number", ("close",)),
    "fixed": _Rule(_SIZE, "a number", ("close",)),
    "close": _Rule(r"\]", '"]"', ("space",)),
    "space": _Rule(r" \s*", "a space", ("name",)),
    "name": _Rule(r"[^\s=]+", "a name", ("blank", "equals", _END)),
    "blank": _Rule(r" \s*", "a space", ("default", "equals")),
    "default": _Rule(r"[^\s=][^=]*", "a default value", (_END,)),
    "equals": _Rule(r"=\s*", '"="', ("value", _END)),
    "value": _Rule(r"\S.*", "a value", (_END,)),
    _END: _Rule(r"\Z", _END, ()),
}
_FOLLOWING = {
    kind: re.compile("|".join(f"({_RULES[one].pattern})" for one in rule.following)) for kind, rule in _RULES.items()
}
"""Regular expression for each token kind of a .msg line, with one group for each token that may follow this kind."""


def parse_element(text: str, line: int, start: int = 0) -> dict[str, Token]:
    """Return the tokens of a .msg line that defines a field or constant, by token kind; raises `SyntaxProblem`.

    A type with a package has the package as ``type`` and the name as ``member``. A constant has ``equals``, and
    ``value`` unless the value is empty.
    """
    tokens: dict[str, Token] = {}
    kind, position = "start", start
    while kind != _END:
        match = _FOLLOWING[kind].match(text, position)
        if match is None or match.lastindex is None:
            raise _problem(kind, text, line, position)
        kind = _RULES[kind].following[match.lastindex - 1]
        tokens[kind] = Token(match[0], line, position + 1)
        position = match.end()
    return tokens


def _problem(kind: str, text: str, line: int, position: int) -> SyntaxProblem:
    following = _RULES[kind].following
    expected = " or ".join(sorted({_RULES[one].display for one in following}))
    if position < len(text):
        message = f'expected {expected}, found "{text[position]}"'
    elif "space" in following:
        message = "expected a type, a space and a name, found no name"
    else:
        message = f"expected {expected}, found the end of the line"
    return SyntaxProblem(line, position + 1, message)


def parse_section(
    name: RosName, lines: Sequence[str], first_line: int, source: SourceText, diagnostics: Diagnostics
) -> MessageDef:
    """Return the message of a .msg file, or of one section of a .srv or .action file; lines with errors are skipped.

    The errors are added to `diagnostics`. `first_line` is the 1-based number of the first line in the file.
    """
    lines = [line.replace("\t", " ") for line in lines]
    count = next((index for index, line in enumerate(lines) if not line.startswith("#")), len(lines))
    section = _Section(name, source, diagnostics)
    for number, line in enumerate(lines[count:], first_line + count):
        if diagnostics.is_full(Location(source, number, 1)):
            break
        section.read_line(line.rstrip(), number)
    section.finish_element()
    _check_duplicates(section.fields, diagnostics)
    _check_duplicates(section.constants, diagnostics)
    comment = _tidy([line.lstrip("#") for line in lines[:count]])
    return MessageDef(name, tuple(section.fields), tuple(section.constants), comment, source)


class _Section:
    """Fields and constants of a message section while it is parsed.

    Indented comment lines after a field extend its comment.
    """

    def __init__(self, name: RosName, source: SourceText, diagnostics: Diagnostics) -> None:
        self._name, self._source, self._diagnostics = name, source, diagnostics
        self.fields: list[FieldDef] = []
        self.constants: list[ConstantDef] = []
        self._last: FieldDef | ConstantDef | None = None
        self._last_comment: list[str] = []
        self._next_comment: list[str] = []

    def read_line(self, line: str, number: int) -> None:
        text, mark, comment = line.partition("#")
        if mark and text and not text.strip():  # an indented comment
            if self._last is not None:
                self._last_comment.append(comment.lstrip("#"))
            return
        if mark:
            self._next_comment.append(comment.lstrip("#"))
        text = text.rstrip()
        if not text:
            return
        # A field with this annotation is an ordinary one on the wire and for the hash (docs/internals/protocol.md 1.3).
        annotation = _OPTIONAL.match(text)
        try:
            element = self._element(parse_element(text, number, annotation.end() if annotation else 0))
            if annotation and isinstance(element, ConstantDef):
                raise SyntaxProblem(number, 1, "a constant is never @optional; the annotation belongs to fields")
        except SyntaxProblem as problem:
            self._diagnostics.add(Location(self._source, number, problem.column), _explain(text, problem))
            return
        self.finish_element()
        self._last, self._last_comment, self._next_comment = element, self._next_comment, []

    def finish_element(self) -> None:
        element, self._last = self._last, None
        if element is None:
            return
        if self._last_comment:
            lines, unit = _cut_unit(self._last_comment)
            element = element._replace(comment=_tidy(lines), unit=unit)
        if isinstance(element, FieldDef):
            self.fields.append(element)
        else:
            self.constants.append(element)

    def _element(self, tokens: dict[str, Token]) -> FieldDef | ConstantDef:
        kind = _field_type(tokens, self._name.package)
        name = tokens["name"]
        location = Location(self._source, name.line, name.column)
        if "equals" in tokens:
            if kind.is_message or kind.arity is not Arity.SCALAR or kind.string_bound:
                token = tokens.get("member", tokens["type"])
                raise token.problem(f'expected a primitive type or string for a constant, found "{kind}"')
            if not RosName.CONSTANT_RULE.allows(name.text):
                raise name.problem(f'"{name.text}" is not a constant name; expected {RosName.CONSTANT_RULE}')
        elif not RosName.FIELD_RULE.allows(name.text):
            raise name.problem(f'"{name.text}" is not a field name; expected {RosName.FIELD_RULE}')
        value = tokens.get("value", tokens.get("default"))
        try:
            if "equals" in tokens:
                return ConstantDef(name.text, kind, parse_scalar(kind, value.text if value else ""), (), "", location)
            return FieldDef(name.text, kind, parse_default(kind, value.text) if value else None, (), "", location)
        except LiteralProblem as problem:
            raise (value or name).problem(str(problem)) from None


def _explain(text: str, problem: SyntaxProblem) -> str:
    if text[0] == " ":
        return "expected the element to begin in column 1, found blanks before it"
    if text.startswith("---"):
        return 'a separator is exactly "---", and only in .srv and .action files'
    if match := re.match(r"([^/\s]+)/(msg|srv|action)/([^/\s<\[]+)", text):
        package, kind, name = match.groups()
        fix = f'write "{package}/{name}", without "msg/"' if kind == "msg" else "only messages are types of fields"
        return f'"{match[0][:80]}" is not a type in a .msg, .srv or .action file; {fix}'
    if text[0] == "@" and not _OPTIONAL.match(text):
        return (
            'other annotations than "@optional", in the line of a field and before its type, exist in .idl files only'
        )
    is_second_equals = problem.column > 1 and text[problem.column - 1 :].startswith("=")
    if is_second_equals and problem.text.startswith("expected the end"):
        return 'a "=" makes the line a constant, so a default value cannot contain one'
    return problem.text


def _field_type(tokens: dict[str, Token], package: str) -> FieldType:
    base = _base(tokens, package)
    bound = _size(tokens["bound"]) if "bound" in tokens else 0
    if bound and base not in ("string", "wstring"):
        raise tokens["bound"].problem(f'only string and wstring take a bound, not "{base}"')
    arity, capacity = Arity.SCALAR, 0
    if "fixed" in tokens:
        arity, capacity = Arity.ARRAY, _size(tokens["fixed"])
    elif "bounded" in tokens:
        arity, capacity = Arity.BOUNDED, _size(tokens["bounded"])
    elif "open" in tokens:
        arity = Arity.UNBOUNDED
    # Thousands of fields have few types; types with names of absurd length are not cached.
    return (_cached_type if len(base) < 100 else FieldType)(base, arity, capacity, bound)


_cached_type = lru_cache(maxsize=512)(FieldType)


def _base(tokens: dict[str, Token], package: str) -> str:
    token, has_package = tokens.get("member", tokens["type"]), "member" in tokens
    text = token.text
    if not has_package and text in FieldType.MSG_BASES:
        return text
    if not has_package and text in ("time", "duration"):
        raise token.problem(f'"{text}" is a ROS 1 type; use builtin_interfaces/{text.capitalize()}')
    if not is_interface_name(text):
        hint = ""
        if not has_package:
            other = FOREIGN_TYPES.get(text.lower())
            hint = f"; use {other}" if other else did_you_mean(text, FieldType.MSG_BASES)
        raise token.problem(f'"{text}" is neither a primitive type nor a message name ({RosName.NAME_RULE}){hint}')
    if has_package:
        package = tokens["type"].text
        if not RosName.PACKAGE_RULE.allows(package):
            raise tokens["type"].problem(f'"{package}" is not a package name; expected {RosName.PACKAGE_RULE}')
    return f"{package}/msg/{text}"


def _size(token: Token) -> int:
    size = -1
    if len(token.text) <= _MAX_SIZE_DIGITS:
        try:
            size = int(token.text)
        except ValueError:
            size = -1
    if not 0 < size <= _MAX_SIZE:
        raise token.problem(f'expected a whole number above 0, found "{token.text[:40]}"')
    return size


def _check_duplicates(elements: Sequence[FieldDef | ConstantDef], diagnostics: Diagnostics) -> None:
    seen: dict[str, Location] = {}
    for element in elements:
        first = seen.setdefault(element.name, element.location)
        if first is not element.location:
            diagnostics.add(element.location, f'"{element.name}" is already defined in line {first.line}')


def _cut_unit(lines: list[str]) -> tuple[list[str], str]:
    """Return the lines of a comment without the unit in brackets, and the unit.

    Returns "" unless the comment has exactly one unit.
    """
    units = _UNIT.findall("\n".join(lines))
    if len(units) != 1:
        return lines, ""
    return [line.replace(units[0][0], "") for line in lines], units[0][1].strip()


def _tidy(lines: list[str]) -> tuple[str, ...]:
    """Return the lines of a comment without common indentation, without blank lines at both ends, and without repeated
    blank lines.
    """
    tidy: list[str] = []
    for line in map(str.rstrip, lines):
        if line or (tidy and tidy[-1]):
            tidy.append(line)
    while tidy and not tidy[-1]:
        tidy.pop()
    return tuple(textwrap.dedent("\n".join(tidy)).split("\n")) if tidy else ()


_ALMOST_SEPARATOR = re.compile(r"\s*(?:[-\u2010-\u2015\u2212_=*~]\s*){2,}(?:#.*)?")
"""Pattern of a line that was probably meant as the separator ``---``: too short or too long, with blanks, with a
comment, or with other dashes."""


def read_source(path: Path, display: str, diagnostics: Diagnostics) -> SourceText | None:
    """Return the text of a definition file; None, after a diagnostic, if the file cannot be read as UTF-8."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        diagnostics.items.append(Diagnostic(display, 0, 0, f"cannot be read: {error.strerror or error}"))
        return None
    try:
        text = raw.decode()
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - (before.rfind(b"\n") + 1) + 1
        diagnostics.items.append(
            Diagnostic(display, line, column, f"expected UTF-8, found the byte {raw[error.start]:#04x}")
        )
        return None
    return SourceText(display, text.replace("\r\n", "\n").replace("\r", "\n"), path.suffix[1:])


def parse_interface(name: RosName, source: SourceText, diagnostics: Diagnostics) -> Interface | None:
    """Return the interface that a definition text defines; None, after a diagnostic, if the text cannot be used."""
    if source.text.startswith("\ufeff"):
        diagnostics.add(Location(source, 1, 1), "found a byte order mark; save the file as UTF-8 without one")
        source = source._replace(text=source.text[1:])
    if source.format == "idl":
        # The import of lark takes half as much time as all other imports of the compiler.
        from rosidl_py_gen.compiler.frontend.idl_parser import parse_idl_interface

        return parse_idl_interface(name, source, diagnostics)
    sections = _split(source.format, source, diagnostics)
    if sections is None:
        return None
    messages = [
        parse_section(own, lines, first_line, source, diagnostics)
        for own, (first_line, lines) in zip(section_names(name, source.format), sections, strict=True)
    ]
    return assemble(name, messages, source)


def may_be_file(name: RosName) -> bool:
    """Return True if a file may define an interface of this name: all messages in the file must have valid names."""
    return all(is_interface_name(section.name) for section in section_names(name, name.kind))


def separators(text: str) -> int:
    """Return the number of separator lines (``---``) in a .srv or .action text."""
    return sum(line == "---" for line in text.splitlines())


def _split(kind: str, source: SourceText, diagnostics: Diagnostics) -> list[tuple[int, list[str]]] | None:
    lines = source.text.splitlines()
    cuts = [i for i, line in enumerate(lines) if line == "---"] if kind != "msg" else []
    wanted = len(SECTIONS[kind]) - 1
    if len(cuts) != wanted:
        place = cuts[wanted] + 1 if len(cuts) > wanted else max(1, len(lines))
        near = next((i for i, line in enumerate(lines) if line != "---" and _ALMOST_SEPARATOR.fullmatch(line)), -1)
        noun = 'line "---"' if wanted == 1 else 'lines "---"'
        text = f"expected {wanted} {noun} in a .{kind} file, found {len(cuts)}"
        if near >= 0 and len(cuts) < wanted:
            place = near + 1
            text = f'expected the separator "---" alone in its line, found "{lines[near][:40]}"; {text}'
        diagnostics.add(Location(source, place, 1), text)
        return None
    bounds = [-1, *cuts, len(lines)]
    return [(start + 2, lines[start + 1 : end]) for start, end in pairwise(bounds)]
