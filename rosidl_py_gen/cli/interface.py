"""Print a definition: its text, its type hash, its description, or everything it uses."""

from __future__ import annotations

import json

import click

from rosidl_py_gen.descriptions import describe
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.generate import load
from rosidl_py_gen.names import RosName, split_ros_name
from rosidl_py_gen.spec.find import search_path
from rosidl_py_gen.spec.resolve import Library

_LINE = "=" * 80


def run(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> int:
    """Returns the exit code."""
    top = split_ros_name(name, "msg")
    search = search_path(paths)
    owner = Library(search).owner(top) or top
    library, _ = load(search, [str(owner)])
    if not library.knows(str(top)):
        raise TypeNotFoundError(f"{owner} has no {top}")
    if as_json:
        click.echo(json.dumps({"hash": library.type_hash(str(top)), **describe(str(top), library.rows)}, indent=2))
        return 0
    if full:
        click.echo(full_text(library, owner), nl=False)
        return 0
    click.echo(click.style(f"# {top}  {library.type_hash(str(top))}", bold=True))
    click.echo(_text(library, owner), nl=False)
    return 0


def _text(library: Library, name: RosName) -> str:
    interface = library.interface(name)
    if interface is None:
        raise TypeNotFoundError(f"no interface {name}")
    text = interface.source.text
    return text if text.endswith("\n") else text + "\n"


def full_text(library: Library, top: RosName) -> str:
    """ros2msg text as bags and MCAP files carry it; `compile_text` reads it."""
    description = describe(str(top), library.rows)
    parts = [_text(library, top)]
    for one in description["referenced_type_descriptions"]:
        name = split_ros_name(one["type_name"])
        if name.kind == "msg":
            source = library.interface(name)
            mark = "IDL" if source is not None and source.source.format == "idl" else "MSG"
            shown = str(name) if mark == "IDL" else f"{name.package}/{name.name}"
            parts.append(f"{_LINE}\n{mark}: {shown}\n{_text(library, name)}")
    return "".join(parts)
