"""Each row of `PRIMITIVES` has its converters, its form in definitions, and values that are encoded and decoded.

A new type of fields fails here for each place that does not have it yet. At run time its row is enough:
tests/slow/cdr/test_new_type.py adds one. Columns of tables and content filters follow the row, which
tests/slow/tables/test_column_types.py and tests/slow/ros_compat/test_content_filters.py check.
"""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.definition_strategies import FLOATS
from support.interface_packages import write
from support.rclpy_messages import hooked, rclpy_class
from support.reference_cdr import NUMBERS

from rosidl_py_gen import compile_definition
from rosidl_py_gen.base.fieldtype import PRIMITIVES, FieldType
from rosidl_py_gen.cdr import support
from rosidl_py_gen.cdr.rclpy_messages import arrays, slot_types

LISTS = {"bool": "list_of_bools", "byte": "list_of_bytes"}
"""Functions that read sequences of rclpy's messages which are not `array.array`."""
LINE = "=" * 80
BASIC_TYPES = {
    *("short", "long", "long long", "unsigned short", "unsigned long", "unsigned long long"),
    *("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"),
    *("float", "double", "long double", "char", "wchar", "boolean", "octet"),
}
"""`BASIC_TYPES` of rosidl_parser in Jazzy and Kilted."""
IDL = "module {} {{ module msg {{ struct {} {{ {} }}; }}; }};\n"
PROTOCOL = Path(__file__).parents[3] / "docs" / "internals" / "protocol.md"


def numpy_name(name: str) -> str:
    return PRIMITIVES[name].numpy.rstrip("_")


def word_of(name: str) -> str:
    return name.title().replace("_", "")


class BasicType(slot_types.BasicType):
    """`BasicType` of an installed rosidl_parser, which refuses other names."""

    def __init__(self, typename: str) -> None:
        assert typename in BASIC_TYPES
        super().__init__(typename)


def value_of(name: str) -> Any:
    return {"bool": True, "int": 100, "float": 0.5}[PRIMITIVES[name].python]


@pytest.mark.parametrize("name", PRIMITIVES)
def test_generated_code_finds_the_converters_of_a_type(name: str) -> None:
    plural = numpy_name(name) + "s"
    for prefix in ("", "fixed_"):
        assert callable(getattr(support, prefix + plural))
    assert callable(getattr(arrays, f"buffer_of_{plural}"))
    assert callable(getattr(arrays, LISTS.get(name, f"array_of_{plural}")))


def declarations(module: ModuleType) -> dict[str, str]:
    """Return what a module defines for type checkers only: the type or value by name."""
    found: dict[str, str] = {}
    assert module.__file__ is not None
    for node in ast.parse(Path(module.__file__).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for statement in node.body:
                if isinstance(statement, ast.Assign):
                    found.update(dict.fromkeys(map(ast.unparse, statement.targets), ast.unparse(statement.value)))
                elif isinstance(statement, ast.AnnAssign):
                    found[ast.unparse(statement.target)] = ast.unparse(statement.annotation)
    return found


@pytest.mark.parametrize("name", PRIMITIVES)
def test_names_that_generated_code_imports_are_declared_for_type_checkers(name: str) -> None:
    one, plural = PRIMITIVES[name], numpy_name(name) + "s"
    expected = {
        plural.capitalize(): f"NDArray[np.{one.numpy}] | Sequence[{one.python}]",
        plural: "SequenceConverter",
        f"fixed_{plural}": "FixedConverter",
    }
    if name != "bool":
        expected[one.numpy.upper()] = f"np.dtype[np.{one.numpy}]"
    assert expected.items() <= declarations(support).items()
    if name not in LISTS:
        expected = {f"array_of_{plural}": "Reader", f"buffer_of_{plural}": "Converter"}
        assert expected.items() <= declarations(arrays).items()


MSG_PRIMITIVES = [name for name in FieldType.MSG_BASES if name in PRIMITIVES]
FORMS = [*((name, "idl") for name in PRIMITIVES), *((name, "msg") for name in MSG_PRIMITIVES)]


@pytest.mark.parametrize(("name", "kind"), FORMS)
def test_fields_of_a_type_are_encoded_and_decoded(name: str, kind: str) -> None:
    value, word, full_name = value_of(name), PRIMITIVES[name].idl, f"field_types/msg/{word_of(name)}In{kind.title()}"
    text = f"{name} one\n{name}[] many\n{name}[2] two\n"
    if kind == "idl":
        package, _, struct = full_name.split("/")
        members = f"{word} one; sequence<{word}> many; {word} two[2];"
        text = f"{LINE}\nIDL: {full_name}\n{IDL.format(package, struct, members)}"
    message_type = compile_definition(full_name, text)
    decoded = message_type.decode(message_type(one=value, many=[value, value], two=[value, value]).encode())
    assert decoded.one == value and list(decoded.many) == list(decoded.two) == [value, value]
    assert decoded.many.dtype == decoded.two.dtype == np.dtype(numpy_name(name))
    # The name `char` in a .msg is another spelling of uint8.
    expected = "uint8" if (name, kind) == ("char", "idl") else name
    assert [field.type.base for field in message_type._TYPE.fields] == [expected] * 3


@pytest.mark.parametrize("name", PRIMITIVES)
def test_type_id_of_a_description_leads_to_the_type(name: str) -> None:
    kind = FieldType.of_description(FieldType(name).description())
    assert kind is not None and kind.base == ("uint8" if name == "char" else name)


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Make a package importable that has a message of rclpy's API for each type."""
    files = {"field_types_msgs/package.xml": "<package><name>field_types_msgs</name></package>"}
    for name, one in PRIMITIVES.items():
        members = f"{one.idl} one; sequence<{one.idl}> many; sequence<{one.idl}, 2> few; {one.idl} two[2];"
        files[f"field_types_msgs/msg/{word_of(name)}.idl"] = IDL.format("field_types_msgs", word_of(name), members)
    folder = write(tmp_path_factory.mktemp("field_types"), files)
    with hooked(message_api="rclpy", path=str(folder), override_installed=True):
        yield


@pytest.mark.usefixtures("packages")
@pytest.mark.parametrize("name", PRIMITIVES)
def test_fields_of_rclpy_messages_are_checked_encoded_and_decoded(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    installed: Any = SimpleNamespace(**{**vars(slot_types), "BasicType": BasicType})
    monkeypatch.setitem(sys.modules, "rosidl_parser.definition", installed)
    one = PRIMITIVES[name]
    is_byte = one.idl == "octet"
    value = b"\x05" if is_byte else value_of(name)
    cls = rclpy_class(f"field_types_msgs/msg/{word_of(name)}")
    assert cls.get_fields_and_field_types() == {
        "one": one.idl,
        "many": f"sequence<{one.idl}>",
        "few": f"sequence<{one.idl}, 2>",
        "two": f"{one.idl}[2]",
    }
    assert [kind.typename for kind in (cls.SLOT_TYPES[0], *(kind.value_type for kind in cls.SLOT_TYPES[1:]))] == [
        one.idl
    ] * 4
    message = cls(one=value, many=[value] * 3, few=[value], two=[value] * 2, check_fields=True)
    message.many, message.few, message.two = message.many, message.few, message.two  # arrays instead of lists
    decoded = type(message).decode(message.encode())
    assert decoded == message
    assert [decoded.one, *decoded.many, *decoded.few, *decoded.two] == [value] * 7
    for wrong in wrong_values(name):
        with pytest.raises(AssertionError, match="field must be"):
            message.one = wrong
        for field, count in {"many": 1, "few": 2, "two": 2}.items():
            with pytest.raises(AssertionError, match="field must be"):
                setattr(message, field, [wrong] * count)
    assert decoded == message


def wrong_values(name: str) -> list[Any]:
    """Return values that do not fit a type: a text, and the numbers that follow the minimum and maximum."""
    one = PRIMITIVES[name]
    if name in ("bool", "byte"):
        return ["x", 2]
    if one.python == "int":
        low, high = one.integer_range
        return ["x", low - 1, high + 1]
    beyond = 2 * float(np.finfo(numpy_name(name)).max)
    return ["x"] if math.isinf(beyond) else ["x", beyond, -beyond]  # infinity is a value


@pytest.mark.parametrize("name", PRIMITIVES)
def test_random_definitions_and_documentation_have_each_type(name: str) -> None:
    one = PRIMITIVES[name]
    assert NUMBERS.keys() == set(MSG_PRIMITIVES)
    if name in MSG_PRIMITIVES:
        assert NUMBERS[name] == (one.code, one.size)
        assert (name in FLOATS) is (one.python == "float")
    section = PROTOCOL.read_text(encoding="utf-8").partition("### 1.1 ")[2].partition("\n### 1.9")[0]
    assert f"`{name if name in MSG_PRIMITIVES else one.idl}`" in section
