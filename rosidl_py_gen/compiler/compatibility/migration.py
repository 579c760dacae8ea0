"""Plan of the conversion of messages from old definitions to new ones, field by field.

A value is assigned to the field that a rule names, else to the field of its name. Fields without a target are dropped,
fields without a source get their default value; the plan lists both. Conversions that would change a value are refused:
here by type, and during the conversion by value. Text is never converted to a number, nor a number to text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType

Types = Mapping[str, Sequence[tuple[str, "FieldType"]]]
"""Names and types of fields by the full name of their message."""


class MigrationError(RosidlError):
    """Messages cannot be converted to the new definitions by these rules; the text has all reasons."""


class RenameRule(NamedTuple):
    """Rename rule of a type or field, with its location in the rules file.

    Attributes:
        target: the new name; empty to drop a field.
        place: ``file:line:column``, for errors.
    """

    target: str
    place: str


@dataclass(frozen=True, slots=True)
class MigrationRules:
    """Renames that the definitions do not show.

    Attributes:
        types: rules by the old full name of a type.
        fields: rules by field, by the old full name of a message.
    """

    types: Mapping[str, RenameRule] = field(default_factory=dict)
    fields: Mapping[str, Mapping[str, RenameRule]] = field(default_factory=dict)

    def type_name(self, old: str) -> str:
        """Return the new name of a type."""
        rule = self.types.get(old)
        return rule.target if rule else old


class ConversionKind(Enum):
    """Conversion of a value: a copy, a number of another type, or a message of another definition."""

    COPY = "copy"
    NUMBER = "number"
    MESSAGE = "message"


class FieldConversion(NamedTuple):
    """Conversion of an old field to a new one."""

    old: str
    new: str
    old_type: FieldType
    new_type: FieldType
    kind: ConversionKind


@dataclass(frozen=True, slots=True)
class MessagePlan:
    """Conversion of the messages of one type to those of another.

    Attributes:
        dropped: old fields without a target.
        dropped_by_rule: those that a rule drops.
        defaulted: new fields without a source.
    """

    old: str
    new: str
    steps: tuple[FieldConversion, ...]
    dropped: tuple[str, ...]
    dropped_by_rule: tuple[str, ...]
    defaulted: tuple[str, ...]

    @property
    def is_conversion(self) -> bool:
        """True if the conversion is not only a copy."""
        is_same = all(one.old == one.new and one.old_type == one.new_type for one in self.steps)
        return not is_same or bool(self.dropped or self.defaulted) or self.old != self.new


Plans = Mapping[tuple[str, str], MessagePlan]
"""Plans by old and new name, for a message and all that it contains."""


def plan(old: Types, new: Types, top: str, rules: MigrationRules | None) -> dict[tuple[str, str], MessagePlan]:
    """Plan the conversion of the messages of a type, with all that they contain.

    Args:
        old: the old type and all types that it refers to.
        new: the new type and all types that it refers to.
        top: the old name of the type.
        rules: the renames; None if nobody can write any, and errors do not suggest it.

    Raises:
        MigrationError: fields cannot be converted, or rules name fields that do not exist.
    """
    problems: list[str] = []
    plans: dict[tuple[str, str], MessagePlan] = {}
    pending = [(top, rules.type_name(top) if rules else top)]
    while pending:
        pair = pending.pop()
        if pair in plans:
            continue
        plans[pair] = one = _message(pair, old, new, rules, problems)
        pending += [
            (step.old_type.base, step.new_type.base) for step in one.steps if step.kind is ConversionKind.MESSAGE
        ]
    if problems:
        raise MigrationError("\n".join(dict.fromkeys(problems)))
    return plans


def _message(
    pair: tuple[str, str], old: Types, new: Types, rules: MigrationRules | None, problems: list[str]
) -> MessagePlan:
    old_name, new_name = pair
    now = dict(new[new_name])
    own = rules.fields.get(old_name, {}) if rules else {}
    _check_rules(old_name, new_name, dict(old[old_name]), now, own, problems)
    claimed = {rule.target for rule in own.values() if rule.target}
    steps: list[FieldConversion] = []
    dropped: list[str] = []
    for name, kind in old[old_name]:
        rule = own.get(name)
        target = rule.target if rule else "" if name in claimed else name
        if target not in now:
            dropped.append(name)
            continue
        try:
            steps.append(FieldConversion(name, target, kind, now[target], _conversion_kind(kind, now[target], rules)))
        except _NotConvertibleError as error:
            becomes = "" if name == target else f" becomes {target}"
            advice = f"; a rule `fields: {{{old_name}: {{{name}: null}}}}` drops it" if rules else ""
            problems.append(f"{old_name}.{name}{becomes}: {error}{advice}")
    filled = {step.new for step in steps}
    by_rule = tuple(name for name in dropped if name in own)
    return MessagePlan(
        old_name, new_name, tuple(steps), tuple(dropped), by_rule, tuple(name for name in now if name not in filled)
    )


def _check_rules(
    old_name: str,
    new_name: str,
    then: Mapping[str, object],
    now: Mapping[str, object],
    own: Mapping[str, RenameRule],
    problems: list[str],
) -> None:
    taken: dict[str, str] = {}
    for name, rule in own.items():
        if name not in then:
            problems.append(f"{rule.place}: {old_name} has no field {name}{did_you_mean(name, then)}")
        if rule.target and rule.target not in now:
            problems.append(f"{rule.place}: {new_name} has no field {rule.target}{did_you_mean(rule.target, now)}")
        first = taken.setdefault(rule.target, name)
        if rule.target and first != name:
            problems.append(f"{rule.place}: {rule.target} is the target of {first} already")


class _NotConvertibleError(RosidlError):
    """A value of one type cannot become one of another."""


def _conversion_kind(old: FieldType, new: FieldType, rules: MigrationRules | None) -> ConversionKind:
    """Return the conversion between two types, without bounds and lengths, which depend on the values.

    Raises:
        _NotConvertibleError: values of the types cannot be converted.
    """
    if (old.arity is Arity.SCALAR) is not (new.arity is Arity.SCALAR):
        raise _NotConvertibleError(f"{old} cannot become {new}")
    if old.is_message or new.is_message:
        if not (old.is_message and new.is_message):
            raise _NotConvertibleError(f"{old} cannot become {new}")
        if (rules.type_name(old.base) if rules else old.base) != new.base:
            advice = f", unless a rule `types: {{{old.base}: {new.base}}}` maps one to the other" if rules else ""
            raise _NotConvertibleError(f"{old} cannot become {new}{advice}")
        return ConversionKind.MESSAGE
    if old.is_string and new.is_string:
        return ConversionKind.COPY
    one, other = old.primitive, new.primitive
    if one is None or other is None:
        raise _NotConvertibleError(f"{old} cannot become {new}")
    if one.python == other.python and one.code == other.code:
        return ConversionKind.COPY
    order = ("bool", "int", "float")
    if order.index(one.python) > order.index(other.python):
        raise _NotConvertibleError(f"{old} cannot become {new}")
    return ConversionKind.NUMBER
