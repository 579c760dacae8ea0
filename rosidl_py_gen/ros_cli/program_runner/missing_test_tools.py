"""Plug-in of pytest: tests that import linters of ament or launch_testing are skipped if these are not installed."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType

import pytest

_LINTERS = "clang_format|clang_tidy|copyright|cppcheck|cpplint|flake8|lint|lint_cmake|mypy|pclint|pep257|pycodestyle"
_TOOL = re.compile(rf"(ament_({_LINTERS}|pyflakes|uncrustify|xmllint)|launch|launch_(pytest|ros|testing\w*))(\..*)?")


class _SkippingFinder(MetaPathFinder):
    """Last finder of `sys.meta_path`."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if path is None and _TOOL.fullmatch(fullname):
            pytest.skip(f"{fullname} is not installed", allow_module_level=True)


sys.meta_path.append(_SkippingFinder())
