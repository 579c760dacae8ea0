"""Compile the templates and generate the bundled interfaces while a wheel is built, so that nobody waits for that.

What is made of `templates/` and `interfaces/` goes into new folders outside the checkout, from there into the wheel,
and away: nothing of it can be older than its text. An editable install has none of it and reads the texts.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class MadeForWheels(BuildHookInterface):
    """Hatch finds this class by its base."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        sys.path.insert(0, self.root)
        from rosidl_py_gen.compiler.codegen.module_sources import environment_of_texts
        from rosidl_py_gen.compiler.generate import generate_pregenerated

        self._folder = TemporaryDirectory()
        top = Path(self._folder.name)
        environment_of_texts().compile_templates(top / "compiled_templates", zip=None, ignore_errors=False)
        generate_pregenerated(top / "pregenerated")
        for path in top.rglob("*.py"):
            build_data["force_include"][str(path)] = f"rosidl_py_gen/{path.relative_to(top).as_posix()}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        if version != "editable":
            self._folder.cleanup()
