"""``interface proto``.

Decides how a prototype is quoted: as one word of a shell, which `topic pub` takes as it is.
"""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.cdr import Message


@click.command("proto")
@options.interface_argument("name", metavar="TYPE")
@click.option("--no-quotes", is_flag=True, help="Print YAML that is no single word of a shell.")
@options.paths
@options.as_json
@verb
def proto(name: str, no_quotes: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Print a message with all its fields as YAML, to be filled in; of a service its request, of an action its goal.

    \b
    rosidl-py interface proto geometry_msgs/msg/Twist
    rosidl-py topic pub --once /cmd_vel geometry_msgs/msg/Twist "$(rosidl-py interface proto --no-quotes Twist)"
    """
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.ros_cli.definitions import name_or_stdin

    values = to_dict(_example(name_or_stdin(name), paths))
    if as_json:
        terminal_output.document(values)
        return 0
    from rosidl_py_gen.ros_cli.message_text import to_yaml

    text = to_yaml(values, flow=None).rstrip("\n")
    terminal_output.block(text if no_quotes else _quoted(text))
    return 0


def _example(text: str, paths: tuple[str, ...]) -> Message:
    """A message with its default values: of a service the request, of an action the goal."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.compiler.frontend.definition_text import full_name
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

    name = full_name(scan_search_path(paths), text)
    try:
        half = _half(name)
        return get_message(f"{name}_{half}" if half else str(name), path=paths)()
    except TypeNotFoundError:
        from rosidl_py_gen.ros_cli.cached_definitions import cached_registry
        from rosidl_py_gen.type_loading.class_lookup import class_of_registry

        kept = cached_registry(text)
        if kept is None:
            raise
        library, name = kept
        cls: Any = class_of_registry(library, name, path=paths)
        made: Message = (getattr(cls, _half(name)) if _half(name) else cls)()
        return made


def _half(name: RosName) -> str:
    """Which part of an interface is filled in; empty for a message."""
    return "" if "_" in name.name else {"msg": "", "srv": "Request", "action": "Goal"}[name.kind]


def _quoted(text: str) -> str:
    """One word of a shell. Double quotes are nearer to the eye; what a shell would look into needs single ones."""
    return shlex.quote(text) if any(char in text for char in '"\\$`!') else f'"{text}"'
