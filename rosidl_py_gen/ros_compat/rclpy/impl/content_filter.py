"""Content filters of subscriptions: expressions in the SQL subset of DDS, as in Fast DDS without MATCH.

An expression is a list of conditions with AND and OR, evaluated from left to right; neither binds tighter. A condition
is a predicate, a list in parentheses, or NOT, which negates all conditions that follow it in its list. A predicate
compares a field with a field or value (``=``, ``<>``, ``!=``, ``<``, ``<=``, ``>``, ``>=``), tests a range (``BETWEEN 1
AND 5``, ``NOT BETWEEN``) or a text (``LIKE``, where ``%`` and ``*`` mean any characters, ``_`` and ``?`` one). A value
is a number, TRUE, FALSE, a text in quotes or a parameter, ``%0`` to ``%99``. Keywords are in upper or lower case.

``MATCH``, a regular expression of C++, is refused: Python reads some of them in another way, and a text of a peer could
take minutes.

Source: the grammar of Fast DDS, `DDSFilterGrammar.hpp`.
"""

from __future__ import annotations

import importlib
import logging
import operator
import re
import struct
import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy._rclpy_pybind11 import RCLError, RMWError
from rclpy.serialization import deserialize_message
from rosidl_py_gen.base.fieldtype import PRIMITIVES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen import runtime

    Condition = Callable[[Any], bool]

_TOKEN = re.compile(
    r"\s*(?:(?P<text>[`'][^'\r\n]*')|(?P<number>[+-]?(?:0[xX][0-9a-fA-F]{1,16}|\d+(?:\.\d+)?(?:[eE][+-]?\d+)?))"
    r"|(?P<parameter>%\d{1,2}(?!\d))"
    r"|(?P<operator><>|!=|<=|>=|[=<>])|(?P<bracket>[()])"
    r"|(?P<word>[A-Za-z]\w*(?:\[\d{1,10}\])?(?:\.[A-Za-z]\w*(?:\[\d{1,10}\])?)*))"
)
_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_KEYWORDS = {"AND", "OR", "NOT", "BETWEEN", "TRUE", "FALSE", "LIKE", "MATCH"}
_MAX_CHARACTERS = 10_000
"""Maximum length of a filter expression or parameter."""
_MAX_PATTERN = 1000
"""Maximum length of a LIKE pattern that is the value of a message's field; a longer pattern matches nothing."""
_LOGGER = logging.getLogger("rosidl_py_gen.rclpy")
_MAX_DEPTH = 100
"""Maximum depth of parentheses and NOT in an expression; deeper expressions would exhaust Python's stack."""
_MAX_PARAMETERS = 100
_MAX_AT_ONCE = 1000
"""Maximum number of messages that are filtered at once, so that a fast publisher does not block an executor."""
MIN_DEPTH = 100
"""Minimum number of unfiltered messages that a subscription with a content filter retains.

So messages of a burst that the filter refuses do not replace messages that it accepts. A larger number needs more
memory while no executor spins.
"""
_FLOATS = {name: primitive for name, primitive in PRIMITIVES.items() if primitive.python == "float"}
_KINDS = {
    "string": "text",
    # wchar is refused like wstring.
    **{one.idl: name if name in _FLOATS else one.python for name, one in PRIMITIVES.items() if name != "wchar"},
}
"""Kinds of operands by the IDL type of a field: bool, int, text, or the name of a type of floats."""
_ARRAY = re.compile(r"sequence<(?P<sequence>.+?)(?:, \d+)?>|(?P<array>.+)\[\d+\]")


class ContentFilterError(RCLError):
    """Raised for a filter expression that cannot be evaluated for the message type."""


class _Operand(NamedTuple):
    kind: str
    get: Callable[[Any], Any]
    """Function that returns the operand's value for a message; None if an array of the message is too short for the
    operand's index."""
    is_field: bool


@dataclass
class _Token:
    kind: str
    text: str


class ContentFilter:
    """Compiled content filter for one message type.

    Raises:
        RCLError: the expression or a parameter is invalid, or does not fit the fields of the type.
    """

    def __init__(self, msg_type: Any, expression: str, parameters: Sequence[str]) -> None:
        if not isinstance(expression, str) or isinstance(parameters, str):
            kinds = f"{type(expression).__name__} and {type(parameters).__name__}"
            raise ContentFilterError(f"content filter: got {kinds}; expected a text and a list of texts")
        if any(len(text) > _MAX_CHARACTERS for text in (expression, *map(str, parameters))):
            raise ContentFilterError(f"content filter: got more than {_MAX_CHARACTERS} characters; write it shorter")
        self.expression = expression
        self.parameters = list(parameters)
        self.matches = _Parser(msg_type, expression, self.parameters).condition()


class _Parser:
    def __init__(self, msg_type: Any, expression: str, parameters: list[str]) -> None:
        self._msg_type = msg_type
        self._expression = expression
        self._parameters = parameters
        if len(parameters) > _MAX_PARAMETERS:
            raise self._error(f"got {len(parameters)} parameters; expected at most {_MAX_PARAMETERS}")
        self._tokens = self._split(expression)
        self._position = 0

    def _error(self, text: str) -> ContentFilterError:
        return ContentFilterError(f"content filter {self._expression!r:.200}: {text}")

    def _split(self, text: str) -> list[_Token]:
        tokens, position, end = [], 0, len(text.rstrip())
        while position < end:
            match = _TOKEN.match(text, position, end)
            if match is None or match.lastgroup is None:
                raise self._error(f"got {text[position:end].lstrip()!r:.50}; expected a field, value or operator")
            kind, found = match.lastgroup, match[match.lastgroup]
            is_keyword = kind == "word" and found.upper() in _KEYWORDS and (found.isupper() or found.islower())
            tokens.append(_Token(kind, found.upper() if is_keyword else found))
            position = match.end()
        return tokens

    def _peek(self) -> _Token:
        return self._tokens[self._position] if self._position < len(self._tokens) else _Token("end", "")

    def _next(self) -> _Token:
        token = self._peek()
        self._position += 1
        return token

    def _accept(self, *texts: str) -> str | None:
        token = self._peek()
        if token.kind == "text" or token.text not in texts:
            return None
        self._position += 1
        return token.text

    def _unexpected(self, expected: str) -> ContentFilterError:
        return self._error(f"got {self._peek().text or 'the end'!r:.50}; expected {expected}")

    def condition(self) -> Condition:
        condition = self._conditions(0)
        if self._peek().kind != "end":
            raise self._unexpected("AND or OR")
        return condition

    def _conditions(self, depth: int) -> Condition:
        if depth > _MAX_DEPTH:
            raise self._error(f"got more than {_MAX_DEPTH} levels of parentheses and NOT; write it with fewer")
        conditions = [("AND", self._one_condition(depth))]
        while (joint := self._accept("AND", "OR")) is not None:
            conditions.append((joint, self._one_condition(depth)))
        if len(conditions) == 1:
            return conditions[0][1]

        def evaluate(message: Any) -> bool:
            result = True
            for joint, condition in conditions:
                if result is (joint == "AND"):  # else the result is known
                    result = condition(message)
            return result

        return evaluate

    def _one_condition(self, depth: int) -> Condition:
        if self._accept("("):
            inner = self._conditions(depth + 1)
            if not self._accept(")"):
                raise self._unexpected("')'")
            return inner
        if self._accept("NOT"):
            negated = self._conditions(depth + 1)
            return lambda message: not negated(message)
        return self._predicate()

    def _predicate(self) -> Condition:
        left = self._operand()
        is_inverted = bool(self._accept("NOT"))
        if self._accept("BETWEEN"):
            return self._between(left, is_inverted)
        if is_inverted:
            raise self._unexpected("BETWEEN")
        name = self._accept(*_OPERATORS, "LIKE")
        if self._accept("MATCH"):
            raise self._error("got MATCH, which is not supported; use LIKE, or filter in the callback")
        if name is None:
            raise self._unexpected("an operator")
        right = self._operand()
        if not (left.is_field or right.is_field):
            raise self._error("got a comparison of two values; expected a field on one side")
        if name == "LIKE":
            return self._like(left, right)
        return self._comparison(left, name, right)

    def _comparison(self, left: _Operand, name: str, right: _Operand) -> Condition:
        self._require_comparable(left.kind, right.kind)
        compare, get_left, get_right = _OPERATORS[name], left.get, right.get
        floats = {_FLOATS[kind] for kind in (left.kind, right.kind) if kind in _FLOATS}
        narrowest = min(floats, key=lambda primitive: primitive.size, default=None)
        # A Python float has the precision of a double.
        if narrowest is not None and narrowest.code != "d":
            # The other side is rounded, so that a field can equal 0.1.
            get_left, get_right = (_rounded(operand, narrowest.code) for operand in (left, right))

        def evaluate(message: Any) -> bool:
            one, other = get_left(message), get_right(message)
            return one is not None and other is not None and bool(compare(one, other))

        return evaluate

    def _between(self, field: _Operand, is_inverted: bool) -> Condition:
        if not field.is_field:
            raise self._error("got a value before BETWEEN; expected a field")
        low = self._value()
        if not self._accept("AND"):
            raise self._unexpected("AND")
        at_least, at_most = self._comparison(field, ">=", low), self._comparison(field, "<=", self._value())
        get = field.get

        def evaluate(message: Any) -> bool:
            return get(message) is not None and (at_least(message) and at_most(message)) is not is_inverted

        return evaluate

    def _like(self, left: _Operand, right: _Operand) -> Condition:
        if (left.kind, right.kind) != ("text", "text"):
            raise self._error(f"got {left.kind} LIKE {right.kind}; expected texts")
        get_text, get_pattern = left.get, right.get
        if not right.is_field:
            is_like = _matcher(get_pattern(None))

            def matches_constant(message: Any) -> bool:
                text = get_text(message)
                return text is not None and is_like(text)

            return matches_constant

        def matches_field(message: Any) -> bool:
            text, pattern = get_text(message), get_pattern(message)
            return text is not None and pattern is not None and len(pattern) <= _MAX_PATTERN and _matcher(pattern)(text)

        return matches_field

    def _require_comparable(self, one: str, other: str) -> None:
        families = {kind.rstrip("0123456789") for kind in (one, other)}
        if len(families) > 1 and families not in ({"bool", "int"}, {"int", "float"}):
            raise self._error(f"got a comparison of {one} with {other}; expected the same kind of values")

    def _operand(self) -> _Operand:
        token = self._peek()
        if token.kind == "word" and token.text not in _KEYWORDS:
            self._next()
            return self._field(token.text)
        return self._value()

    def _value(self) -> _Operand:
        token = self._peek()
        if token.kind == "parameter":
            self._next()
            index = int(token.text[1:])
            if index >= len(self._parameters):
                raise self._error(f"got {token.text}, but {len(self._parameters)} parameters; pass one for each number")
            return self._parameter(self._parameters[index], index)
        value = _literal(token)
        if value is None:
            raise self._unexpected("a field, number, text in quotes, TRUE, FALSE or parameter")
        self._next()
        return value

    def _parameter(self, text: Any, index: int) -> _Operand:
        match = _TOKEN.fullmatch(text) if isinstance(text, str) else None
        value = None if match is None or match.lastgroup is None else _literal(_Token(match.lastgroup, text.strip()))
        if value is None:
            raise self._error(
                f"parameter %{index}: got {text!r:.100}; expected a number, TRUE, FALSE or a text in quotes, as \"'x'\""
            )
        return value

    def _field(self, path: str) -> _Operand:
        cls, steps, ros_type = self._msg_type, [], ""
        parts = path.split(".")
        for number, part in enumerate(parts):
            name, _, index = part.rstrip("]").partition("[")
            types = cls.get_fields_and_field_types()
            if name not in types:
                raise self._error(f"got the field {path!r}; {cls.__name__} has the fields {', '.join(types)}")
            ros_type = types[name]
            array = _ARRAY.fullmatch(ros_type)
            if bool(array) is not bool(index):
                expected = "an index, as in field[0]" if array else "no index"
                raise self._error(f"got {path!r}; {name} is {ros_type}: expected {expected}")
            ros_type = ros_type if array is None else array["sequence"] or array["array"]
            steps.append((name, int(index) if index else None))
            if "/" in ros_type and number < len(parts) - 1:
                package, _, type_name = ros_type.partition("/")
                cls = getattr(importlib.import_module(f"{package}.msg"), type_name.rpartition("/")[2])
            elif number < len(parts) - 1:
                raise self._error(f"got {path!r}; {name} is {ros_type}, which has no fields")
        kind = _KINDS.get(re.sub(r"<.*", "", ros_type))
        if kind is None:
            raise self._error(f"got {path!r}, which is {ros_type}; expected a number, bool or string")
        return _Operand(kind, _getter(steps), True)


def _matcher(pattern: str) -> Callable[[str], bool]:
    """Return a function that tests a text against a LIKE pattern; each part of the pattern takes linear time.

    The parts between ``%`` and ``*`` have fixed lengths. The first part must match at the beginning and the last part
    at the end of the text; the others are searched from left to right, each after the previous one.
    """
    parts = re.split("[%*]+", pattern)
    compiled = [re.compile(re.sub("[_?]", ".", re.escape(part)), re.DOTALL) for part in parts]
    first, *middle, last = compiled if len(compiled) > 1 else [*compiled, re.compile("")]
    last_length = len(parts[-1])

    def matches(text: str) -> bool:
        if len(compiled) == 1:
            return first.fullmatch(text) is not None
        found = first.match(text)
        for part in middle:
            found = found and part.search(text, found.end())
        start = len(text) - last_length
        return found is not None and start >= found.end() and last.match(text, start) is not None

    return matches


def _literal(token: _Token) -> _Operand | None:
    """Return the operand for a constant in a filter expression, given as a token.

    Returns None if the token is not a constant.
    """
    value: bool | int | float | str
    kind: str
    if token.kind == "word" and token.text in ("TRUE", "FALSE", "true", "false"):
        kind, value = "bool", token.text.upper() == "TRUE"
    elif token.kind == "text":
        kind, value = "text", token.text[1:-1]
    elif token.kind != "number":
        return None
    elif "x" in token.text.lower():
        kind, value = "int", int(token.text, 16)
    elif re.fullmatch(r"[+-]?\d{1,20}", token.text):
        kind, value = "int", int(token.text)
    else:
        kind, value = "float64", float(token.text)
    return _Operand(kind, lambda _: value, False)


def _getter(steps: Sequence[tuple[str, int | None]]) -> Callable[[Any], Any]:
    def get(message: Any) -> Any:
        value = message
        for name, index in steps:
            value = getattr(value, name)
            if index is not None:
                if index >= len(value):
                    return None
                value = value[index]
        return value[0] if isinstance(value, bytes) else value

    return get


def _rounded(operand: _Operand, code: str) -> Callable[[Any], Any]:
    """Return a function like the `get` of an operand, with its result rounded to the float of a struct code."""
    if operand.kind in _FLOATS and _FLOATS[operand.kind].code == code:
        return operand.get
    rounding = struct.Struct("<" + code)

    def get(message: Any) -> float | None:
        value = operand.get(message)
        if value is None:
            return None
        try:
            rounded: float = rounding.unpack(rounding.pack(value))[0]
        except OverflowError:
            return float("inf") if value > 0 else float("-inf")
        return rounded

    return get


class FilteredMessages:
    """Received messages of a subscription that its content filter accepts. Thread: any.

    Args:
        subscription: subscription of the runtime; several threads may take from it.
        msg_type: class of the messages.
        raw: True if the subscription returns bytes.
        depth: number of accepted messages that are retained; None: all.
    """

    def __init__(
        self, subscription: runtime.Subscription[Any], msg_type: type[Any], *, raw: bool, depth: int | None
    ) -> None:
        self.filter: ContentFilter | None = None
        self._subscription, self._msg_type, self._raw = subscription, msg_type, raw
        self._accepted: deque[tuple[Any, runtime.MessageInfo]] = deque(maxlen=depth)
        self._lock = threading.Lock()
        self._name, self._has_warned = subscription.topic, False

    def has_messages(self) -> bool:
        """Filter received messages; return True if accepted messages were not taken yet."""
        with self._lock:  # keeps the order of messages
            for _ in range(_MAX_AT_ONCE):
                if (item := self._subscription.take_with_info()) is None:
                    break
                if self._is_accepted(item[0]):
                    self._accepted.append(item)
        return bool(self._accepted)

    def _is_accepted(self, message: Any) -> bool:
        used = self.filter  # another thread may replace it
        if used is None:
            return True
        try:
            return used.matches(deserialize_message(message, self._msg_type) if self._raw else message)
        except RMWError as error:  # a message must not end the executor
            if not self._has_warned:
                self._has_warned = True
                _LOGGER.warning("content filter %.200r refuses a message of %s: %s", used.expression, self._name, error)
            return False

    def is_ready(self) -> bool:
        """Return True if accepted messages can be taken, or received messages have not been filtered yet."""
        return bool(self._accepted) or self._subscription.is_ready

    def take(self) -> tuple[Any, runtime.MessageInfo] | None:
        """Return the oldest accepted message, or None."""
        try:
            return self._accepted.popleft() if self.has_messages() else None
        except IndexError:  # another thread was faster
            return None
