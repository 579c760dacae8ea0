"""docs/reference/settings.md lists the environment variables and ROS arguments that the code reads."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

from support.folders import ROOT

from rosidl_py_gen.runtime.node.settings import SWITCHES, WITH_ARGUMENT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PAGE = (ROOT / "docs/reference/settings.md").read_text(encoding="utf-8")
OF_OTHERS = {"COMP_LINE", "COMP_WORDBREAKS", "DISPLAY", "TERM", "WAYLAND_DISPLAY"}
"""Variables of shells and desktops."""
OF_PEERS = {"FASTDDS_BUILTIN_TRANSPORTS", "RMW_IMPLEMENTATIONS", "ROS_DISCOVERY_SERVER"}
"""Variables that only peers or programs use; `rosidl-py doctor` checks two of them."""


def variables(path: Path) -> Iterator[str]:
    """Yield the variables that a module names in ``environ.get(...)``, ``environ[...]``, `envvar` and constants."""
    text = path.read_text(encoding="utf-8")
    if not re.search("environ|envvar|VARIABLE|ENV_VAR", text):
        return
    for node in ast.walk(ast.parse(text)):
        value: ast.expr | None = None
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("environ.get"):
            value = node.args[0]
        elif isinstance(node, ast.Subscript) and ast.unparse(node.value).endswith("environ"):
            value = node.slice
        elif isinstance(node, ast.keyword | ast.Assign):
            name = node.arg if isinstance(node, ast.keyword) else ast.unparse(node.targets[0])
            value = node.value if re.search(r"envvar$|VARIABLE$|ENV_VAR$", name or "") else None
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            yield value.value


def test_settings_page_lists_variables_that_code_reads() -> None:
    found = {name for path in (ROOT / "rosidl_py_gen").rglob("*.py") for name in variables(path)}
    assert len(found) > 25
    assert {name for name in found - OF_OTHERS - OF_PEERS if not re.search(rf"\b{name}\b", PAGE)} == set()


def test_settings_page_lists_all_ros_arguments() -> None:
    assert [flag for flag in WITH_ARGUMENT if not re.search(rf"`{flag}[ `]", PAGE)] == []
    assert [switch for switch in SWITCHES if f"`--enable-`, `--disable-{switch}`" not in PAGE] == []
