"""docs/reference/cheat-sheet.md agrees with the commands, public names, QoS presets and the page on settings."""

from __future__ import annotations

import re
from importlib import import_module

import pytest
from support.folders import ROOT
from support.markdown_pages import rows

from rosidl_py_gen.ros_cli.groups import COMMANDS
from rosidl_py_gen.runtime import qos
from rosidl_py_gen.runtime.node.settings import WITH_ARGUMENT

PAGE = ROOT / "docs/reference/cheat-sheet.md"
TEXT = PAGE.read_text(encoding="utf-8")
SPAN = re.compile(r"`([^`]+)`")
OF_PYTHON = {"asyncio", "await", "for", "in", "to_thread"}


def table(*heading: str) -> list[list[str]]:
    """Return the rows of the table with a heading, up to the heading of the next table."""
    found = rows(PAGE)
    first = found.index(list(heading)) + 2
    headings = [number - 1 for number, row in enumerate(found) if row[0].startswith("--")]
    return found[first : min([number for number in headings if number > first], default=len(found))]


def commands_of(group: str) -> set[str]:
    """Return the commands of a group; only an empty name if it is a command itself."""
    modules = COMMANDS[group][1]
    return {""} if isinstance(modules, str) else set(" ".join(modules).split())


def test_commands_on_cheat_sheet_exist_and_are_complete() -> None:
    named = set()
    for cell, names in table("Group", "Commands"):
        (group,) = SPAN.findall(cell)
        named |= {(group, name) for name in SPAN.findall(names)}
    for span in SPAN.findall(TEXT):
        group, name, *_ = [*span.removeprefix("rosidl-py ").split(), "", ""]
        assert group in COMMANDS or not span.startswith("rosidl-py "), span
        if group in COMMANDS and (name or commands_of(group) == {""}):
            named.add((group, name if commands_of(group) != {""} else ""))
    existing = {(group, name) for group in COMMANDS for name in commands_of(group)}
    assert named == existing


@pytest.mark.needs("mcap")
def test_counterparts_of_rclpy_on_cheat_sheet_exist() -> None:
    modules = [
        import_module(f"rosidl_py_gen{name}") for name in ("", ".runtime", ".tf", ".bags", ".numpy", ".message_filters")
    ]
    known = {name for module in modules for name in dir(module)}
    known |= {member for module in modules for name in dir(module) for member in dir(getattr(module, name))}
    found = table("rclpy", "Here")
    called = {name for _, cell in found for span in SPAN.findall(cell) for name in re.findall(r"(\w+)\(", span)}
    assert len(called) > 20 and called - known - OF_PYTHON - {"f", "main"} == set()


def test_presets_on_cheat_sheet_have_their_values() -> None:
    found = table("Here", "rclpy", "Reliability", "Durability", "Depth")
    for name, _, reliability, durability, depth in found:
        profile = getattr(qos, name.strip("`"))
        policies = [policy.name.lower().replace("_", " ") for policy in (profile.reliability, profile.durability)]
        assert ([reliability, durability], int(depth)) == (policies, profile.depth), name
    presets = {name for name, value in vars(qos).items() if isinstance(value, type(qos.DEFAULT))}
    assert presets - {row[0].strip("`") for row in found} == {"SYSTEM_DEFAULT"}


def test_variables_and_arguments_on_cheat_sheet_are_on_settings_page() -> None:
    listed = {name for row in rows(ROOT / "docs/reference/settings.md") for name in SPAN.findall(row[0])}
    named = {name for row in table("Variable", "Meaning") for name in SPAN.findall(row[0])}
    assert len(named) > 8 and named - listed == set()
    arguments = {span.split()[0] for row in table("After `--ros-args`", "Meaning") for span in SPAN.findall(row[0])}
    assert arguments - set(WITH_ARGUMENT) == set()
