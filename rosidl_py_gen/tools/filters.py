"""Expressions over a message: conditions such as ``m.pose.position.x > 1``, and paths such as ``poses[0].position``.

Decides what an expression may do: read fields and elements, compute with numbers, compare, and call `FUNCTIONS`.
Python parses it; what is not listed here is refused before the first message, and so is every name that is no field.
What is left runs as Python's own. It can neither call anything else nor take long: powers have bounds, and what takes
as long as an array may not be asked again for each element of another.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable
from typing import Any, NoReturn, TypeAlias, cast

import numpy as np

from rosidl_py_gen.cdr import Field, Message
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.fieldtype import Arity
from rosidl_py_gen.names import did_you_mean, py_name

_MAX_TEXT, _MAX_DEPTH, _MAX_EXPONENT, _MAX_DIGITS, _MAX_ARGUMENTS = 1000, 40, 64, 20, 100
_Shape: TypeAlias = "type[Message] | Field | None"
"""What an expression is: a message, a field that is none, or something that has no fields."""
_ALLOWED = (
    *(ast.BoolOp, ast.boolop, ast.UnaryOp, ast.unaryop, ast.IfExp, ast.Tuple, ast.List, ast.Set, ast.Slice),
    ast.expr_context,
)
_IN_PATHS = (ast.Attribute, ast.Subscript, ast.Name, ast.Constant, ast.Slice, ast.UnaryOp, ast.USub, ast.Load)


class FilterError(RosidlError, ValueError):
    """The user's expression is not allowed, names what does not exist, or has no value for a message."""


def compile_filter(text: str, cls: type[Message]) -> Callable[[Message], bool]:
    """A condition on messages of a class, which are called ``m`` in it.

    Raises:
        FilterError: says what is wrong, and in which column. The condition itself raises it when it has no value for
            a message, such as for an element that is not there.
    """
    value = _compiled(_parse(text, text), cls)
    return lambda message: bool(value(message))


def compile_path(text: str, cls: type[Message]) -> Callable[[Message], Any]:
    """What a path such as ``poses[0].position`` leads to in messages of a class.

    Raises:
        FilterError: as `compile_filter`.
    """
    spelled = re.sub(r"[^\W\d]\w*", lambda found: py_name(found[0]), text.strip().strip("."))
    tree = _parse(f"m.{spelled}", text)
    if not all(isinstance(node, _IN_PATHS) for node in ast.walk(tree.body)):
        raise FilterError(f'"{text}" is not the path of a field; expected names with . and [index] between them')
    try:
        value = _compiled(tree, cls)
    except FilterError as error:
        raise FilterError(f'"{text}": {str(error).partition(": ")[2] or error}') from None
    return lambda message: np.asarray(found) if isinstance(found := value(message), memoryview) else found


def _parse(text: str, shown: str) -> ast.Expression:
    if len(text) > _MAX_TEXT:
        raise FilterError(f"an expression of {len(text)} characters; at most {_MAX_TEXT} are taken")
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


def _compiled(tree: ast.Expression, cls: type[Message]) -> Callable[[Message], Any]:
    try:
        body = _Checker(cls).visit(tree.body)
    except RecursionError:  # while the refused part was to be shown
        raise FilterError("nested too deeply") from None
    tree.body = ast.parse("lambda m: 0", mode="eval").body
    tree.body.body = body  # type: ignore[attr-defined]
    names = {"__builtins__": {}, **FUNCTIONS, **_PUT_IN}
    function = eval(compile(ast.fix_missing_locations(tree), "<filter>", "eval"), names)

    def value(message: Message) -> Any:
        try:
            return function(message)
        except IndexError:
            raise FilterError("there is no such element") from None
        except (ArithmeticError, TypeError, ValueError) as error:
            raise FilterError(str(error)) from None

    return value


class _Checker(ast.NodeTransformer):
    """Refuses what is not allowed, and lets arrays be read as `memoryview`: its elements are Python's own numbers."""

    def __init__(self, cls: type[Message]) -> None:
        self._known: dict[str, _Shape] = {"m": cls}
        self._depth = 0
        self._is_looked_at = ast.expr()
        """Of this an element or the length is asked for, not all."""

    def visit(self, node: ast.AST) -> Any:
        """Check a node; what is known of its value is left in its `shape`."""
        method = getattr(self, f"visit_{type(node).__name__}", None)
        if method is None and not isinstance(node, _ALLOWED):
            _refuse(node, f"`{ast.unparse(node)}` is not allowed in an expression")
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            _refuse(node, "nested too deeply")
        made = self.generic_visit(node) if method is None else method(node)
        self._depth -= 1
        return made

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if not (node.value is None or isinstance(node.value, bool | int | float | str)):
            _refuse(node, f"`{ast.unparse(node)}` is not allowed in an expression")
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id not in self._known:
            hint = f"; {node.id}(...) is a function" if node.id in FUNCTIONS else "; the message is m"
            _refuse(node, f'there is no "{node.id}"{hint}')
        return _shaped(node, self._known[node.id])

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        is_looked_at = node is self._is_looked_at
        text, node.value = ast.unparse(node.value), self.visit(node.value)
        shape = _shape(node.value)
        if shape is None or isinstance(shape, Field):
            _refuse(node, f"{text}{f' is {shape.type}, which' if shape else ''} has no fields")
        field = next((one for one in shape._TYPE.fields if node.attr in (one.ros_name, one.py_name)), None)
        if field is None:
            names = [one.ros_name for one in shape._TYPE.fields]
            hint = did_you_mean(node.attr, names) or f"; it has {', '.join(names) or 'none'}"
            _refuse(node, f'{text} is {shape._TYPE.name}, which has no field "{node.attr}"{hint}')
        node.attr = field.py_name
        if field.type.arity is Arity.SCALAR:
            return _shaped(node, field.cls or field)
        if len(self._known) > 1 and _root(node) == "m" and not is_looked_at:
            _refuse(node, f"all of {text}.{node.attr} for each element of another array takes too long")
        return _shaped(_call("_view", node), field)

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        text, is_part = ast.unparse(node.value), isinstance(node.slice, ast.Slice)
        if isinstance(node.slice, ast.Slice) and node.slice.step is not None:
            _refuse(node, "a step between elements is not allowed")
        if not is_part:
            self._is_looked_at = node.value
        node.value = self.visit(node.value)
        shape = _shape(node.value)
        if isinstance(shape, type):
            _refuse(node, f"{text} is {shape._TYPE.name}, which has no elements")
        node.slice = self.visit(node.slice)
        return _shaped(node, shape if is_part or shape is None else shape.cls)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        if isinstance(node.op, ast.Pow | ast.LShift):
            _require_small(node.right, _MAX_EXPONENT, "what stands right of ** and <<")
            if any(isinstance(one, ast.Pow | ast.LShift) for one in ast.walk(node.left)):
                _refuse(node, "** and << of what has one of them already is not allowed")
        elif isinstance(node.op, ast.MatMult):
            _refuse(node, f"`{ast.unparse(node)}` is not allowed in an expression")
        # Of texts and lists some take memory, and some answer what nobody asked for.
        node.left, node.right = _call("_number", self.visit(node.left)), _call("_number", self.visit(node.right))
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        node.left = _call("_plain", self.visit(node.left))
        node.comparators = [_call("_plain", self.visit(one)) for one in node.comparators]
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS:
            _refuse(node, f"{ast.unparse(node.func)}(...) is not allowed; there are {', '.join(FUNCTIONS)}")
        most = {"max": _MAX_ARGUMENTS, "min": _MAX_ARGUMENTS, "round": 2}.get(name, 1)
        if node.keywords or not 0 < len(node.args) <= most or any(isinstance(one, ast.Starred) for one in node.args):
            _refuse(node, f"{name} takes {'one value' if most == 1 else f'1 to {most} values'}")
        if name == "round" and len(node.args) == 2:
            _require_small(node.args[1], _MAX_DIGITS, "the digits of round")
        if name == "len":
            self._is_looked_at = node.args[0]
        is_loop = len(node.args) == 1 and isinstance(node.args[0], ast.GeneratorExp)
        node.args = [self._loop(node.args[0])] if is_loop else [self.visit(one) for one in node.args]
        return node

    def _loop(self, node: Any) -> Any:
        """``... for x in m.field if ...`` as the argument of a function; one deep, so that its cost is seen."""
        (loop, *more) = node.generators
        if more or not isinstance(loop.target, ast.Name) or len(self._known) > 1 or loop.is_async:
            _refuse(node, "only one `for name in ...` is allowed, none inside another")
        name, loop.iter = loop.target.id, self.visit(loop.iter)
        if name in self._known or name in FUNCTIONS:
            _refuse(loop.target, f"`for {name}`: the name means something already")
        shape = _shape(loop.iter)
        self._known[name] = shape.cls if isinstance(shape, Field) else None
        node.elt, loop.ifs = self.visit(node.elt), [self.visit(test) for test in loop.ifs]
        del self._known[name]
        return node


def _refuse(node: Any, reason: str) -> NoReturn:
    raise FilterError(f"column {getattr(node, 'col_offset', 0) + 1}: {reason}")


def _require_small(node: ast.expr, most: int, what: str) -> None:
    try:
        value = ast.literal_eval(node)
    except ValueError:
        value = None
    if not isinstance(value, int | float) or not abs(value) <= most:
        _refuse(node, f"{what} has to be a number up to {most}")


def _shape(node: ast.AST) -> _Shape:
    return getattr(node, "shape", None)


def _shaped(node: ast.AST, shape: _Shape) -> ast.AST:
    node.shape = shape  # type: ignore[attr-defined]
    return node


def _root(node: Any) -> str:
    """The name that a path begins with."""
    while not isinstance(node, ast.Name):
        node = node.args[0] if isinstance(node, ast.Call) else getattr(node, "value", None)
        if node is None:
            return ""
    return str(node.id)


def _call(name: str, *values: Any) -> ast.Call:
    return ast.Call(ast.Name(name, ast.Load()), list(values), [])


# ------------------------------------------------------------------------------------------------------- what it calls


def _view(array: Any) -> Any:
    """Numbers of arrays as those of Python: one of numpy with 8 bits would begin again behind 255."""
    if not isinstance(array, np.ndarray):
        return array
    return memoryview(cast("Any", array.astype(array.dtype.newbyteorder("="), copy=False)))


def _plain(value: Any) -> Any:
    """What can be compared with a list."""
    return value.tolist() if isinstance(value, memoryview) else value


def _number(value: Any) -> Any:
    if not isinstance(value, int | float):
        raise FilterError(f"expected a number, found {type(value).__name__}")
    return value


def _of_all(function: Callable[..., Any], of_array: Callable[[Any], Any]) -> Callable[..., Any]:
    """A function of elements, with numpy's for arrays."""

    def call(*values: Any) -> Any:
        is_array = len(values) == 1 and isinstance(values[0], memoryview) and len(values[0]) > 0
        return of_array(np.asarray(values[0])).item() if is_array else function(*values)

    return call


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "all": _of_all(all, np.all),
    "any": _of_all(any, np.any),
    "bool": bool,
    "float": float,
    "int": int,
    "isfinite": math.isfinite,
    "isinf": math.isinf,
    "isnan": math.isnan,
    "len": len,
    "max": _of_all(max, np.max),
    "min": _of_all(min, np.min),
    "round": round,
    "sqrt": math.sqrt,
    "sum": _of_all(sum, lambda values: values.sum(dtype="f8" if values.dtype.kind == "f" else None)),
}
"""What an expression may call."""
_PUT_IN = {"_view": _view, "_plain": _plain, "_number": _number}
