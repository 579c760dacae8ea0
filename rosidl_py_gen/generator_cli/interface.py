"""Print a definition: its text, its type hash, its description, or everything it uses."""

from __future__ import annotations

from rosidl_py_gen.base.descriptions import build_type_description
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.frontend.definition_text import full_text, read_checked, source_text
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.generator_cli import diagnostics_output
from rosidl_py_gen.type_loading.generated import generated_library


def run(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> int:
    """Returns the exit code."""
    top = split_ros_name(name, "msg")
    library, generated = InterfaceRegistry(scan_search_path(paths)), None
    try:
        owner = read_checked(library, top)
    except TypeNotFoundError:
        generated = generated_library(name)
        if generated is None:
            raise
        library, owner, note = generated
        diagnostics_output.print_line(f"note: {note}")
    if as_json:
        diagnostics_output.print_json(
            {"hash": library.type_hash(str(top)), **build_type_description(str(top), library.field_rows)}
        )
        return 0
    if full:
        diagnostics_output.echo(full_text(library, owner).removesuffix("\n"))
        return 0
    diagnostics_output.echo((f"# {top}  {library.type_hash(str(top))}", "bold"))
    text = source_text(library, owner) if generated is None else full_text(library, owner)
    diagnostics_output.echo(text.removesuffix("\n"))
    return 0
