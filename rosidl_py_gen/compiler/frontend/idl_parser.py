"""Parser of .idl files: from text to syntax trees with positions. It checks only the grammar."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lark import Lark, Transformer, v_args
from lark import Token as LarkToken
from lark.exceptions import LarkError, UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from rosidl_py_gen.compiler.frontend.model import SyntaxProblem, Token

if TYPE_CHECKING:
    from collections.abc import Iterable

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
