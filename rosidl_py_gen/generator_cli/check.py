"""The command `check`: read definitions and report their problems."""

from __future__ import annotations

from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import load, notes_of
from rosidl_py_gen.generator_cli.diagnostics_output import echo, print_json, print_notes, rows


def run(names: tuple[str, ...], paths: tuple[str, ...], as_json: bool) -> int:
    """Run the command and return its exit code; problems are raised."""
    search = scan_search_path(paths)
    _, found = load(search, list(names))
    notes = notes_of(search, found)
    packages = sorted({name.package for name in found})
    if as_json:
        interfaces = [str(name) for name in found]
        print_json({"interfaces": interfaces, "errors": [], "notes": rows(notes)})
    else:
        print_notes(notes)
        echo(f"{len(found)} interfaces in {len(packages)} packages: no problems")
    return 0
