"""The bundled and the test interfaces have the recorded fields and constants."""

from __future__ import annotations

import json
from typing import Any

import pytest
from each_case import each_case
from support.interface_packages import TEST_INTERFACES, VECTORS

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.compiler.frontend.model import MessageDef
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import SearchPath

FACTS: dict[str, dict[str, Any]] = json.loads((VECTORS / "interfaces.json").read_text(encoding="utf-8"))
TURTLESIM = {
    "turtlesim/action/RotateAbsolute": "RIHS01_08ba6dd83d976f1cb548edd1f75f16cf30cca624ce1410b6ce77f44b8a3c2895",
    "turtlesim/msg/Color": "RIHS01_74492579ec0d734707aede0e742ab76c55ac50d3ff917381e5163624cb657fe5",
    "turtlesim/msg/Pose": "RIHS01_739beba26bcba6920404ba722b7b8321348512f92ea5be235c47251940dd8aa9",
    "turtlesim/srv/Kill": "RIHS01_81c7c9131a0802f384e515fbd04867f8da57abaa83ee3a0ec76e39091e54bbc3",
    "turtlesim/srv/SetPen": "RIHS01_45ca246c7258172a89a58856037d6b4489eb46a18f1d8ee1988c018ef46fcfce",
    "turtlesim/srv/Spawn": "RIHS01_a71be24836f772debd6187dc8618cc47700d2602c7a3e2228bad67a8f5fd27b4",
    "turtlesim/srv/TeleportAbsolute": "RIHS01_139aa0f215e25dc085067f070adb3ef65cf3c92d201f5cb750d51ca9322166b6",
    "turtlesim/srv/TeleportRelative": "RIHS01_6e9e54cb05e1a789f982bf8c93d27fc899cee099746c4ea8c7cb64e8a90297d6",
}
"""Hashes of turtlesim by rosidl_adapter and rosidl_generator_type_description 4.6.6, of github.com/ros/ros_tutorials
1.8.2. The hash of a service or action covers all types that are derived of it.
"""


@pytest.fixture(scope="module")
def library() -> InterfaceRegistry:
    return InterfaceRegistry(SearchPath.scan([TEST_INTERFACES, DataFolders.interfaces()], ament="", bundled=False))


SECTION_NAMES = {"msg": [""], "srv": ["request", "response"], "action": ["goal", "result", "feedback"]}


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
def test_definition_has_the_recorded_fields_and_constants(library: InterfaceRegistry, name: str) -> None:
    interface = library.interface(RosName.parse(name))
    assert interface is not None, library.diagnostics.items
    recorded = FACTS[name]
    names = SECTION_NAMES[name.split("/")[1]]
    for section, message in zip(names, interface.sections, strict=True):
        wanted = expected(recorded[section] if section else recorded, name.split("/")[0])
        assert repr(facts(message)) == repr(wanted)  # repr: 1 is not True, 1.0 is not 1


def test_every_bundled_and_test_interface_is_valid(library: InterfaceRegistry) -> None:
    names = [name for package in library.search.packages.values() for name in package.files]
    check(library, names)
    assert library.diagnostics.items == []
    assert {str(name) for name in names} >= set(FACTS)


def test_hashes_of_turtlesim_types_equal_the_hashes_of_rosidl(library: InterfaceRegistry) -> None:
    names = map(str, library.search.packages["turtlesim"].files)
    assert {name: library.type_hash(name) for name in names} == TURTLESIM
