"""The two grammars at work: text in, syntax trees out.

The only file that imports lark; its errors become `SyntaxProblem` here. Nothing is checked beyond the grammar.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import LarkError, UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

from rosidl_py_gen.resources import grammar_text
from rosidl_py_gen.spec.syntax import (
    ElementSyntax,
    IdlAnnotation,
    IdlConst,
    IdlDeclarator,
    IdlDefinition,
    IdlEnum,
    IdlExpression,
    IdlMember,
    IdlModule,
    IdlStruct,
    IdlType,
    IdlTypedef,
    SyntaxProblem,
    TypeSyntax,
    Word,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

_WORDS = {
    "TYPE_NAME": "a type",
    "SIZE": "a number",
    "NAME": "a name",
    "DEFAULT": "a default value",
    "VALUE": "a value",
    "_SPACE": "a space",
    "_EQUALS": '"="',
    "_AT_MOST": '"<="',
    "LSQB": '"["',
    "RSQB": '"]"',
    "SLASH": '"/"',
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

# What IDL knows and rosidl does not, by the word or sign that gives it away.
_UNSUPPORTED = {
    **{word: f"{word}s are" for word in ("union", "bitmask", "bitset", "interface", "valuetype", "exception", "map")},
    **{word: f'"{word}" is' for word in ("fixed", "any", "native", "typename", "wchar_t")},
    ":": "inheritance is",
    **dict.fromkeys("+*/%|&^~", "constant expressions are"),
    **dict.fromkeys(("<<", ">>"), "constant expressions are"),
}


def parse_element(text: str, line: int) -> ElementSyntax:
    """One element line of a .msg section.

    Raises:
        SyntaxProblem: with the column and what was expected there.
    """
    try:
        tree = _message_parser().parse(text)
        return _Elements(line).transform(tree)  # type: ignore[no-any-return]
    except LarkError as error:
        raise _translate(error, text, line) from error


def parse_idl(text: str) -> tuple[IdlDefinition, ...]:
    """A whole .idl file.

    Raises:
        SyntaxProblem: with line and column and what was expected there.
    """
    try:
        return _Idl().transform(_idl_parser().parse(text))  # type: ignore[no-any-return]
    except LarkError as error:
        raise _translate(error, text, 0) from error
    except RecursionError:
        raise SyntaxProblem(1, 1, "nested too deeply") from None


@lru_cache(maxsize=1)
def _message_parser() -> Lark:
    return Lark(grammar_text("grammar.lark"), parser="lalr", propagate_positions=False, maybe_placeholders=False)


@lru_cache(maxsize=1)
def _idl_parser() -> Lark:
    return Lark(grammar_text("idl.lark"), parser="lalr", propagate_positions=False, maybe_placeholders=False)


def _translate(error: LarkError, text: str, line: int) -> SyntaxProblem:
    if isinstance(error, VisitError) and isinstance(error.orig_exc, SyntaxProblem):
        return error.orig_exc
    if not isinstance(error, UnexpectedInput):
        return SyntaxProblem(line or 1, 1, str(error).splitlines()[0])
    names: Iterable[str] = ()
    column, row = error.column, line or error.line
    found = "the end of the line" if line else "the end of the file"
    if isinstance(error, UnexpectedCharacters):
        names, found = error.allowed or (), f'"{error.char}"'
    elif isinstance(error, UnexpectedToken):
        names = error.accepts or error.expected
        if error.token.type != "$END":
            found = f'"{_shorten(str(error.token))}"'
        else:
            column, row = -1, line or -1
    elif isinstance(error, UnexpectedEOF):
        names, column, row = error.expected, -1, line or -1
    if column < 1:
        lines = text.splitlines() or [""]
        row, column = (row, len(text) + 1) if line else (len(lines), len(lines[-1]) + 1)
    unsupported = "" if line else _UNSUPPORTED.get(found.strip('"').split(" ")[0], "")
    if not line and text.splitlines()[row - 1][column - 1 :].startswith("/*"):
        return SyntaxProblem(row, column, "the comment is never closed")
    if unsupported:
        return SyntaxProblem(row, column, f"{unsupported} not supported in ROS interfaces, found {found}")
    if line and "_SPACE" in names and found == "the end of the line":
        return SyntaxProblem(row, column, "expected a type, a space and a name, found no name")
    words = sorted({_WORDS.get(name, f'"{name.lower()}"') for name in names if not name.startswith("__IGNORE")})
    expected = " or ".join(words) if words else "something else"
    return SyntaxProblem(row, column, f"expected {expected}, found {found}")


def _shorten(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


class _Elements(Transformer[Token, Any]):
    """Lark tree of one element line -> ElementSyntax."""

    def __init__(self, line: int) -> None:
        super().__init__()
        self.line = line

    def __default_token__(self, token: Token) -> Word:
        return Word(str(token), self.line, token.column or 1)

    def start(self, children: list[Any]) -> ElementSyntax:
        element: ElementSyntax = children[0]
        return element

    def field(self, children: list[Any]) -> ElementSyntax:
        return ElementSyntax(children[0], children[1], False, children[2] if len(children) > 2 else None)

    def constant(self, children: list[Any]) -> ElementSyntax:
        return ElementSyntax(children[0], children[1], True, children[2] if len(children) > 2 else None)

    def type(self, children: list[Any]) -> TypeSyntax:
        names: list[Word] = children[0]
        rest = dict(children[1:])
        array = next((key for key in ("fixed", "bounded", "unbounded") if key in rest), None)
        package = names[0] if len(names) == 2 else None
        return TypeSyntax(package, names[-1], rest.get("bound"), array, rest.get(array or ""))

    def base(self, children: list[Any]) -> list[Word]:
        return children

    def bound(self, children: list[Any]) -> tuple[str, Word]:
        return "bound", children[0]

    def fixed(self, children: list[Any]) -> tuple[str, Word]:
        return "fixed", children[0]

    def bounded(self, children: list[Any]) -> tuple[str, Word]:
        return "bounded", children[0]

    def unbounded(self, children: list[Any]) -> tuple[str, None]:
        return "unbounded", None


def _word(token: Token) -> Word:
    return Word(str(token), token.line or 1, token.column or 1)


def _split(children: list[Any], kind: type) -> tuple[tuple[Any, ...], list[Any]]:
    """The leading children of one type, and the rest."""
    count = 0
    while count < len(children) and isinstance(children[count], kind):
        count += 1
    return tuple(children[:count]), children[count:]


@v_args(inline=False)
class _Idl(Transformer[Token, Any]):
    """Lark tree of an .idl file -> definitions."""

    def start(self, children: list[Any]) -> tuple[IdlDefinition, ...]:
        return tuple(children)

    def module(self, children: list[Any]) -> IdlModule:
        _, (name, *definitions) = _split(children, IdlAnnotation)
        return IdlModule(_word(name), tuple(definitions))

    def const(self, children: list[Any]) -> IdlConst:
        annotations, (kind, name, value) = _split(children, IdlAnnotation)
        return IdlConst(annotations, kind, _word(name), value)

    def typedef(self, children: list[Any]) -> IdlTypedef:
        return IdlTypedef(children[0], children[1])

    def struct(self, children: list[Any]) -> IdlStruct:
        annotations, (name, *members) = _split(children, IdlAnnotation)
        return IdlStruct(annotations, _word(name), tuple(members))

    def enum(self, children: list[Any]) -> IdlEnum:
        _, (name, *_rest) = _split(children, IdlAnnotation)
        return IdlEnum(_word(name))

    def member(self, children: list[Any]) -> IdlMember:
        annotations, (kind, *declarators) = _split(children, IdlAnnotation)
        return IdlMember(annotations, kind, tuple(declarators))

    def declarator(self, children: list[Any]) -> IdlDeclarator:
        return IdlDeclarator(_word(children[0]), tuple(children[1:]))

    def type(self, children: list[Any]) -> IdlType:
        child = children[0]
        if isinstance(child, IdlExpression):  # a scoped name
            return IdlType("name", tuple(child.text.split("::")), None, None, child.at)
        assert isinstance(child, IdlType)
        return child

    def base_type(self, children: list[Any]) -> IdlType:
        return IdlType("base", tuple(str(token) for token in children), None, None, _word(children[0]))

    def string_type(self, children: list[Any]) -> IdlType:
        size = children[1] if len(children) > 1 else None
        return IdlType("string", (str(children[0]),), None, size, _word(children[0]))

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
        return IdlExpression("number", "".join(children).removeprefix("+"), _word(children[0]))

    def boolean(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("boolean", str(children[0]), _word(children[0]))

    def string(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("string", "".join(token[1:-1] for token in children), _word(children[0]))

    def wide_string(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("wide_string", "".join(token[2:-1] for token in children), _word(children[0]))

    def scoped_name(self, children: list[Any]) -> IdlExpression:
        return IdlExpression("name", "::".join(children), _word(children[0]))
