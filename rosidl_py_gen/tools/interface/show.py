"""``interface show``."""

from __future__ import annotations

import click

from rosidl_py_gen.tools import options, printing, verb


@click.command("show")
@options.interface_argument("name", metavar="TYPE")
@click.option("--no-comments", is_flag=True, help="Leave comments and empty lines out.")
@click.option("--all-comments", is_flag=True, help="Show the comments of nested types, too.")
@options.paths
@options.as_json
@verb
def show(name: str, no_comments: bool, all_comments: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Print a definition, and below its fields the definitions of their types.

    TYPE is package/msg/Name, package/Name, a name that is in one package only, or - for standard input.

    \b
    rosidl-py interface show geometry_msgs/msg/PoseStamped
    rosidl-py topic type /scan | rosidl-py interface show -

    --json prints the type description and the hash.
    """
    from rosidl_py_gen.base.descriptions import describe
    from rosidl_py_gen.compiler.spec.definition import expanded_lines
    from rosidl_py_gen.compiler.spec.find import search_path
    from rosidl_py_gen.tools.definitions import read_definition

    library, top = read_definition(search_path(paths), name)
    if as_json:
        printing.document({"hash": library.type_hash(str(top)), **describe(str(top), library.rows)})
        return 0
    lines = expanded_lines(library, top, comments=not no_comments, nested_comments=all_comments and not no_comments)
    if not printing.is_terminal():
        printing.block("\n".join(lines))
        return 0
    for line in lines:
        printing.block(line, "dim" if line.lstrip().startswith("#") else "")
    return 0
