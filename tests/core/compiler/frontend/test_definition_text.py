"""Definitions written for bags compile to the same type again."""

from __future__ import annotations

import pytest
from each_case import each_case
from support.bundled_interfaces import message, message_names

from rosidl_py_gen import compile_definition, get_service, type_description, type_hash
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.type_loading.from_description import definition_text

ELSEWHERE = ("test_msgs/", "test_interface_files/", "ros2cli_test_interfaces/")  # not on the search path
BUNDLED = [name for name in message_names() if not name.startswith(ELSEWHERE)]
OTHERS = [name for name in message_names() if name.startswith(ELSEWHERE) and "/msg/" in name]


@each_case("name", BUNDLED[::4])
def test_definition_text_of_a_bundled_type_compiles_to_the_same_class(name: str) -> None:
    cls = message(name)
    assert compile_definition(name, definition_text(cls)) is cls


@each_case("name", OTHERS)
def test_definition_text_of_other_types_preserves_fields_and_defaults(name: str) -> None:
    cls = message(name)
    again = compile_definition(name, definition_text(cls))
    assert type_hash(again) == type_hash(cls)
    assert type_description(again) == type_description(cls)


def test_definition_text_of_a_run_time_class_compiles_to_an_equal_type() -> None:
    text = "uint8 ONE=1\nint32[3] fixed [1, 2, 3]\nstring<=5[<=4] few\nlocal/Inner inner\nwstring wide\n"
    inner = f"{'=' * 80}\nMSG: local/Inner\nstd_msgs/Header[] headers\nbool ok true\n"
    cls = compile_definition("local/msg/Outer", text + inner)
    written = definition_text(cls)
    assert "string<=5[<=4] few" in written and "MSG: std_msgs/Header" in written
    again = compile_definition("local/msg/Outer", written)
    assert type_hash(again) == type_hash(cls)
    assert type_description(again) == type_description(cls)


def test_definition_text_of_a_service_event_preserves_the_type_hash() -> None:
    event = get_service("std_srvs/srv/SetBool").Event
    again = compile_definition("std_srvs/srv/SetBool_Event", definition_text(event))
    assert type_hash(again) == type_hash(event)


def test_definition_text_refuses_classes_that_are_not_messages() -> None:
    with pytest.raises(TypeNotFoundError):
        definition_text(int)
