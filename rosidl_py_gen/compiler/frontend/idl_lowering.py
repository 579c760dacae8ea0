"""Conversion of the syntax tree of an .idl file to an interface; rosidl supports a subset of IDL.

One struct is a message, two are a service, three an action. Constants of struct S are in a module S_Constants. The
subset is described in docs/internals/protocol.md 1.8.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import RosName, is_interface_name, is_package_name, py_name
from rosidl_py_gen.compiler.frontend.idl_parser import (
    IdlAnnotation,
    IdlConst,
    IdlDeclarator,
    IdlDefinition,
    IdlEnum,
    IdlExpression,
    IdlModule,
    IdlStruct,
    IdlType,
    IdlTypedef,
    parse_idl,
)
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
    section_names,
)

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import Scalar

_BASES = {
    "boolean": "bool",
    "octet": "byte",
    "char": "idl_char",
    "wchar": "wchar",
    "float": "float32",
    "double": "float64",
    "short": "int16",
    "long": "int32",
    "long long": "int64",
    "unsigned short": "uint16",
    "unsigned long": "uint32",
    "unsigned long long": "uint64",
    **{f"{sign}int{bits}": f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
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
    if len(modules) == 2 and is_package_name(modules[0]) and modules[1] == "msg" and is_interface_name(last):
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
        low, high = INTEGER_RANGES[PRIMITIVES[kind.base].code]
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
