"""What expressions of `filters` compute with: the values of messages, and the operators and functions on them.

Decides what each may cost: numbers stay below `_MOST_BITS`, and the elements that are looked at for one message are
counted.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np

from rosidl_py_gen.cdr import Field, Message
from rosidl_py_gen.errors import RosidlError

_MOST_BITS, _MOST_EXPONENT, _MOST_SHIFT, _MOST_DIGITS = 256, 64, 64, 20
_MOST_STEPS = 1_000_000
"""Elements that Python looks at for one message; what numpy and str do counts a 64th."""


Value: TypeAlias = "Callable[[Run], Any]"


class FilterError(RosidlError, ValueError):
    """The user's expression is not allowed, names what does not exist, or has no value for a message."""


class Run:
    """One evaluation: the names there are, and the steps that are left."""

    __slots__ = ("left", "names")

    def __init__(self, message: Message) -> None:
        self.names: dict[str, Any] = {"m": message}
        self.left = _MOST_STEPS

    def pay(self, value: Any, *, in_python: bool = False) -> None:
        """Take what looking at all of a value costs; less when numpy or str looks."""
        share = 1 if in_python and not isinstance(value, np.ndarray) else 64
        self.left -= 1 + (len(value) // share if isinstance(value, SIZED) else 0)
        if self.left < 0:
            raise FilterError(f"looks at more than {_MOST_STEPS} elements of one message")


SIZED = (Sequence, np.ndarray)
"""What has elements."""


def truth(value: Any) -> Any:
    """Whether a condition holds: that of an array is whether it has elements, as with lists."""
    return len(value) > 0 if isinstance(value, np.ndarray) else value


def field_of(cls: type[Message], name: str) -> Field | None:
    """The field of a name as ROS or as Python spells it."""
    return next((field for field in cls._TYPE.fields if name in (field.ros_name, field.py_name)), None)


def read(value: Any, name: str, text: str) -> Any:
    """A field of something that nothing was known of; `text` is what the user called it."""
    field = field_of(type(value), name) if isinstance(value, Message) else None
    if field is None:
        raise FilterError(f'{text} has no field "{name}"')
    return scalar(getattr(value, field.py_name))


def scalar(value: Any) -> Any:
    """Numbers of numpy as those of Python."""
    return value.item() if isinstance(value, np.generic) else value


def element(value: Any, index: Any) -> Any:
    """One element."""
    if not isinstance(value, SIZED) or not isinstance(index, int):
        raise FilterError(f"{kind(value)} has no element {index!r:.50}")
    if not -len(value) <= index < len(value):
        raise FilterError(f"there is no element {index} among {len(value)}")
    return scalar(value[index])


def part(run: Run, value: Any, bounds: Iterable[Value | None]) -> Any:
    """Some elements."""
    ends = [None if bound is None else bound(run) for bound in bounds]
    if not isinstance(value, SIZED) or not all(end is None or isinstance(end, int) for end in ends):
        raise FilterError(f"{kind(value)} has no part from {ends[0]} to {ends[1]}")
    run.pay(value)
    return value[slice(*ends)]


def elements(value: Any) -> Iterator[Any]:
    """All elements."""
    if not isinstance(value, SIZED):
        raise FilterError(f"{kind(value)} has no elements")
    return map(scalar, value)


def number(value: Any) -> Any:
    """The value, if it is a number."""
    if not isinstance(value, int | float):
        raise FilterError(f"expected a number, found {kind(value)}")
    return value


def comparable(value: Any) -> Any:
    """The value, if it is one that comparing is cheap for."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Message) or (isinstance(value, list) and any(isinstance(item, Message) for item in value)):
        raise FilterError(f"{kind(value)} cannot be compared; compare its fields")
    return value


def kind(value: Any) -> str:
    """What a value is, for errors."""
    return value._TYPE.name if isinstance(value, Message) else type(value).__name__


def small(value: Any) -> Any:
    """The value, unless it is a number beyond all fields."""
    value = scalar(value)
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise FilterError(f"a number of more than {_MOST_BITS} bits")
    if isinstance(value, complex):
        raise FilterError("the root of a negative number")
    return value


def _power(base: Any, exponent: Any) -> Any:
    if isinstance(base, int) and abs(exponent) > _MOST_EXPONENT:
        raise FilterError(f"an exponent beyond {_MOST_EXPONENT}")
    return base**exponent


def _shifted(left: bool) -> Callable[[Any, Any], Any]:
    function = operator.lshift if left else operator.rshift

    def shift(value: Any, bits: Any) -> Any:
        if abs(bits) > _MOST_SHIFT:
            raise FilterError(f"a shift by more than {_MOST_SHIFT} bits")
        return function(value, bits)

    return shift


def _of_items(function: Callable[[Any], Any], of_array: Callable[[Any], Any]) -> Callable[..., Any]:
    """A function of elements: numpy's for arrays; several values count as elements, too."""

    def call(*values: Any) -> Any:
        if len(values) > 1:
            return function(iter(values))
        (value,) = values
        if isinstance(value, np.ndarray):
            return of_array(value)
        return function(value if isinstance(value, Iterator) else elements(value))

    return call


def _largest(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda items: function(map(comparable, items))


def _sum(items: Any) -> Any:
    total: Any = 0
    for item in items:
        total = small(total + number(item))
    return total


def _rounded(value: Any, digits: int = 0) -> Any:
    if not isinstance(digits, int) or abs(digits) > _MOST_DIGITS:
        raise FilterError(f"round takes at most {_MOST_DIGITS} digits, got {digits!r:.50}")
    return round(number(value), digits) if digits else round(number(value))


def _length(value: Any) -> int:
    return len(value) if isinstance(value, SIZED) else sum(1 for _ in value)


ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: _power,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
    ast.LShift: _shifted(True),
    ast.RShift: _shifted(False),
}
UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.Not: operator.not_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: operator.invert,
}
COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda item, items: operator.contains(items, item),
    ast.NotIn: lambda item, items: not operator.contains(items, item),
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}
MOST_ARGUMENTS = {"max": 100, "min": 100, "round": 2}
"""Of functions that take more than one value."""
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": lambda value: abs(number(value)),
    "all": _of_items(lambda items: all(map(truth, items)), np.all),
    "any": _of_items(lambda items: any(map(truth, items)), np.any),
    "bool": lambda value: bool(truth(value)),
    "float": lambda value: float(number(value)),
    "int": lambda value: int(number(value)),
    "isfinite": lambda value: math.isfinite(number(value)),
    "isinf": lambda value: math.isinf(number(value)),
    "isnan": lambda value: math.isnan(number(value)),
    "len": _length,
    "max": _of_items(_largest(max), np.max),
    "min": _of_items(_largest(min), np.min),
    "round": _rounded,
    "sqrt": lambda value: math.sqrt(number(value)),
    "sum": _of_items(_sum, lambda values: values.sum(dtype="f8" if values.dtype.kind == "f" else None)),
}
