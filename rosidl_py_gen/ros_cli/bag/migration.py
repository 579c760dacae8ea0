"""Conversion of messages from old definitions to new definitions, field by field: a plan, and the converter made from
the plan.

The functions read no files, bags or networks. A value is assigned to the field that a rule names, else to the field of
the same name. Old fields without a target are dropped, and new fields without a source get their default value; the
plan lists both. Text is never converted to a number, nor a number to text.

No value changes silently. The plan refuses conversions between types that could change a value. A value that the new
type cannot have raises `EncodeError` with the path of the field during the conversion, or when the message is encoded.
The only exception is float64 to float32, which is rounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.errors import EncodeError, RosidlError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.cdr import Message

Converter: TypeAlias = "Callable[[Any], Any]"
Types = Mapping[str, Sequence[tuple[str, "FieldType"]]]
"""Dictionary from the full name of a message to the names and types of its fields."""


class MigrationError(RosidlError):
    """Error of messages that cannot be converted to the new definitions; the text lists all reasons."""


class RenameRule(NamedTuple):
    """Rename rule of a type or field, written by the user; an empty `target` drops the field.

    `place` is the location of the rule as ``file:line:column``.
    """

    target: str
    place: str


@dataclass(frozen=True, slots=True)
class MigrationRules:
    """Rename rules of a user, for renames that definitions do not show, by the old full name of the type or message."""

    types: Mapping[str, RenameRule] = field(default_factory=dict)
    fields: Mapping[str, Mapping[str, RenameRule]] = field(default_factory=dict)

    def type_name(self, old: str) -> str:
        """Return the new name of a type: the target of its rename rule, else the old name."""
        rule = self.types.get(old)
        return rule.target if rule else old


class FieldConversion(NamedTuple):
    """Conversion of an old field to a new one."""

    old: str
    new: str
    old_type: FieldType
    new_type: FieldType


@dataclass(frozen=True, slots=True)
class MessagePlan:
    """Conversion of messages of one type to messages of another.

    Old fields without counterpart are dropped (some by an explicit rule); new fields get their default.
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
"""Dictionary of conversion plans by old and new type name, for a message and all messages that it contains."""


def plan(old: Types, new: Types, top: str, rules: MigrationRules | None) -> dict[tuple[str, str], MessagePlan]:
    """Return the plans that convert the messages of a type and all messages that they contain, by old and new name.

    Args:
        top: the old name of the type.
        rules: the renames; None if the user cannot write rules, and then errors do not suggest rules.

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
        pending += [(step.old_type.base, step.new_type.base) for step in one.steps if step.new_type.is_message]
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
        new_type = now[target]
        if _is_convertible(kind, new_type, rules):
            steps.append(FieldConversion(name, target, kind, new_type))
            continue
        problem = f"{old_name}.{name}{'' if name == target else f' becomes {target}'}: {kind} cannot become {new_type}"
        if rules and kind.is_message and new_type.is_message and _is_same_arity(kind, new_type):
            problem += f", unless a rule `types: {{{kind.base}: {new_type.base}}}` maps one to the other"
        problems.append(f"{problem}; a rule `fields: {{{old_name}: {{{name}: null}}}}` drops it" if rules else problem)
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


def _is_same_arity(old: FieldType, new: FieldType) -> bool:
    return (old.arity is Arity.SCALAR) is (new.arity is Arity.SCALAR)


def _is_convertible(old: FieldType, new: FieldType, rules: MigrationRules | None) -> bool:
    """Return True if values of the old type can be converted to the new type, regardless of bounds and lengths."""
    if not _is_same_arity(old, new):
        return False
    if old.is_message and new.is_message:
        return (rules.type_name(old.base) if rules else old.base) == new.base
    one, other = old.primitive, new.primitive
    if one is None or other is None:
        return old.is_string and new.is_string
    order = ("bool", "int", "float")
    return order.index(one.python) <= order.index(other.python)


def fields_of(cls: type[Message]) -> dict[str, list[tuple[str, FieldType]]]:
    """Return the names and types of the fields of a message class and of all types in it, as input of `plan`."""
    classes: dict[str, Any] = referenced_classes(cls)
    return {name: [(one.ros_name, one.type) for one in planned._TYPE.fields] for name, planned in classes.items()}


def message_converter(plans: Plans, old: type[Message], new: type[Message]) -> Callable[[Any], Any]:
    """Return a function that converts messages of the old class to the new class.

    The function raises `EncodeError` for a value that the new type does not have.
    """
    makers: dict[tuple[str, str], Converter] = {}
    old_classes, new_classes = referenced_classes(old), referenced_classes(new)

    def maker(pair: tuple[str, str]) -> Converter:
        if pair not in makers:
            makers[pair] = _maker(pair)
        return makers[pair]

    def converter_of(step: FieldConversion, path: str) -> Converter | None:
        return None if step.new_type.is_message and is_same(step) else _field_converter(step, path, maker)

    def is_same(step: FieldConversion) -> bool:
        pair = step.old_type.base, step.new_type.base
        nested = (field for field in plans[pair].steps if field.new_type.is_message)
        same_class = old_classes[pair[0]] is new_classes[pair[1]]
        return same_class and not plans[pair].is_conversion and all(map(is_same, nested))

    def _maker(pair: tuple[str, str]) -> Converter:
        old_class: Any = old_classes[pair[0]]
        cls: Any = new_classes[pair[1]]
        old_fields = {field.ros_name: field for field in old_class._TYPE.fields}
        new_fields = {field.ros_name: field for field in cls._TYPE.fields}
        steps = [
            (old_fields[step.old], new_fields[step.new], converter_of(step, f"{pair[1]}.{step.new}"))
            for step in plans[pair].steps
        ]

        def convert(message: Any) -> Any:
            converted = cls()
            for source, target, converter in steps:
                value = message._get_plain(source)
                converted._set_plain(target, value if converter is None else converter(value))
            return converted

        return convert

    return maker((old._TYPE.name, new._TYPE.name))


def _field_converter(
    step: FieldConversion, path: str, maker: Callable[[tuple[str, str]], Converter]
) -> Converter | None:
    """Return the function that converts the values of a field; None if values are copied unchanged.

    The function does not check array sizes; they are checked when the message is encoded.
    """
    is_scalar = step.new_type.arity is Arity.SCALAR
    if step.new_type.is_message:
        field = maker((step.old_type.base, step.new_type.base))
        return field if is_scalar else lambda values: [field(value) for value in values]
    one, other = step.old_type.primitive, step.new_type.primitive
    if one is None or other is None or (one.python, one.code) == (other.python, other.code):
        return None
    dtype = np.dtype(other.numpy)
    if not is_scalar:
        return _array(dtype, path)
    return int if other.python == "int" else _real(dtype, path)  # the range of an int is checked by encoding


def _real(dtype: np.dtype[Any], path: str) -> Converter:
    def convert(value: Any) -> float:
        if isinstance(value, int) and int(dtype.type(value)) != value:
            raise EncodeError(path, f"{value} cannot be represented exactly as {dtype}")
        return float(value)

    return convert


def _array(dtype: np.dtype[Any], path: str) -> Converter:
    def convert(values: Any) -> Any:
        array = np.asarray(values)
        if not array.size:
            return array.astype(dtype)
        if dtype.kind in "iu":
            fits = np.iinfo(dtype)
            low, high = int(array.min()), int(array.max())
            if low < fits.min or high > fits.max:
                raise EncodeError(path, f"expected {fits.min} to {fits.max}, found {low} to {high}")
            return array.astype(dtype)
        with np.errstate(over="ignore", invalid="ignore"):
            converted = array.astype(dtype)
            if array.dtype.kind == "f":
                is_right = np.isinf(converted) == np.isinf(array)
            else:
                # As Python's numbers where they may be rounded: numpy would compare both as floating point.
                is_exact = array.dtype.itemsize < dtype.itemsize
                is_right = True if is_exact else converted.astype(object) == array.astype(object)
        if not np.all(is_right):
            raise EncodeError(path, f"has values that {dtype} cannot represent")
        return converted

    return convert
