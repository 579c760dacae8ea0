"""Print a definition: its text, its type hash, its description, or everything it uses."""

from __future__ import annotations

from rosidl_py_gen.base.descriptions import describe
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cli import reports
from rosidl_py_gen.compiler.spec.definition import full_text, read_checked, source_text
from rosidl_py_gen.compiler.spec.find import search_path
from rosidl_py_gen.compiler.spec.resolve import Library
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.types.generated import generated_library


def run(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> int:
    """Returns the exit code."""
    top = split_ros_name(name, "msg")
    library, generated = Library(search_path(paths)), None
    try:
        owner = read_checked(library, top)
    except TypeNotFoundError:
        generated = generated_library(name)
        if generated is None:
            raise
        library, owner, note = generated
        reports.print_line(f"note: {note}")
    if as_json:
        reports.print_json({"hash": library.type_hash(str(top)), **describe(str(top), library.rows)})
        return 0
    if full:
        reports.echo(full_text(library, owner).removesuffix("\n"))
        return 0
    reports.echo((f"# {top}  {library.type_hash(str(top))}", "bold"))
    text = source_text(library, owner) if generated is None else full_text(library, owner)
    reports.echo(text.removesuffix("\n"))
    return 0
