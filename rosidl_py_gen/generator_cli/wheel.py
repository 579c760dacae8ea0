"""The command `wheel`: make wheels of message packages."""

from __future__ import annotations

import re
from pathlib import Path

from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.generator_cli.diagnostics_output import echo, print_json
from rosidl_py_gen.wheels.build import build, selected_packages


def run(names: tuple[str, ...], paths: tuple[str, ...], out: str, no_dependencies: bool, as_json: bool) -> int:
    """Run the command and return its exit code."""
    search = scan_search_path(paths)
    built = build(search, selected_packages(search, [*names]), Path(out), dependencies=not no_dependencies)
    if as_json:
        print_json([{"package": one.package, "path": str(one.path), "requires": list(one.requires)} for one in built])
        return 0
    for one in built:
        echo(str(one.path))
    made = {"rosidl-py-gen", *(one.package for one in built)}
    required = {text for one in built for text in one.requires}
    if missing := sorted(text for text in required if re.split("[=>]", text)[0] not in made):
        reason = "" if no_dependencies else ", because they are installed"
        texts = ", ".join(missing)
        echo(f"required, but not made{reason}: {texts}; name packages to make wheels of them", err=True)
    return 0
