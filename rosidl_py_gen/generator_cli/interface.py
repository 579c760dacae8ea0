"""The command `interface`: print a definition with its type hash."""

from __future__ import annotations

from rosidl_py_gen.base.descriptions import build_type_description
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.frontend.definition_text import full_text, source_text
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, read_checked
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.generator_cli.diagnostics_output import echo, print_json, print_line
from rosidl_py_gen.type_loading.generated_definitions import registry_of_generated_class


def run(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> int:
    """Run the command and return its exit code."""
    top = split_ros_name(name, "msg")
    registry, generated = InterfaceRegistry(scan_search_path(paths)), None
    try:
        owner = read_checked(registry, top)
    except TypeNotFoundError:
        generated = registry_of_generated_class(name)
        if generated is None:
            raise
        registry, owner, note = generated
        print_line(f"note: {note}")
    if as_json:
        print_json({"hash": registry.type_hash(str(top)), **build_type_description(str(top), registry.field_rows)})
        return 0
    if full:
        echo(full_text(registry, owner).removesuffix("\n"))
        return 0
    echo((f"# {top}  {registry.type_hash(str(top))}", "bold"))
    text = source_text(registry, owner) if generated is None else full_text(registry, owner)
    echo(text.removesuffix("\n"))
    return 0
