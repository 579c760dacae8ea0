"""Compile the templates while a wheel is built, so that nobody who installed it waits for that.

What jinja2 makes of `templates/` goes into a new folder outside the checkout, from there into the wheel, and away: no
compiled template can be older than its text. An editable install has none and reads the texts.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledTemplates(BuildHookInterface):
    """Hatch finds this class by its base."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        sys.path.insert(0, self.root)
        from rosidl_py_gen.codegen.render import environment_of_texts

        self._folder = TemporaryDirectory()
        environment_of_texts().compile_templates(self._folder.name, zip=None, ignore_errors=False)
        for path in Path(self._folder.name).glob("*.py"):
            build_data["force_include"][str(path)] = f"rosidl_py_gen/compiled_templates/{path.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        if version != "editable":
            self._folder.cleanup()
