"""Expressions over a message: conditions such as ``m.pose.position.x > 1``, and paths such as ``poses[0].position``.

An expression is a Python expression of the node types in `_IN_FILTERS`, with fields of messages and calls of
`FUNCTIONS`. Any other text is rejected before the first message; an expression is compiled and run by Python. Messages
come from untrusted peers, so products and powers are limited, and loops end when a message has taken too much CPU time
of the thread. The time of other threads and processes does not count, as it is high on a busy machine.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Iterator
from time import thread_time
from typing import Any, NoReturn, TypeAlias, cast

import numpy as np

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import did_you_mean, py_name
from rosidl_py_gen.cdr import Field, Message
from rosidl_py_gen.errors import RosidlError

_MAX_TEXT = 1000
_MAX_DEPTH = 40
_MAX_BITS = 256
_MAX_CONSTANT = 64
MAX_CPU_S = 1.0
_CHECK_INTERVAL = 16
"""Number of loop elements in an expression between two checks of the CPU time. A check takes 0.3 µs, as a short
expression does."""
_IN_PATHS = (ast.Attribute, ast.Subscript, ast.Name, ast.Constant, ast.Slice, ast.UnaryOp, ast.USub)
_IN_FILTERS = (
    *(*_IN_PATHS, ast.BinOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Tuple, ast.List, ast.Set, ast.Call),
    *(ast.GeneratorExp, ast.comprehension, ast.operator, ast.unaryop, ast.boolop, ast.cmpop),
)
_Shape: TypeAlias = "type[Message] | Field | None"
"""Static type of a value in an expression: a message class, the field with the value or with an array of such values,
or None."""


class FilterError(RosidlError, ValueError):
    """Raised for an expression that is not allowed, refers to an unknown name, or has no value for a message."""


def compile_filter(text: str, cls: type[Message]) -> Callable[[Message], bool]:
    """Compile a condition such as ``m.x > 1`` to a function that tests messages of a class.

    Raises `FilterError` if the condition is not allowed; the function raises `FilterError` if the condition has no
    value for a message.
    """
    value = _compiled(_ExpressionChecker(text.strip(), cls).checked(_IN_FILTERS))
    return lambda message: bool(value(message))


def compile_path(text: str, cls: type[Message]) -> tuple[Callable[[Message], Any], Field | None]:
    """Return a function that reads the value at a path such as ``poses[0].position``, and the field of the value.

    The field of an element is the field of its array; for a message, the field is None. Raises `FilterError` if the
    path is invalid.
    """
    spelled = re.sub(r"[^\W\d]\w*", lambda name: py_name(name[0]), text.strip().strip("."))
    try:
        check = _ExpressionChecker(f"m.{spelled}", cls)
        body = check.checked(_IN_PATHS)
        shape = check.shape()
        return _compiled(_bare(body)), None if isinstance(shape, type) else shape
    except FilterError as error:
        reason = re.sub(r"^column \d+: ", "", str(error))
        raise FilterError(f'"{text[:_MAX_TEXT]}" is not the path of a field: {reason}') from None


def _compiled(body: ast.expr) -> Callable[[Message], Any]:
    names = ast.arguments([], [ast.arg("m"), ast.arg("_end")], None, [], [], None, [])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        code = compile(ast.fix_missing_locations(ast.Expression(ast.Lambda(names, body))), "<expression>", "eval")
    function = eval(code, {"__builtins__": {}, **FUNCTIONS, **_HELPERS})

    def value(message: Message) -> Any:
        try:
            return function(message, thread_time() + MAX_CPU_S)
        except FilterError:
            raise
        except (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError) as error:
            raise FilterError(str(error) or type(error).__name__) from None

    return value


class _ExpressionChecker(ast.NodeTransformer):
    """Transformer that rejects forbidden syntax, and inserts calls of `_HELPERS` that check values of each message.

    Arrays of numpy become lists, which compare as in Python, except where a function takes them as arrays (`_bare`).
    """

    def __init__(self, text: str, cls: type[Message]) -> None:
        self._text = text
        self._known: dict[str, _Shape] = {"m": cls}

    def checked(self, allowed: tuple[type[ast.AST], ...]) -> Any:
        """Return the syntax tree with inserted calls of helpers; raises `FilterError` for nodes not `allowed`."""
        body = _parsed(self._text)
        level: list[ast.AST] = [body]
        for _ in range(_MAX_DEPTH):
            for node in level:
                if not isinstance(node, allowed) or isinstance(getattr(node, "op", None), ast.MatMult):
                    self._refuse(node, f"`{self._source(node)}` is not allowed")
            children = (child for node in level for child in ast.iter_child_nodes(node))
            level = [child for child in children if not isinstance(child, ast.expr_context)]
        if level:
            self._refuse(body, "nested too deeply")
        return self.visit(body)

    def shape(self) -> _Shape:
        """Return the static type of the value of the expression."""
        return self._shape(_parsed(self._text))

    def _refuse(self, node: ast.AST, reason: str) -> NoReturn:
        column = len(self._text.encode()[: getattr(node, "col_offset", 0)].decode(errors="ignore")) + 1
        raise FilterError(f"column {column}: {reason}")

    def _source(self, node: ast.AST) -> str:
        return (ast.get_source_segment(self._text, node) or "")[:80]

    def _shape(self, node: ast.expr) -> _Shape:
        match node:
            case ast.Name():
                return self._known.get(node.id)
            case ast.Attribute() if field := self._known_field(node):
                return field.cls if field.cls is not None and field.type.arity is Arity.SCALAR else field
            case ast.Subscript():
                shape = self._shape(node.value)
                element = self._element(node.value, shape)
                return shape if isinstance(node.slice, ast.Slice) else element
        return None

    def _element(self, node: ast.expr, shape: _Shape) -> _Shape:
        if isinstance(shape, type):
            self._refuse(node, f"{self._source(node)} is {shape._TYPE.name}, which has no elements")
        return shape and (shape.cls or shape._replace(type=shape.type.element))

    def _known_field(self, node: ast.Attribute) -> Field | None:
        shape, name = self._shape(node.value), node.attr
        if shape is None and not name.startswith("_"):
            return None
        text = self._source(node.value)
        if shape is None or isinstance(shape, Field):
            self._refuse(node, f"{text} is {shape.type if shape else 'no message'}, which has no fields")
        if field := _field(shape, name):
            return field
        names = [field.ros_name for field in shape._TYPE.fields]
        hint = did_you_mean(name, names) or f"; it has {', '.join(names) or 'none'}"
        self._refuse(node, f'{text} is {shape._TYPE.name}, which has no field "{name}"{hint}')

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if not (node.value is None or isinstance(node.value, int | float | str)):
            self._refuse(node, f"`{self._source(node)}` is not allowed")
        if isinstance(node.value, int) and node.value.bit_length() > _MAX_BITS:
            self._refuse(node, f"a number of more than {_MAX_BITS} bits")
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id not in self._known:
            hint = f"; {node.id}(...) is a function" if node.id in FUNCTIONS else "; the message is m"
            self._refuse(node, f'there is no "{node.id}"{hint}')
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        field = self._known_field(node)
        node.value = self.visit(node.value)
        if field is None:
            return _call("_read", node.value, ast.Constant(node.attr))
        node.attr = field.py_name
        return node if field.type.arity is Arity.SCALAR else _with_time_limit("_list", node)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        if isinstance(node.slice, ast.Slice) and node.slice.step is not None:
            self._refuse(node, "a step between elements is not allowed")
        self._shape(node)
        node.value, node.slice = _bare(self.visit(node.value)), self.visit(node.slice)
        return (
            _with_time_limit("_list", node)
            if isinstance(node.slice, ast.Slice)
            else _call("_at", node.value, node.slice)
        )

    def visit_Tuple(self, node: ast.Tuple | ast.List | ast.Set) -> ast.expr:
        return ast.List([self.visit(item) for item in node.elts], ast.Load())

    visit_List = visit_Set = visit_Tuple

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        shapes = [self._shape(value) for value in (node.left, *node.comparators)]
        if any(shape if not isinstance(shape, Field) else shape.cls for shape in shapes):
            self._refuse(node, "messages cannot be compared; compare their fields")
        return self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        if isinstance(node.op, ast.Pow | ast.LShift):
            self._require_small(node.right)
        node.left, node.right = self._as_number(node.left), self._as_number(node.right)
        return _call("_limited", node) if isinstance(node.op, ast.Mult | ast.Pow | ast.LShift) else node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS:
            self._refuse(node, f"{self._source(node.func)}(...) is not allowed; there are {', '.join(FUNCTIONS)}")
        max_values = {"max": 100, "min": 100, "round": 2}.get(name, 1)
        if not 0 < len(node.args) <= max_values:
            self._refuse(node, f"{name} takes {'one value' if max_values == 1 else f'1 to {max_values} values'}")
        for digits in node.args[1:] if name == "round" else ():
            self._require_small(digits)
        visit = self._as_number if FUNCTIONS[name] in _OF_NUMBERS else self.visit
        node.args = [visit(value) for value in node.args]
        if name in _OF_ARRAYS and len(node.args) == 1:
            node.args = [_bare(node.args[0])]
        return node

    def visit_GeneratorExp(self, node: ast.GeneratorExp) -> ast.expr:
        (loop, *more) = node.generators
        if more or not isinstance(loop.target, ast.Name) or len(self._known) > 1 or loop.is_async:
            self._refuse(node, "only one `for name in ...` is allowed, none inside another")
        name, element = loop.target.id, self._element(loop.iter, self._shape(loop.iter))
        if name in self._known or name in FUNCTIONS or (name[0] == "_" and name != "_"):
            self._refuse(loop.target, f"`for {name}`: the name means something already")
        loop.iter = _with_time_limit("_each", _bare(self.visit(loop.iter)))
        self._known[name] = element
        node.elt, loop.ifs = self.visit(node.elt), [self.visit(test) for test in loop.ifs]
        del self._known[name]
        return node

    def _as_number(self, node: ast.expr) -> ast.expr:
        shape, visited = self._shape(node), self.visit(node)
        is_number = isinstance(node, ast.BinOp) or isinstance(getattr(node, "value", None), int | float)
        if isinstance(shape, Field):
            is_number = shape.type.arity is Arity.SCALAR and shape.type.primitive is not None
        return cast("ast.expr", visited) if is_number else _call("_number", visited)

    def _require_small(self, node: ast.expr) -> None:
        value = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else node
        number = value.value if isinstance(value, ast.Constant) else None
        if not isinstance(number, int | float) or number > _MAX_CONSTANT:
            self._refuse(node, f"expected a constant up to {_MAX_CONSTANT}")


def _parsed(text: str) -> ast.expr:
    if len(text) > _MAX_TEXT:
        raise FilterError(f"an expression of {len(text)} characters; at most {_MAX_TEXT} are allowed")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text, mode="eval").body
    except SyntaxError as error:
        reason = f"column {error.offset or len(text) + 1}: {error.msg}"
    except (ValueError, RecursionError, MemoryError) as error:
        reason = str(error) or "nested too deeply"
    raise FilterError(f'"{text}" is not an expression: {reason}')


def _field(cls: type[Message], name: str) -> Field | None:
    return next((field for field in cls._TYPE.fields if name in (field.ros_name, field.py_name)), None)


def _call(name: str, *values: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(name, ast.Load()), list(values), [])


def _with_time_limit(name: str, node: ast.expr) -> ast.expr:
    return _call(name, node, ast.Name("_end", ast.Load()))


def _bare(node: ast.expr) -> ast.expr:
    is_list = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "_list"
    return cast("ast.Call", node).args[0] if is_list else node


# Helpers that are called for each message.


def _list(value: Any, end: float) -> Any:
    if thread_time() > end:
        raise FilterError(f"takes more than {MAX_CPU_S:g} s of CPU time for one message")
    return value.tolist() if isinstance(value, np.ndarray) else value


def _each(items: Any, end: float) -> Iterator[Any]:
    for number, item in enumerate(_list(items, end)):
        if not number % _CHECK_INTERVAL:
            _list((), end)
        yield item


def _at(items: Any, index: Any) -> Any:
    if not isinstance(index, int) or not -len(items) <= index < len(items):
        raise FilterError(f"there is no element {index!r:.50} among {len(items)}")
    return items.item(int(index)) if isinstance(items, np.ndarray) else items[index]


def _read(value: Any, name: str) -> Any:
    field = _field(type(value), name) if isinstance(value, Message) else None
    if field is None:
        raise FilterError(f'{type(value).__name__} has no field "{name}"')
    return _list(getattr(value, field.py_name), math.inf)


def _number(value: Any) -> Any:
    if not isinstance(value, int | float):
        raise FilterError(f"expected a number, found {type(value).__name__}")
    return value


def _limited(value: Any) -> Any:
    if isinstance(value, complex):
        raise FilterError("the root of a negative number")
    if isinstance(value, int) and value.bit_length() > _MAX_BITS:
        raise FilterError(f"a number of more than {_MAX_BITS} bits")
    return value


def _of_array(function: Callable[..., Any], of_array: Callable[[Any], Any]) -> Callable[..., Any]:
    """Return a function that calls `of_array` if its first argument is a numpy array, and calls `function`
    otherwise.
    """
    return lambda *values: of_array(values[0]).item() if isinstance(values[0], np.ndarray) else function(*values)


def _sum(values: Any) -> Any:
    with np.errstate(all="ignore"):  # numpy would print warnings about infinities
        return values.sum(dtype="f8" if values.dtype.kind == "f" else None)


_HELPERS = {"_at": _at, "_each": _each, "_limited": _limited, "_list": _list, "_number": _number, "_read": _read}
_OF_NUMBERS = (abs, float, int, math.isfinite, math.isinf, math.isnan, round, math.sqrt)
_OF_ARRAYS: dict[str, Callable[..., Any]] = {
    "len": lambda items: sum(1 for _ in items) if isinstance(items, Iterator) else len(items),
    "max": _of_array(max, np.max),
    "min": _of_array(min, np.min),
    "sum": _of_array(sum, _sum),
}
FUNCTIONS = dict(sorted({**_OF_ARRAYS, **{one.__name__: one for one in (*_OF_NUMBERS, all, any, bool)}}.items()))
