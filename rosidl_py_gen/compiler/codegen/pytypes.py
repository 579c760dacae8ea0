"""Fields and constants in a generated class: annotation, default value, docstring lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.compiler.codegen.python_literals import py_literal, visible

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.compiler.codegen.naming import Imports
    from rosidl_py_gen.compiler.frontend.model import ConstantDef, FieldDef

SUPPORT = "rosidl_py_gen.cdr.support"
_ZERO = {"bool": "False", "int": "0", "float": "0.0"}


class MemberView(NamedTuple):
    """Field or constant of a generated class, as values for the module template.

    Attributes:
        annotation: type of the attribute.
        accepted: type of the constructor's parameter: any sequence for numbers, also a structured array for messages of
            fixed size.
        ignore: a comment for type checkers.
    """

    name: str
    annotation: str
    value: str
    doc: tuple[str, ...]
    accepted: str = ""
    ignore: str = ""


def field_view(
    item: FieldDef, imports: Imports, classes: dict[str, str], is_fixed: Callable[[str], bool]
) -> MemberView:
    """Return the template values of a field."""
    kind = item.type
    name = py_name(item.name)
    # A field may have the name of a method of the base class, and then hides the method.
    ignore = "  # type: ignore[assignment]" if name in ("encode", "decode") else ""
    annotation = _annotation(kind, imports, classes)
    accepted = annotation
    if kind.primitive is not None and kind.arity is not Arity.SCALAR:
        accepted = imports.use(SUPPORT, kind.primitive.numpy.rstrip("_").capitalize() + "s", for_typing=True)
    elif kind.is_message and kind.arity is not Arity.SCALAR and is_fixed(kind.base):
        accepted = f"{annotation} | {imports.use(SUPPORT, 'Records', for_typing=True)}"
    return MemberView(name, annotation, _default(item, imports, classes), _doc(item), accepted, ignore)


def constant_view(item: ConstantDef, imports: Imports, rclpy: bool = False) -> MemberView:
    """Return the template values of a constant; with `rclpy`, a byte is bytes of length 1."""
    primitive = item.type.primitive
    is_bytes = rclpy and item.type.base == "byte"
    python = imports.builtin("bytes" if is_bytes else primitive.python if primitive else "str")
    annotation = f"{imports.use('typing', 'ClassVar')}[{python}]"
    value = _byte(item.value) if is_bytes else py_literal(item.value)
    return MemberView(py_name(item.name), annotation, value, _doc(item))


def _byte(value: object) -> str:
    assert isinstance(value, int)
    return repr(bytes([value]))


def rclpy_defaults(fields: tuple[FieldDef, ...]) -> str:
    """Return Python source of the default values for classes of rclpy's API: dictionary items by ROS name, with lists
    for arrays.
    """
    items = []
    for item in fields:
        spell = _byte if item.type.base == "byte" else py_literal
        if isinstance(item.default, tuple):
            items.append(f'"{item.name}": [{", ".join(map(spell, item.default))}]')
        elif item.default is not None:
            items.append(f'"{item.name}": {spell(item.default)}')
    return ", ".join(items)


def _doc(item: FieldDef | ConstantDef) -> tuple[str, ...]:
    lines = visible(item.comment)
    if item.unit:
        unit = f"[{item.unit}]"
        lines = (*lines[:-1], f"{lines[-1]} {unit}".strip()) if lines else (unit,)
    return visible(lines)


def _annotation(kind: FieldType, imports: Imports, classes: dict[str, str]) -> str:
    primitive = kind.primitive
    if primitive is not None and kind.arity is not Arity.SCALAR:
        array = imports.use("numpy.typing", "NDArray")
        return f"{array}[{imports.use('numpy', '')}.{primitive.numpy}]"
    if primitive is not None:
        base = imports.builtin(primitive.python)
    else:
        base = imports.builtin("str") if kind.is_string else classes[kind.base]
    return base if kind.arity is Arity.SCALAR else f"{imports.builtin('list')}[{base}]"


def _default(item: FieldDef, imports: Imports, classes: dict[str, str]) -> str:
    kind = item.type
    primitive = kind.primitive
    if kind.arity is Arity.SCALAR:
        if item.default is not None:
            assert not isinstance(item.default, tuple)
            return py_literal(item.default)
        if primitive is not None:
            return _ZERO[primitive.python]
        return '""' if kind.is_string else _factory(imports, classes[kind.base])
    if primitive is not None:
        return _factory(imports, f"lambda: {_array(item, imports)}")
    if isinstance(item.default, tuple) and item.default:
        return _factory(imports, f"lambda: [{', '.join(py_literal(value) for value in item.default)}]")
    if kind.arity is not Arity.ARRAY:
        return _factory(imports, imports.builtin("list"))
    if kind.is_string:
        return _factory(imports, f'lambda: [""] * {kind.capacity}')
    # The body of the lambda sees names of the module, not fields of the class.
    return _factory(imports, f"lambda: [{classes[kind.base]}() for _ in range({kind.capacity})]")


def _factory(imports: Imports, function: str) -> str:
    return f"{imports.use('dataclasses', 'field')}(default_factory={function})"


def _array(item: FieldDef, imports: Imports) -> str:
    primitive = item.type.primitive
    assert primitive is not None
    np = imports.use("numpy", "")
    dtype = f"{np}.{primitive.numpy}"
    if isinstance(item.default, tuple) and item.default:
        return f"{np}.array([{', '.join(py_literal(value) for value in item.default)}], {dtype})"
    return f"{np}.zeros({item.type.capacity if item.type.arity is Arity.ARRAY else 0}, {dtype})"
