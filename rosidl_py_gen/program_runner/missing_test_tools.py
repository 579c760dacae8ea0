"""Plug-in of pytest that skips tests which import linters of ament or launch_testing, if these are not installed."""

from __future__ import annotations

import ast
import re
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import pytest

_TOOL = re.compile(r"ament_(?!index_|package\b)\w+|launch|launch_(pytest|ros|testing\w*)")


class _SkippedModule(pytest.Module):
    missing = ""

    def collect(self) -> NoReturn:
        pytest.skip(f"{self.missing} is not installed", allow_module_level=True)


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Return a skipped module for a test file that imports a missing tool, without importing the file; else None."""
    if missing := _missing_tool(module_path):
        module: _SkippedModule = _SkippedModule.from_parent(parent, path=module_path)
        module.missing = missing
        return module
    return None


def _missing_tool(file: Path) -> str:
    try:
        body = ast.parse(file.read_bytes()).body
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return ""  # the error appears when pytest imports it
    imported = [alias.name for one in body if isinstance(one, ast.Import) for alias in one.names]
    imported += [one.module or "" for one in body if isinstance(one, ast.ImportFrom) and not one.level]
    tools = (name.partition(".")[0] for name in imported)
    return next((tool for tool in tools if _TOOL.fullmatch(tool) and find_spec(tool) is None), "")
