"""Parser of .idl files: from text to syntax trees with positions, and from a syntax tree to an interface.

The grammar accepts IDL; the conversion to an interface accepts the subset that rosidl supports, which is described in
docs/internals/protocol.md 1.8. One struct is a message, two are a service, three an action. Constants of struct S
are in a module S_Constants.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lark import Lark, Transformer, v_args
from lark import Token as LarkToken
from lark.exceptions import LarkError, UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.compiler.frontend.literal_values import LiteralProblem, decode_idl_string, python_value
from rosidl_py_gen.compiler.frontend.model import (
    ConstantDef,
    Default,
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

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.compiler.frontend.model import Scalar

MAX_TOKENS = 250_000
"""Maximum tokens of an .idl file, not counting comments; a token can be one character, and takes 400 bytes of memory.
"""
_TOKEN_NAMES = {
    "LSQB": '"["',
    "RSQB": '"]"',
    "LBRACE": '"{"',
    "RBRACE": '"}"',
    "LPAR": '"("',
    "RPAR": '")"',
    "LESSTHAN": '"<"',
    "MORETHAN": '">"',
    "SEMICOLON": '";"',
    "COMMA": '","',
    "EQUAL": '"="',
    "AT": '"@"',
    "__ANON_0": '"::"',
    "IDENT": "a name",
    "BASE_WORD": "a basic type",
    "STRING_WORD": '"string"',
    "STRING": "a string",
    "WIDE_STRING": "a wide string",
    "NUMBER": "a number",
    "BOOLEAN": "TRUE or FALSE",
    "SIGN": "a sign",
    "$END": "the end",
}
"""Terminals of the IDL grammar with their names in error texts."""
_UNSUPPORTED = {
    **{word: f"{word}s are" for word in ("union", "bitmask", "bitset", "interface", "valuetype", "exception", "map")},
    **{word: f'"{word}" is' for word in ("fixed", "any", "native", "typename", "wchar_t")},
    ":": "inheritance is",
    **dict.fromkeys("+*/%|&^~", "constant expressions are"),
    **dict.fromkeys(("<<", ">>"), "constant expressions are"),
}
"""IDL features that rosidl does not support, by the token that begins them."""


@dataclass(frozen=True, slots=True)
class IdlExpression:
    """Literal or name in an .idl file.

    Attributes:
        kind: number, boolean, string, wide_string or name.
        text: the text; adjacent string literals are joined.
    """

    kind: str
    text: str
    at: Token = field(compare=False)


@dataclass(frozen=True, slots=True)
class IdlType:
    """Type that an .idl file states for a field or typedef.

    Attributes:
        kind: base, string, sequence or name.
        words: keywords of a base type or string, or modules and name of a named type.
        element: element type of a sequence.
        size: bound of a string or sequence.
    """

    kind: str
    words: tuple[str, ...]
    element: IdlType | None
    size: IdlExpression | None
    at: Token = field(compare=False)


class IdlAnnotation(NamedTuple):
    name: str
    value: IdlExpression | None
    arguments: dict[str, IdlExpression]


class IdlDeclarator(NamedTuple):
    name: Token
    sizes: tuple[IdlExpression, ...]


class IdlMember(NamedTuple):
    annotations: tuple[IdlAnnotation, ...]
    type: IdlType
    declarators: tuple[IdlDeclarator, ...]


class IdlStruct(NamedTuple):
    annotations: tuple[IdlAnnotation, ...]
    name: Token
    members: tuple[IdlMember, ...]


class IdlConst(NamedTuple):
    annotations: tuple[IdlAnnotation, ...]
    type: IdlType
    name: Token
    value: IdlExpression


class IdlTypedef(NamedTuple):
    type: IdlType
    declarator: IdlDeclarator


class IdlEnum(NamedTuple):
    name: Token


class IdlModule(NamedTuple):
    name: Token
    definitions: tuple[IdlDefinition, ...]


IdlDefinition = IdlModule | IdlStruct | IdlConst | IdlTypedef | IdlEnum


def parse_idl(text: str) -> tuple[IdlDefinition, ...]:
    """Return the definitions of the text of an .idl file.

    Raises:
        SyntaxProblem: the text breaks the grammar, or is too large.
    """
    parsing = _idl_parser().parse_interactive(text)
    last: LarkToken | None = None
    try:
        for number, last in enumerate(parsing.iter_parse(), 1):
            if number > MAX_TOKENS:
                raise SyntaxProblem(last.line or 1, last.column or 1, f"more than {MAX_TOKENS} words and signs")
        return parsing.feed_eof(last)  # type: ignore[no-any-return, no-untyped-call]
    except LarkError as error:
        if isinstance(error, UnexpectedToken):
            error.interactive_parser = parsing  # returns the tokens that would have been accepted
        raise _translate(error, text) from error


@lru_cache(maxsize=1)
def _idl_parser() -> Lark:
    # The transformer runs while parsing: a tree would take more memory than the definitions.
    grammar = Path(__file__).with_name("idl.lark").read_text(encoding="utf-8")
    words = {word for name in _BASES for word in name.split()}
    grammar = grammar.replace("(?:BASE_WORDS)", f"(?:{'|'.join(sorted(words))})")
    return Lark(grammar, parser="lalr", transformer=_Idl(), maybe_placeholders=False)


def _translate(error: LarkError, text: str) -> SyntaxProblem:
    if not isinstance(error, UnexpectedInput):
        return SyntaxProblem(1, 1, str(error).splitlines()[0])
    names: Iterable[str] = ()
    column, row = error.column, error.line
    found = "the end of the file"
    if isinstance(error, UnexpectedCharacters):
        names, found = error.allowed or (), f'"{error.char}"'
    elif isinstance(error, UnexpectedToken):
        names = error.accepts or error.expected
        if error.token.type != "$END":
            text_found = str(error.token)
            found = f'"{text_found if len(text_found) <= 40 else text_found[:37] + "..."}"'
        else:
            column = -1
    if column < 1:
        lines = text.splitlines() or [""]
        row, column = len(lines), len(lines[-1]) + 1
    unsupported = _UNSUPPORTED.get(found.strip('"').split(" ")[0], "")
    if text.splitlines()[row - 1][column - 1 :].startswith("/*"):
        return SyntaxProblem(row, column, "the comment is never closed")
    if unsupported:
        return SyntaxProblem(row, column, f"{unsupported} not supported in ROS interfaces, found {found}")
    words = sorted({_TOKEN_NAMES.get(name, f'"{name.lower()}"') for name in names if not name.startswith("__IGNORE")})
    expected = " or ".join(words) if words else "something else"
    return SyntaxProblem(row, column, f"expected {expected}, found {found}")


def _token(token: LarkToken) -> Token:
    return Token(str(token), token.line or 1, token.column or 1)


def _split(children: list[Any], kind: type) -> tuple[tuple[Any, ...], list[Any]]:
    leading = tuple(takewhile(lambda child: isinstance(child, kind), children))
    return leading, children[len(leading) :]


@v_args(inline=False)
class _Idl(Transformer[LarkToken, Any]):
    """Callbacks with which lark builds the syntax tree of an .idl file."""

    def start(self, children: list[Any]) -> tuple[IdlDefinition, ...]:
        return tuple(child for child in children if child is not None)

    def module(self, children: list[Any]) -> IdlModule:
        _, (name, *definitions) = _split(children, IdlAnnotation)
        return IdlModule(_token(name), tuple(definition for definition in definitions if definition is not None))

    def forward(self, children: list[Any]) -> None:
        return None

    def const(self, children: list[Any]) -> IdlConst:
        annotations, (kind, name, value) = _split(children, IdlAnnotation)
        return IdlConst(annotations, kind, _token(name), value)

    def typedef(self, children: list[Any]) -> IdlTypedef:
        return IdlTypedef(children[0], children[1])

    def struct(self, children: list[Any]) -> IdlStruct:
        annotations, (name, *members) = _split(children, IdlAnnotation)
        return IdlStruct(annotations, _token(name), tuple(members))

    def enum(self, children: list[Any]) -> IdlEnum:
        _, (name, *_rest) = _split(children, IdlAnnotation)
        return IdlEnum(_token(name))

    def member(self, children: list[Any]) -> IdlMember:
        annotations, (kind, *declarators) = _split(children, IdlAnnotation)
        return IdlMember(annotations, kind, tuple(declarators))

    def declarator(self, children: list[Any]) -> IdlDeclarator:
        return IdlDeclarator(_token(children[0]), tuple(children[1:]))

    def type(self, children: list[Any]) -> IdlType:
        child = children[0]
        if isinstance(child, IdlExpression):  # a scoped name
            return IdlType("name", tuple(child.text.split("::")), None, None, child.at)
        assert isinstance(child, IdlType)
        return child

    def base_type(self, children: list[Any]) -> IdlType:
        return IdlType("base", tuple(str(token) for token in children), None, None, _token(children[0]))

    def string_type(self, children: list[Any]) -> IdlType:
        size = children[1] if len(children) > 1 else None
        return IdlType("string", (str(children[0]),), None, size, _token(children[0]))

    def sequence(self, children: list[Any]) -> IdlType:
        element: IdlType = children[0]
        return IdlType("sequence", (), element, children[1] if len(children) > 1 else None, element.at)

    def annotation(self, children: list[Any]) -> IdlAnnotation:
        name: IdlExpression = children[0]
        arguments: dict[str, IdlExpression] = dict(child for child in children[1:] if isinstance(child, tuple))
        value = next((child for child in children[1:] if isinstance(child, IdlExpression)), None)
        return IdlAnnotation(name.text, value, arguments)

    def argument(self, children: list[Any]) -> tuple[str, IdlExpression]:
        return str(children[0]), children[1]

    def number(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("number", "".join(children).removeprefix("+"), _token(children[0]))

    def boolean(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("boolean", str(children[0]), _token(children[0]))

    def string(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("string", "".join(token[1:-1] for token in children), _token(children[0]))

    def wide_string(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("wide_string", "".join(token[2:-1] for token in children), _token(children[0]))

    def scoped_name(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("name", "::".join(children), _token(children[0]))


_BASES = {
    # `char` of a .msg is uint8 in IDL.
    **{primitive.idl: name for name, primitive in PRIMITIVES.items() if name != "char"},
    "short": "int16",
    "long": "int32",
    "long long": "int64",
    "unsigned short": "uint16",
    "unsigned long": "uint32",
    "unsigned long long": "uint64",
}
"""Names of primitive types by their names in .idl files."""
_MAX_TYPEDEFS = 16
"""Maximum length of a chain of typedefs, or of constants, in an .idl file, in which each refers to the next."""


@dataclass(slots=True)
class _IdlSymbolTable:
    """Declarations of an .idl file by name; each struct is stored with the names of the modules that contain it."""

    structs: list[tuple[tuple[str, ...], IdlStruct]] = field(default_factory=list)
    constants: dict[str, list[IdlConst]] = field(default_factory=dict)
    typedefs: dict[str, IdlTypedef] = field(default_factory=dict)

    def collect(self, definitions: tuple[IdlDefinition, ...], modules: tuple[str, ...]) -> None:
        for definition in definitions:
            match definition:
                case IdlModule(name, inner):
                    self.collect(inner, (*modules, name.text))
                case IdlStruct():
                    self.structs.append((modules, definition))
                case IdlConst():
                    self.constants.setdefault(modules[-1] if modules else "", []).append(definition)
                case IdlTypedef(_, declarator):
                    # rosidl_adapter repeats the typedef of an array that both sections of a service have.
                    first = self.typedefs.setdefault(declarator.name.text, definition)
                    if (first.type, first.declarator.sizes) != (definition.type, declarator.sizes):
                        raise declarator.name.problem(f'"{declarator.name.text}" is already defined differently')
                case IdlEnum(name):
                    raise name.problem("enums are not usable in ROS interfaces; use constants")

    def constant(self, name: str) -> list[IdlConst]:
        """Return the constants to which a scoped name of an .idl file may refer.

        Only the last module of the name is compared.
        """
        *path, last = name.split("::")
        every = (const for module, consts in self.constants.items() if path[-1:] in ([], [module]) for const in consts)
        return [const for const in every if const.name.text == last]


def parse_idl_interface(name: RosName, source: SourceText, diagnostics: Diagnostics) -> Interface | None:
    """Return the interface of the text of an .idl file; None, after a diagnostic, if the text has a problem."""
    try:
        scope = _IdlSymbolTable()
        scope.collect(parse_idl(source.text), ())
        for typedef in scope.typedefs.values():
            _check_typedef(typedef, scope)
        messages = _messages(name, scope, source)
    except SyntaxProblem as problem:
        diagnostics.add(Location(source, problem.line, problem.column), problem.text)
        return None
    except RecursionError:
        diagnostics.add(Location(source, 1, 1), "nested too deeply")
        return None
    return assemble(name, messages, source)


def _check_typedef(typedef: IdlTypedef, scope: _IdlSymbolTable) -> None:
    """Raise `SyntaxProblem` for a typedef of an unsupported type, even if no field uses it.

    Named types are checked where they are used.
    """
    declarator, kind = typedef.declarator, typedef.type
    for base in (kind, kind.element):
        if base is not None and base.kind == "base":
            _base(base)
    if len(declarator.sizes) > 1:
        raise declarator.name.problem("arrays of more than one dimension are not supported")
    if kind.element is not None and kind.element.kind == "sequence":
        raise kind.at.problem("sequences of sequences or arrays are not supported")
    element_size = None if kind.element is None else kind.element.size
    for size in (*declarator.sizes, kind.size, element_size):
        if size is not None:
            _positive(size, scope)


def _messages(name: RosName, scope: _IdlSymbolTable, source: SourceText) -> list[MessageDef]:
    sections = section_names(name, name.kind)
    wanted = [section.name for section in sections]
    found = [struct.name.text for _, struct in scope.structs]
    if found != wanted:
        at = scope.structs[0][1].name if scope.structs else Token("", 1, 1)
        raise at.problem(f"expected the struct{'s' * (len(wanted) > 1)} {', '.join(wanted)}, found {found or 'none'}")
    messages = []
    for section, (modules, struct) in zip(sections, scope.structs, strict=True):
        if modules != (name.package, name.kind):
            path = "::".join(modules) or "no module"
            raise struct.name.problem(f"expected {section.name} in module {name.package}::{name.kind}, found {path}")
        messages.append(_message(section, struct, scope, source))
    return messages


def _message(name: RosName, struct: IdlStruct, scope: _IdlSymbolTable, source: SourceText) -> MessageDef:
    fields: list[FieldDef] = []
    for member in struct.members:
        for declarator in member.declarators:
            kind = _declared(member.type, declarator, scope, name)
            at = Location(source, declarator.name.line, declarator.name.column)
            default = _default(member.annotations, kind, scope, declarator)
            comment, unit = _texts(member.annotations)
            fields.append(FieldDef(declarator.name.text, kind, default, comment, unit, at))
    constants = [_constant(const, scope, source) for const in scope.constants.get(struct.name.text + "_Constants", [])]
    _refuse_clashes([*fields, *constants])
    if [(item.name, str(item.type)) for item in fields] == [("structure_needs_at_least_one_member", "uint8")]:
        fields = []  # an empty message
    return MessageDef(name, tuple(fields), tuple(constants), _texts(struct.annotations)[0], source)


def _refuse_clashes(elements: list[FieldDef | ConstantDef]) -> None:
    seen: set[str] = set()
    for element in elements:
        spelling = py_name(element.name)
        if spelling in seen:
            at = Token(element.name, element.location.line, element.location.column)
            raise at.problem(f'"{element.name}" clashes with another member or constant')
        seen.add(spelling)


def _declared(
    kind: IdlType, declarator: IdlDeclarator, scope: _IdlSymbolTable, name: RosName, depth: int = 0
) -> FieldType:
    result = _type(kind, scope, name, depth)
    if not declarator.sizes:
        return result
    if len(declarator.sizes) > 1:
        raise declarator.name.problem("arrays of more than one dimension are not supported")
    if result.arity is not Arity.SCALAR:
        raise declarator.name.problem(f"an array of {result} is not supported; only one level of arrays is")
    return FieldType(result.base, Arity.ARRAY, _positive(declarator.sizes[0], scope), result.string_bound)


def _base(kind: IdlType) -> str:
    words = " ".join(kind.words)
    if words not in _BASES:
        raise kind.at.problem(f'the type "{words}" is not supported')
    return _BASES[words]


def _type(kind: IdlType, scope: _IdlSymbolTable, name: RosName, depth: int) -> FieldType:
    match kind.kind:
        case "base":
            return FieldType(_base(kind))
        case "string":
            return FieldType(kind.words[0], string_bound=_positive(kind.size, scope) if kind.size else 0)
        case "sequence":
            assert kind.element is not None
            if kind.element.kind == "sequence":
                raise kind.at.problem("sequences of sequences or arrays are not supported")
            element = _type(kind.element, scope, name, depth)
            if element.arity is not Arity.SCALAR:
                raise kind.at.problem("sequences of sequences or arrays are not supported")
            if kind.size is None and kind.element.kind == "name" and element.base == "wstring" and element.string_bound:
                # The type description by rosidl is wrong for sequence<wstring<N>>, but not for the typedef
                # (docs/internals/protocol.md 1.7).
                raise kind.at.problem(f"expected sequence<wstring<{element.string_bound}>>, found a typedef in it")
            if kind.size is None:
                return FieldType(element.base, Arity.UNBOUNDED, 0, element.string_bound)
            return FieldType(element.base, Arity.BOUNDED, _positive(kind.size, scope), element.string_bound)
        case _:
            return _named(kind, scope, name, depth)


def _named(kind: IdlType, scope: _IdlSymbolTable, name: RosName, depth: int) -> FieldType:
    *modules, last = kind.words
    if not modules and last in scope.typedefs and depth < _MAX_TYPEDEFS:
        typedef = scope.typedefs[last]
        return _declared(typedef.type, typedef.declarator, scope, name, depth + 1)
    is_in_msg = len(modules) == 2 and modules[1] == "msg"
    if is_in_msg and RosName.PACKAGE_RULE.allows(modules[0]) and is_interface_name(last):
        return FieldType(f"{modules[0]}/msg/{last}")
    if not modules and is_interface_name(last) and last not in scope.typedefs:
        return FieldType(f"{name.package}/msg/{last}")
    raise kind.at.problem(f'expected a message name package::msg::Name or a typedef, found "{"::".join(kind.words)}"')


def _positive(expression: IdlExpression, scope: _IdlSymbolTable) -> int:
    value = _evaluate(expression, scope, 0)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value < 2**64:
        raise expression.at.problem(f'expected a whole number above 0, found "{expression.text[:40]}"')
    return value


def _evaluate(expression: IdlExpression, scope: _IdlSymbolTable, depth: int) -> Scalar:
    match expression.kind:
        case "boolean":
            return expression.text == "TRUE"
        case "string" | "wide_string":
            try:
                return decode_idl_string(expression.text, wide=expression.kind == "wide_string")
            except LiteralProblem as problem:
                raise expression.at.problem(str(problem)) from None
        case "number":
            return _number(expression)
        case _:
            found = scope.constant(expression.text)
            if len(found) > 1:
                raise expression.at.problem(f'"{expression.text}" can mean {len(found)} constants')
            if not found or depth > _MAX_TYPEDEFS:
                if expression.text in ("true", "false"):
                    return expression.text == "true"
                if expression.text in ("inf", "nan"):  # as rosidl converts these defaults of a .msg
                    return float(expression.text)
                raise expression.at.problem(f'unknown constant "{expression.text}"')
            return _evaluate(found[0].value, scope, depth + 1)


def _number(expression: IdlExpression) -> int | float:
    text = expression.text
    if text[-1] in "dD" and "x" not in text.lower():  # fixed point: not a whole number, even without a fraction
        text = text[:-1] + "e0" * ("e" not in text.lower())
    if len(text) <= 400:
        for convert in (int, lambda digits: int(digits, 0), lambda digits: int(digits, 8), float):
            if convert is not int or not text.lstrip("-").startswith("0") or text.lstrip("-") == "0":
                try:
                    return convert(text)
                except ValueError:
                    continue
    raise expression.at.problem(f'expected a number, found "{text[:40]}"')


def _constant(const: IdlConst, scope: _IdlSymbolTable, source: SourceText) -> ConstantDef:
    kind = _type(const.type, scope, RosName("", "", ""), 0)
    if kind.is_message or kind.arity is not Arity.SCALAR:
        raise const.name.problem(f'expected a primitive type or string for a constant, found "{kind}"')
    comment, unit = _texts(const.annotations)
    value = _fit(kind, _evaluate(const.value, scope, 0), const.value.at)
    at = Location(source, const.name.line, const.name.column)
    return ConstantDef(const.name.text, FieldType(kind.base), value, comment, unit, at)


def _fit(kind: FieldType, value: Scalar, at: Token) -> Scalar:
    """Return a constant or default value of an .idl file as the Python type of its field.

    Raises `SyntaxProblem` if the value does not fit the type.
    """
    primitive = kind.primitive
    if primitive is None:
        if isinstance(value, str) and (not kind.string_bound or len(value) <= kind.string_bound):
            return value
    elif primitive.python == "bool":
        if isinstance(value, bool) or value in (0, 1):
            return bool(value)
    elif primitive.python == "float":
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return float(value)
    elif isinstance(value, int) and not isinstance(value, bool):
        low, high = primitive.integer_range
        if low <= value <= high:
            return value
    raise at.problem(f"expected a value of type {kind}, found {str(value)[:40]!r}")


def _default(
    annotations: tuple[IdlAnnotation, ...], kind: FieldType, scope: _IdlSymbolTable, declarator: IdlDeclarator
) -> Default | None:
    found = [one for one in annotations if one.name == "default"]
    if not found:
        return None
    if kind.is_message:
        raise declarator.name.problem(f'a field of type "{kind}" cannot have a default')
    expression = found[0].arguments.get("value")
    if expression is None or len(found) > 1:
        raise declarator.name.problem(f'expected one @default(value=...) of "{declarator.name.text}"')
    value = _evaluate(expression, scope, 0)
    if kind.arity is Arity.SCALAR:
        return _fit(kind, value, expression.at)
    # The default of an array is the text of a tuple (docs/internals/protocol.md 1.8).
    values = python_value(value) if isinstance(value, str) else None
    if not isinstance(values, (tuple, list)):
        raise expression.at.problem(f"expected the text of a tuple for {kind}, found {str(value)[:40]!r}")
    over = len(values) > kind.capacity and kind.arity is Arity.BOUNDED
    if over or (kind.arity is Arity.ARRAY and len(values) != kind.capacity):
        raise expression.at.problem(f"expected {kind.capacity} values for {kind}, found {len(values)}")
    return tuple(_fit(kind.element, item, expression.at) for item in values)


def _texts(annotations: tuple[IdlAnnotation, ...]) -> tuple[tuple[str, ...], str]:
    comment: tuple[str, ...] = ()
    unit = ""
    for annotation in annotations:
        language = annotation.arguments.get("language")
        text = annotation.arguments.get("text")
        if annotation.name == "verbatim" and text is not None and language is not None and language.text == "comment":
            lines = _plain(text).splitlines()
            comment = tuple(line.rstrip() for line in lines)
        value = annotation.arguments.get("value", annotation.value)
        if annotation.name == "unit" and value is not None:
            unit = _plain(value)
    return comment, unit


def _plain(expression: IdlExpression) -> str:
    try:
        return decode_idl_string(expression.text)
    except LiteralProblem:
        return expression.text
