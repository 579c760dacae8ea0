"""Syntax trees of .idl files: what the grammar found, with columns, before anything was checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.msg_line_parser import Word


@dataclass(frozen=True, slots=True)
class IdlExpression:
    """A literal or a name: `kind` is number, boolean, string, wide_string or name; `text` joins adjacent literals."""

    kind: str
    text: str
    at: Word = field(compare=False)


@dataclass(frozen=True, slots=True)
class IdlType:
    """`kind` is base, string, sequence or name; `words` the keywords or name parts; `size` a bound."""

    kind: str
    words: tuple[str, ...]
    element: IdlType | None
    size: IdlExpression | None
    at: Word = field(compare=False)


@dataclass(frozen=True, slots=True)
class IdlAnnotation:
    name: str
    value: IdlExpression | None
    arguments: dict[str, IdlExpression]


@dataclass(frozen=True, slots=True)
class IdlDeclarator:
    name: Word
    sizes: tuple[IdlExpression, ...]


@dataclass(frozen=True, slots=True)
class IdlMember:
    annotations: tuple[IdlAnnotation, ...]
    type: IdlType
    declarators: tuple[IdlDeclarator, ...]


@dataclass(frozen=True, slots=True)
class IdlStruct:
    annotations: tuple[IdlAnnotation, ...]
    name: Word
    members: tuple[IdlMember, ...]


@dataclass(frozen=True, slots=True)
class IdlConst:
    annotations: tuple[IdlAnnotation, ...]
    type: IdlType
    name: Word
    value: IdlExpression


@dataclass(frozen=True, slots=True)
class IdlTypedef:
    type: IdlType
    declarator: IdlDeclarator


@dataclass(frozen=True, slots=True)
class IdlEnum:
    name: Word


@dataclass(frozen=True, slots=True)
class IdlModule:
    name: Word
    definitions: tuple[IdlDefinition, ...]


IdlDefinition = IdlModule | IdlStruct | IdlConst | IdlTypedef | IdlEnum
