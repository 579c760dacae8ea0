"""The shipped and the test interfaces say exactly what the recorded facts say, and all recorded hashes are equal."""

from __future__ import annotations

import json
from typing import Any

import pytest
from each_case import each_case
from support.interface_packages import TEST_INTERFACES, VECTORS

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.compiler.frontend.model import ActionDef, Interface, MessageDef, ServiceDef
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

FACTS: dict[str, dict[str, Any]] = json.loads((VECTORS / "interfaces.json").read_text(encoding="utf-8"))
HASHES: dict[str, str] = json.loads((VECTORS / "type_hashes.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def library() -> InterfaceRegistry:
    return InterfaceRegistry(scan_search_path([TEST_INTERFACES, interfaces_dir()], ament="", bundled=False))


def sections(interface: Interface) -> dict[str, MessageDef]:
    match interface:
        case MessageDef():
            return {"": interface}
        case ServiceDef():
            return {"request": interface.request, "response": interface.response}
        case ActionDef():
            return {"goal": interface.goal, "result": interface.result, "feedback": interface.feedback}


def short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def facts(message: MessageDef) -> dict[str, Any]:
    found: dict[str, Any] = {"fields": [], "constants": []}
    for item in message.fields:
        row: dict[str, Any] = {"name": item.name, "type": short(str(item.type))}
        if item.default is not None:
            row["default"] = list(item.default) if isinstance(item.default, tuple) else item.default
        found["fields"].append(row)
    for constant in message.constants:
        found["constants"].append({"name": constant.name, "type": str(constant.type), "value": constant.value})
    return found


def expected(facts: dict[str, Any], package: str) -> dict[str, Any]:
    fields = [{**row, "type": qualified(row["type"], package)} for row in facts.get("fields", [])]
    return {"fields": fields, "constants": facts.get("constants", [])}


def qualified(kind: str, package: str) -> str:
    return kind if "/" in kind or not kind[0].isupper() else f"{package}/{kind}"


@each_case("name", FACTS)
def test_a_definition_says_what_is_recorded(library: InterfaceRegistry, name: str) -> None:
    interface = library.interface(split_ros_name(name))
    assert interface is not None, library.diagnostics.items
    recorded = FACTS[name]
    for section, message in sections(interface).items():
        wanted = expected(recorded[section] if section else recorded, name.split("/")[0])
        assert repr(facts(message)) == repr(wanted)  # repr: 1 is not True, 1.0 is not 1


def test_all_of_256_definitions_are_recorded() -> None:
    assert len(FACTS) == 256


def test_every_file_is_sound(library: InterfaceRegistry) -> None:
    names = [name for package in library.search.packages.values() for name in package.files]
    check(library, names)
    assert library.diagnostics.items == []
    assert {str(name) for name in names} >= set(FACTS)


@each_case("name", HASHES)
def test_a_type_has_its_recorded_hash(library: InterfaceRegistry, name: str) -> None:
    assert library.type_hash(name) == HASHES[name]


def test_all_of_399_hashes_are_recorded() -> None:
    assert len(HASHES) == 399
