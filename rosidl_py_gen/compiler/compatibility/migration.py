"""How messages of old definitions become messages of new ones, field by field.

Decides which field a value goes to: the one that a rule names, else the one of the same name; and whether a value of
one type may become one of another. What has no place is dropped, what has no source gets its default value, and both
are listed. A value that would become another one is refused, here where types tell it, and by whoever carries it over
where only the value does. Text never becomes a number, nor a number text.
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
"""The fields of messages by full name, as name and type."""


class MigrationError(RosidlError):
    """Messages cannot be carried over to these definitions by these rules; the text has every reason."""


class RenameRule(NamedTuple):
    """Where a name of then goes.

    Attributes:
        target: the name of now; empty when it is let go.
        place: ``file:line:column``, for errors.
    """

    target: str
    place: str


@dataclass(frozen=True, slots=True)
class MigrationRules:
    """What nothing in the definitions tells.

    Attributes:
        types: full name of then -> that of now.
        fields: full name of a message of then -> its fields.
    """

    types: Mapping[str, RenameRule] = field(default_factory=dict)
    fields: Mapping[str, Mapping[str, RenameRule]] = field(default_factory=dict)

    def type_name(self, old: str) -> str:
        """What a type is called now."""
        rule = self.types.get(old)
        return rule.target if rule else old


class ConversionKind(Enum):
    """How a value is carried over: as it is, as a number of another kind, or as a message of another definition."""

    COPY = "copy"
    NUMBER = "number"
    MESSAGE = "message"


class FieldConversion(NamedTuple):
    """A value of a field and where it goes."""

    old: str
    new: str
    old_type: FieldType
    new_type: FieldType
    way: ConversionKind


@dataclass(frozen=True, slots=True)
class MessagePlan:
    """How messages of one type become those of another.

    Attributes:
        dropped: fields of then that go nowhere.
        let_go: those of them that a rule names.
        defaulted: fields of now that nothing comes to.
    """

    old: str
    new: str
    steps: tuple[FieldConversion, ...]
    dropped: tuple[str, ...]
    dropped_by_rule: tuple[str, ...]
    defaulted: tuple[str, ...]

    @property
    def is_conversion(self) -> bool:
        """Whether it is more than a copy."""
        is_same = all(one.old == one.new and one.old_type == one.new_type for one in self.steps)
        return not is_same or bool(self.dropped or self.defaulted) or self.old != self.new


Plans = Mapping[tuple[str, str], MessagePlan]
"""By the names of then and now; one for each pair that a message leads to."""


def plan(old: Types, new: Types, top: str, rules: MigrationRules) -> dict[tuple[str, str], MessagePlan]:
    """Plan how messages of a type are carried over, with all that they contain.

    Args:
        old: the type and all it refers to, then.
        new: the same now; the type may have another name.
        top: its name then.

    Raises:
        MigrationError: fields that cannot be carried over, and rules that name what is not there.
    """
    problems: list[str] = []
    plans: dict[tuple[str, str], MessagePlan] = {}
    pending = [(top, rules.type_name(top))]
    while pending:
        pair = pending.pop()
        if pair in plans:
            continue
        plans[pair] = one = _message(pair, old, new, rules, problems)
        pending += [
            (step.old_type.base, step.new_type.base) for step in one.steps if step.way is ConversionKind.MESSAGE
        ]
    if problems:
        raise MigrationError("\n".join(dict.fromkeys(problems)))
    return plans


def _message(pair: tuple[str, str], old: Types, new: Types, rules: MigrationRules, problems: list[str]) -> MessagePlan:
    old_name, new_name = pair
    now = dict(new[new_name])
    own = rules.fields.get(old_name, {})
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
            steps.append(FieldConversion(name, target, kind, now[target], _way(kind, now[target], rules)))
        except _NotConvertibleError as error:
            becomes = "" if name == target else f" becomes {target}"
            problems.append(
                f"{old_name}.{name}{becomes}: {error}; a rule `fields: {{{old_name}: {{{name}: null}}}}` lets it go"
            )
    filled = {step.new for step in steps}
    let_go = tuple(name for name in dropped if name in own)
    return MessagePlan(
        old_name, new_name, tuple(steps), tuple(dropped), let_go, tuple(name for name in now if name not in filled)
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
            problems.append(f"{rule.place}: {rule.target} is what {first} becomes already")


class _NotConvertibleError(RosidlError):
    """A value of one type cannot become one of another."""


def _way(old: FieldType, new: FieldType, rules: MigrationRules) -> ConversionKind:
    """Raises `_NotConvertibleError`. Bounds and lengths are looked at value by value."""
    if (old.arity is Arity.SCALAR) is not (new.arity is Arity.SCALAR):
        raise _NotConvertibleError(f"{old} cannot become {new}")
    if old.is_message or new.is_message:
        if not (old.is_message and new.is_message):
            raise _NotConvertibleError(f"{old} cannot become {new}")
        if rules.type_name(old.base) != new.base:
            raise _NotConvertibleError(
                f"{old} cannot become {new}, unless a rule `types: {{{old.base}: {new.base}}}` says that they are one"
            )
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
