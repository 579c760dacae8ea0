"""``interface show``: definitions with those of nested types."""

from __future__ import annotations

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb


@click.command("show")
@options.interface_argument("name", metavar="TYPE")
@click.option("--no-comments", is_flag=True, help="Omit comments and empty lines.")
@click.option("--all-comments", is_flag=True, help="Also show the comments of nested types.")
@options.paths
@options.as_json
@verb
def show(name: str, no_comments: bool, all_comments: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Print a definition, and below its fields the definitions of their types.

    TYPE is package/msg/Name, package/Name, a name that is unique among packages, or - for standard input.

    \b
    rosidl-py interface show geometry_msgs/msg/PoseStamped
    rosidl-py topic type /scan | rosidl-py interface show -

    --json prints the type description and the hash.
    """
    from rosidl_py_gen.base.descriptions import build_type_description
    from rosidl_py_gen.compiler.frontend.definition_text import expanded_lines
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
    from rosidl_py_gen.ros_cli.definitions import read_definition

    library, top = read_definition(scan_search_path(paths), name)
    if as_json:
        terminal_output.document(
            {"hash": library.type_hash(str(top)), **build_type_description(str(top), library.field_rows)}
        )
        return 0
    lines = expanded_lines(library, top, comments=not no_comments, nested_comments=all_comments and not no_comments)
    if not terminal_output.is_terminal():
        terminal_output.block("\n".join(lines))
        return 0
    for line in lines:
        terminal_output.block(line, "dim" if line.lstrip().startswith("#") else "")
    return 0
