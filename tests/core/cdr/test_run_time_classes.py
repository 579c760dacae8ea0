"""Classes made at run time: identity, invalid definitions, errors of wrong arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.interface_packages import python, write

import rosidl_py_gen as ros
from rosidl_py_gen import (
    DefinitionError,
    InvalidNameError,
    TypeNotFoundError,
    compile_definition,
    get_message,
)

LINE = "=" * 80


def test_invalid_definition_is_an_error_at_every_lookup(tmp_path: Path) -> None:
    folder = write(tmp_path, {"br_msgs/msg/Inner.msg": "int32 a\nuint99 b\n", "br_msgs/msg/Outer.msg": "Inner i\n"})
    for _ in range(2):
        for name in ("br_msgs/msg/Outer", "br_msgs/msg/Inner"):
            with pytest.raises(DefinitionError, match="uint99"):
                get_message(name, path=[folder])


def test_definitions_that_differ_in_constants_or_defaults_only_are_different_classes() -> None:
    first = compile_definition("leak_msgs/msg/State", "uint8 OK=0\nuint8 FAIL=1\nuint8 state\n")
    other = compile_definition("leak_msgs/msg/State", "uint8 FAIL=0\nuint8 OK=1\nuint8 state\n")
    third = compile_definition("leak_msgs/msg/State", "uint8 OK=0\nuint8 FAIL=1\nuint8 state 1\n")
    assert len({first, other, third}) == 3
    assert (first.OK, other.OK, third.OK) == (0, 1, 0)
    assert (first().state, third().state) == (0, 1)
    assert compile_definition("leak_msgs/msg/State", "uint8 OK=0\nuint8 FAIL=1\nuint8 state\n") is first


def test_different_defaults_of_a_nested_type_make_different_classes() -> None:
    def outer(default: int) -> Any:
        return compile_definition("leak_msgs/msg/Outer", f"In i\n{LINE}\nMSG: leak_msgs/In\nuint8 x {default}\n")

    assert (outer(1)().i.x, outer(2)().i.x) == (1, 2)
    assert outer(1) is outer(1)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("std_srvs/srv/SetBool_Event", "bool data\n---\nbool success\nstring message\n"),
        ("std_srvs/srv/SetBool_Request", "bool data\n---\nbool success\nstring message\n"),
        ("flat_msgs/srv/Do_Request", "bool data\n"),
        ("flat_msgs/action/Go_FeedbackMessage", "int32 a\n---\nint32 b\n---\nint32 c\n"),
        (
            "flat_msgs/action/Go_FeedbackMessage",
            f"unique_identifier_msgs/UUID goal_id\nint32 c\n{LINE}\nMSG: unique_identifier_msgs/UUID\nuint8[16] uuid\n",
        ),
    ],
)
def test_derived_types_compile_from_interface_text_and_from_own_text(name: str, text: str) -> None:
    cls = compile_definition(name, text)
    assert ros.type_name(cls) == name
    assert cls.decode(cls().encode()) == cls()


@pytest.mark.parametrize("leaf_first", [True, False])
def test_deep_nesting_is_an_error_in_any_order_of_definitions(leaf_first: bool) -> None:
    levels = [f"{LINE}\nMSG: deep_msgs/M{i:03d}\n" + (f"M{i - 1:03d} m\n" if i else "int32 x\n") for i in range(300)]
    text = "".join(levels if leaf_first else reversed(levels))
    with pytest.raises(DefinitionError, match="deeper than"):
        compile_definition("deep_msgs/msg/Top", "M299 m\n" + text)


def test_type_missing_from_the_text_is_reported() -> None:
    with pytest.raises(DefinitionError, match=r'unknown type "my_msgs/Bar" \(searched: the text'):
        compile_definition("my_msgs/msg/Foo", "Bar b\n")


def test_search_path_may_be_a_single_folder(tmp_path: Path) -> None:
    folder = write(tmp_path, {"one_msgs/msg/A.msg": "int8 x 3\n"})
    assert get_message("one_msgs/A", path=str(folder))().x == 3
    assert get_message("one_msgs/A", path=folder) is get_message("one_msgs/A", path=[folder])


@pytest.mark.parametrize(
    "call",
    [
        lambda: ros.encode(5),
        lambda: ros.validate("x"),
        lambda: ros.to_dict("x"),
        lambda: ros.to_json(None),
        lambda: ros.decode(int, b""),
        lambda: ros.from_json(dict, "{}"),
        lambda: ros.from_dict(dict, {}),
        lambda: ros.type_hash(7),
    ],
)
def test_functions_refuse_arguments_that_are_not_messages(call: Any) -> None:
    with pytest.raises(TypeNotFoundError, match="expected a generated message"):
        call()


def test_interface_name_that_is_not_a_string_is_refused() -> None:
    with pytest.raises(InvalidNameError, match="expected the name of an interface, found NoneType"):
        get_message(None)  # type: ignore[arg-type]


@pytest.mark.slow
def test_class_of_an_installed_package_needs_neither_lark_nor_cmake_modules() -> None:
    found = python(
        "import sys; from rosidl_py_gen import get_service\n"
        "get_service('example_interfaces/srv/AddTwoInts')\n"
        "print([name for name in sys.modules if name == 'lark' or 'cmake' in name or 'idl_parser' in name])"
    )
    assert found == "[]\n"
