"""Invalid and expensive descriptions of types."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest
from support import raw_endpoints
from support.announced_types import fresh, teller, told_by

from rosidl_py_gen import from_dict
from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.msgs.type_description_interfaces.msg import TypeDescription
from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response
from rosidl_py_gen.runtime import TypeDescriptionError

if TYPE_CHECKING:
    from support.worlds import World


def absurd(told: dict[str, Any], what: str) -> None:
    """Change a description so that no definition can produce it."""
    fields = told["type_description"]["fields"]
    changes: dict[str, tuple[str, Any]] = {
        "id": ("type_id", 77),
        "size": ("capacity", 3),
        "no size": ("type_id", 54),
        "bound": ("string_capacity", 4),
        "nested": ("nested_type_name", "a/msg/B"),
    }
    if what in changes:
        key, value = changes[what]
        fields[0]["type"][key] = value
    elif what == "many":
        told["type_description"]["fields"] = [{**fields[0], "name": f"x{index}"} for index in range(1_001)]
    elif what == "itself":
        nested = {
            "type_id": 1,
            "capacity": 0,
            "string_capacity": 0,
            "nested_type_name": told["type_description"]["type_name"],
        }
        fields[0]["type"] = nested
    elif what == "not described":
        fields[0]["type"] = {"type_id": 1, "capacity": 0, "string_capacity": 0, "nested_type_name": "gone/msg/Gone"}
    elif what == "twice":
        fields.append(dict(fields[0]))
    elif what == "default":
        fields[0]["default_value"] = "(" * 5000
    elif what == "empty":
        fields.clear()
    else:
        fields[0]["name"] = what


TYPES = ["id", "size", "no size", "bound", "nested", "itself", "not described"]
NAMES = ["__init__", "x y", "x\nimport os", "\N{SNOWMAN}", "9x", ""]


@pytest.mark.parametrize("what", [*TYPES, *NAMES, "many", "twice", "default", "empty"])
async def test_impossible_type_description_is_refused(memory: World, what: str) -> None:
    honest = fresh()
    description = honest.library.type_description(honest.name)
    absurd(description, what)
    answer = GetTypeDescription_Response(successful=True, type_description=from_dict(TypeDescription, description))
    robot = teller(memory, "robot", lambda request: answer)
    honest.announce(robot, "rt/t", announced=TypeDescriptions.rihs01(description))
    with pytest.raises(TypeDescriptionError, match=f"^the description of {honest.name} by /robot cannot be used"):
        await memory.node("asker").resolve_type("t", timeout_s=20)


@pytest.mark.parametrize("line", ["?", "int8 a=1", 'string S="x"', "module a{", "[", "const long A ="])
@pytest.mark.parametrize("encoding", ["msg", "idl"])
async def test_invalid_source_text_is_rejected_in_linear_time(memory: World, line: str, encoding: str) -> None:
    told = fresh()
    answer = told.answer()
    text = "\n".join(f"{line}{index}" for index in range(250_000 // (len(line) + 6)))
    answer.type_sources[0].encoding, answer.type_sources[0].raw_file_contents = encoding, f"{told.text}\n{text}"
    told_by(memory, told, answer=lambda request: answer)
    start = asyncio.get_running_loop().time()
    cls: Any = await memory.node("asker").resolve_type("t", timeout_s=20)
    taken_s = asyncio.get_running_loop().time() - start
    assert not hasattr(cls, "LABEL") and taken_s < 10


async def test_oversized_type_description_is_refused(memory: World) -> None:
    told = fresh()
    answer = told.answer()
    answer.type_description.type_description.fields *= 30_000
    told_by(memory, told, answer=lambda request: answer)
    with pytest.raises(TypeDescriptionError, match=r"/robot describes .* in \d{7} bytes; expected at most 1048576"):
        await memory.node("asker").resolve_type("t", timeout_s=20)


async def test_invalid_announced_type_name_raises_type_description_error(memory: World) -> None:
    robot = teller(memory, "robot", lambda request: GetTypeDescription_Response())
    raw_endpoints.announce(robot, "rt/t", "no::such \x1bdds_::Name_", "x")
    with pytest.raises(
        TypeDescriptionError, match=r"^the type of the topic /t is not a ROS type: no/such \ufffdName without a hash"
    ):
        await memory.node("asker").resolve_type("t", timeout_s=5)
