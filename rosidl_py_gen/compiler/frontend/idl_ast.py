"""Syntax trees of .idl files with positions, before any check."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.syntax import Token


@dataclass(frozen=True, slots=True)
class IdlExpression:
    """A literal or a name; `kind` is number, boolean, string, wide_string or name, `text` joins adjacent literals."""

    kind: str
    text: str
    at: Token = field(compare=False)


@dataclass(frozen=True, slots=True)
class IdlType:
    """A type; `kind` is base, string, sequence or name, `words` are the keywords or modules and name, `size` is a
    bound.
    """

    kind: str
    words: tuple[str, ...]
    element: IdlType | None
    size: IdlExpression | None
    at: Token = field(compare=False)


@dataclass(frozen=True, slots=True)
class IdlAnnotation:
    name: str
    value: IdlExpression | None
    arguments: dict[str, IdlExpression]


@dataclass(frozen=True, slots=True)
class IdlDeclarator:
    name: Token
    sizes: tuple[IdlExpression, ...]


@dataclass(frozen=True, slots=True)
class IdlMember:
    annotations: tuple[IdlAnnotation, ...]
    type: IdlType
    declarators: tuple[IdlDeclarator, ...]


@dataclass(frozen=True, slots=True)
class IdlStruct:
    annotations: tuple[IdlAnnotation, ...]
    name: Token
    members: tuple[IdlMember, ...]


@dataclass(frozen=True, slots=True)
class IdlConst:
    annotations: tuple[IdlAnnotation, ...]
    type: IdlType
    name: Token
    value: IdlExpression


@dataclass(frozen=True, slots=True)
class IdlTypedef:
    type: IdlType
    declarator: IdlDeclarator


@dataclass(frozen=True, slots=True)
class IdlEnum:
    name: Token


@dataclass(frozen=True, slots=True)
class IdlModule:
    name: Token
    definitions: tuple[IdlDefinition, ...]


IdlDefinition = IdlModule | IdlStruct | IdlConst | IdlTypedef | IdlEnum
