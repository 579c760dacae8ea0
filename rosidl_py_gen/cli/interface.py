"""Print a definition: its text, its type hash, its description, or everything it uses."""

from __future__ import annotations

import json

import click

from rosidl_py_gen.base.descriptions import describe
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.spec.definition import full_text, read_checked, source_text
from rosidl_py_gen.compiler.spec.find import search_path
from rosidl_py_gen.compiler.spec.resolve import Library


def run(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> int:
    """Returns the exit code."""
    top = split_ros_name(name, "msg")
    library = Library(search_path(paths))
    owner = read_checked(library, top)
    if as_json:
        click.echo(json.dumps({"hash": library.type_hash(str(top)), **describe(str(top), library.rows)}, indent=2))
        return 0
    if full:
        click.echo(full_text(library, owner), nl=False)
        return 0
    click.echo(click.style(f"# {top}  {library.type_hash(str(top))}", bold=True))
    click.echo(source_text(library, owner), nl=False)
    return 0
