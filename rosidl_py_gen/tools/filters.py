"""Expressions over a message: conditions such as ``m.pose.position.x > 1``, and paths such as ``poses[0].position``.

Decides what an expression may do: read fields and elements, compute with numbers, compare, and call the functions of
`FUNCTIONS`. It is parsed with `ast` and interpreted; everything that is not listed here is refused before the first
message. The limits of numbers and of the work for one message are in `filter_values.py`. So no expression runs code,
hangs or takes memory.
"""

from __future__ import annotations

import ast
import operator
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NoReturn, TypeAlias

from rosidl_py_gen.cdr import Field, Message
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.fieldtype import Arity
from rosidl_py_gen.names import did_you_mean, py_name
from rosidl_py_gen.tools.filter_values import (
    ARITHMETIC,
    COMPARE,
    FUNCTIONS,
    MOST_ARGUMENTS,
    UNARY,
    FilterError,
    Run,
    Value,
    comparable,
    element,
    elements,
    field_of,
    number,
    part,
    read,
    scalar,
    small,
    truth,
)

_MOST_TEXT, _MOST_DEPTH = 1000, 40
_Shape: TypeAlias = "type[Message] | Field | None"
"""What is known before the first message: a message, a field that is none, or nothing."""


def compile_filter(text: str, cls: type[Message]) -> Callable[[Message], bool]:
    """A condition on messages of a class, which are called ``m`` in it.

    Raises:
        FilterError: says what is wrong, and in which column. The condition itself raises it when it has no value for
            a message, such as for an element that is not there.
    """
    value = _compiled(_parse(text, text), cls)

    def holds(message: Message) -> bool:
        return bool(truth(_evaluated(value, message)))

    return holds


def compile_path(text: str, cls: type[Message]) -> Callable[[Message], Any]:
    """What a path such as ``poses[0].position`` leads to in messages of a class.

    Raises:
        FilterError: as `compile_filter`.
    """
    spelled = re.sub(r"[^\W\d]\w*", lambda found: py_name(found[0]), text.strip().strip("."))
    tree = _parse(f"m.{spelled}", text)
    for node in ast.walk(tree.body):
        if not isinstance(node, _IN_PATHS):
            raise FilterError(f'"{text}" is not the path of a field; expected names with . and [index] between them')
    try:
        value = _compiled(tree, cls)
    except FilterError as error:
        raise FilterError(f'"{text}": {str(error).partition(": ")[2] or error}') from None
    return lambda message: _evaluated(value, message)


_IN_PATHS = (ast.Attribute, ast.Subscript, ast.Name, ast.Constant, ast.Slice, ast.UnaryOp, ast.USub, ast.Load)


def _parse(text: str, shown: str) -> ast.Expression:
    if len(text) > _MOST_TEXT:
        raise FilterError(f"an expression of {len(text)} characters; at most {_MOST_TEXT} are taken")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text.strip(), mode="eval")
    except SyntaxError as error:
        raise FilterError(
            f'"{shown}" is not an expression: column {error.offset or len(text) + 1}: {error.msg}'
        ) from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise FilterError(f'"{shown}" is not an expression: {error or "nested too deeply"}') from None


def _compiled(tree: ast.Expression, cls: type[Message]) -> Value:
    try:
        return _Compiler(cls).value(tree.body)[0]
    except RecursionError:  # while the refused part was to be shown
        raise FilterError("nested too deeply") from None


def _evaluated(value: Value, message: Message) -> Any:
    try:
        return value(Run(message))
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        if isinstance(error, RosidlError):
            raise
        raise FilterError(str(error)) from None


# ---------------------------------------------------------------------------------------------------- what compiles it


class _Compiler:
    """Turns parsed expressions into functions of a run."""

    def __init__(self, cls: type[Message]) -> None:
        self._known: dict[str, _Shape] = {"m": cls}
        self._depth = 0

    def value(self, node: ast.expr) -> tuple[Value, _Shape]:
        """The function that computes a node, and what is known of its answer."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            _refuse(node, f"`{ast.unparse(node)}` is not allowed in an expression")
        self._depth += 1
        if self._depth > _MOST_DEPTH:
            _refuse(node, "nested too deeply")
        made = method(node)
        self._depth -= 1
        return made if isinstance(made, tuple) else (made, None)

    def _plain(self, node: ast.expr) -> Value:
        return self.value(node)[0]

    # ----------------------------------------------------------------------------------------------------- reading

    def _constant(self, node: ast.Constant) -> Value:
        value = node.value
        if not (value is None or isinstance(value, bool | int | float | str)):
            _refuse(node, f"`{ast.unparse(node)}` is not allowed in an expression")
        small(value)
        return lambda run: value

    def _name(self, node: ast.Name) -> tuple[Value, _Shape]:
        name = node.id
        if name not in self._known:
            hint = f"; {name}(...) is a function" if name in FUNCTIONS else "; the message is m"
            _refuse(node, f'there is no "{name}"{hint}')
        return lambda run: run.names[name], self._known[name]

    def _attribute(self, node: ast.Attribute) -> tuple[Value, _Shape]:
        base, shape = self.value(node.value)
        name, text = node.attr, ast.unparse(node.value)
        if isinstance(shape, Field):
            _refuse(node, f"{text} is {shape.type}, which has no fields")
        if shape is not None:
            field = field_of(shape, name)
            if field is None:
                names = [one.ros_name for one in shape._TYPE.fields]
                hint = did_you_mean(name, names) or f"; it has {', '.join(names) or 'none'}"
                _refuse(node, f'{text} is {shape._TYPE.name}, which has no field "{name}"{hint}')
            is_message = field.cls is not None and field.type.arity is Arity.SCALAR
            return _reader(base, field.py_name), field.cls if is_message else field
        return lambda run: read(base(run), name, text), None

    def _subscript(self, node: ast.Subscript) -> tuple[Value, _Shape]:
        base, shape = self.value(node.value)
        if not isinstance(shape, Field) and shape is not None:
            _refuse(node, f"{ast.unparse(node.value)} is {shape._TYPE.name}, which has no elements")
        if isinstance(node.slice, ast.Slice):
            bounds = [None if part is None else self._plain(part) for part in (node.slice.lower, node.slice.upper)]
            if node.slice.step is not None:
                _refuse(node, "a step between elements is not allowed")
            return lambda run: part(run, base(run), bounds), shape
        index = self._plain(node.slice)
        return lambda run: element(base(run), index(run)), shape.cls if isinstance(shape, Field) else None

    def _tuple(self, node: ast.Tuple | ast.List | ast.Set) -> Value:
        items = [self._plain(item) for item in node.elts]
        return lambda run: [item(run) for item in items]

    _list = _set = _tuple

    # --------------------------------------------------------------------------------------------------- computing

    def _binop(self, node: ast.BinOp) -> Value:
        left, right, function = self._plain(node.left), self._plain(node.right), ARITHMETIC.get(type(node.op))
        if function is None:
            _refuse(node, f"`{ast.unparse(node)}` is not allowed in an expression")
        return lambda run: small(function(number(left(run)), number(right(run))))

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        value, function = self._plain(node.operand), UNARY[type(node.op)]
        if function is operator.not_:
            return lambda run: not truth(value(run))
        return lambda run: function(number(value(run)))

    def _boolop(self, node: ast.BoolOp) -> Value:
        values = [self._plain(value) for value in node.values]
        if isinstance(node.op, ast.And):
            return lambda run: all(truth(value(run)) for value in values)
        return lambda run: any(truth(value(run)) for value in values)

    def _compare(self, node: ast.Compare) -> Value:
        first = self._plain(node.left)
        others = [(COMPARE[type(op)], self._plain(value)) for op, value in zip(node.ops, node.comparators, strict=True)]

        def holds(run: Run) -> bool:
            left = first(run)
            for function, value in others:
                right = value(run)
                run.pay(left)
                run.pay(right)
                if not function(comparable(left), comparable(right)):
                    return False
                left = right
            return True

        return holds

    def _ifexp(self, node: ast.IfExp) -> Value:
        test, then, otherwise = self._plain(node.test), self._plain(node.body), self._plain(node.orelse)
        return lambda run: then(run) if truth(test(run)) else otherwise(run)

    # ---------------------------------------------------------------------------------------------------- functions

    def _call(self, node: ast.Call) -> Value:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        function = FUNCTIONS.get(name)
        if function is None:
            _refuse(node, f"{ast.unparse(node.func)}(...) is not allowed; there are {', '.join(FUNCTIONS)}")
        most = MOST_ARGUMENTS.get(name, 1)
        if node.keywords or any(isinstance(item, ast.Starred) for item in node.args) or not 0 < len(node.args) <= most:
            _refuse(node, f"{name} takes {'one value' if most == 1 else f'1 to {most} values'}")
        if len(node.args) == 1 and isinstance(node.args[0], ast.GeneratorExp):
            items = self._generator(node.args[0])
            return lambda run: small(function(items(run)))
        arguments = [self._plain(item) for item in node.args]

        def call(run: Run) -> Any:
            values = [argument(run) for argument in arguments]
            for value in values:
                run.pay(value, in_python=True)
            return small(function(*values))

        return call

    def _generator(self, node: ast.GeneratorExp) -> Callable[[Run], Iterator[Any]]:
        """``... for x in m.field if ...`` as the argument of a function; one deep, so that its cost is seen."""
        (loop, *more) = node.generators
        if more or not isinstance(loop.target, ast.Name) or len(self._known) > 1 or loop.is_async:
            _refuse(node, "only one `for name in ...` is allowed, none inside another")
        name, (source, shape) = loop.target.id, self.value(loop.iter)
        if name in self._known or name in FUNCTIONS:
            _refuse(loop.target, f"`for {name}`: the name means something already")
        self._known[name] = shape.cls if isinstance(shape, Field) else None
        item, tests = self._plain(node.elt), [self._plain(test) for test in loop.ifs]
        del self._known[name]

        def items(run: Run) -> Iterator[Any]:
            for value in elements(source(run)):
                run.pay(None)
                run.names[name] = value
                if all(truth(test(run)) for test in tests):
                    yield item(run)

        return items


def _refuse(node: ast.expr, reason: str) -> NoReturn:
    raise FilterError(f"column {node.col_offset + 1}: {reason}")


def _reader(base: Value, name: str) -> Value:
    return lambda run: scalar(getattr(base(run), name))
