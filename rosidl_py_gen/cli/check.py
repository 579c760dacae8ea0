"""Read definitions and report what is wrong with them."""

from __future__ import annotations

from rosidl_py_gen.cli import reports
from rosidl_py_gen.compiler.generate import load, notes_of
from rosidl_py_gen.compiler.spec.find import search_path


def run(names: tuple[str, ...], paths: tuple[str, ...], as_json: bool) -> int:
    """Returns the exit code; problems are raised and reported by the caller."""
    search = search_path(paths)
    _, found = load(search, list(names))
    notes = notes_of(search, found)
    packages = sorted({name.package for name in found})
    if as_json:
        interfaces = [str(name) for name in found]
        reports.print_json({"interfaces": interfaces, "errors": [], "notes": reports.rows(notes)})
    else:
        reports.print_notes(notes)
        reports.echo(f"{len(found)} interfaces in {len(packages)} packages: no problems")
    return 0
