"""Make wheels of message packages."""

from __future__ import annotations

from pathlib import Path

from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.generator_cli import diagnostics_output
from rosidl_py_gen.wheels.build import build, selected_packages


def run(names: tuple[str, ...], paths: tuple[str, ...], out: str, no_dependencies: bool, as_json: bool) -> int:
    """Returns the exit code."""
    search = scan_search_path(paths)
    built = build(search, selected_packages(search, [*names]), Path(out), dependencies=not no_dependencies)
    if as_json:
        diagnostics_output.print_json(
            [{"package": one.package, "path": str(one.path), "requires": list(one.requires)} for one in built]
        )
        return 0
    for one in built:
        diagnostics_output.echo(str(one.path))
    made = {"rosidl-py-gen", *(one.package for one in built)}
    needed = {tuple(text.split("==")) for one in built for text in one.requires}
    if left := sorted(pair for pair in needed if pair[0].partition(">")[0] not in made):
        versions = ", ".join("==".join(pair) for pair in left)
        why = "" if no_dependencies else ", because they are installed here"
        diagnostics_output.echo(
            f"needed, and not made{why}: {versions}; name packages to make wheels of them", err=True
        )
    return 0
