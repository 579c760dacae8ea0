"""Read definitions and report what is wrong with them."""

from __future__ import annotations

from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import load, notes_of
from rosidl_py_gen.generator_cli import diagnostics_output


def run(names: tuple[str, ...], paths: tuple[str, ...], as_json: bool) -> int:
    """Returns the exit code; problems are raised and reported by the caller."""
    search = scan_search_path(paths)
    _, found = load(search, list(names))
    notes = notes_of(search, found)
    packages = sorted({name.package for name in found})
    if as_json:
        interfaces = [str(name) for name in found]
        diagnostics_output.print_json({"interfaces": interfaces, "errors": [], "notes": diagnostics_output.rows(notes)})
    else:
        diagnostics_output.print_notes(notes)
        diagnostics_output.echo(f"{len(found)} interfaces in {len(packages)} packages: no problems")
    return 0
