"""``interface proto``: messages with default values, quoted as one word of a shell for `topic pub`."""

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
@click.option("--no-quotes", is_flag=True, help="Print YAML without shell quotes.")
@options.paths
@options.as_json
@verb
def proto(name: str, no_quotes: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Print a message with all its fields as YAML: for a service its request, for an action its goal.

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
    """Return a message with default values: the request of a service, the goal of an action."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.compiler.frontend.registry import resolve_name
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

    name = resolve_name(scan_search_path(paths), text)
    try:
        suffix = _message_suffix(name)
        return get_message(f"{name}_{suffix}" if suffix else str(name), path=paths)()
    except TypeNotFoundError:
        from rosidl_py_gen.ros_cli.cached_definitions import cached_registry
        from rosidl_py_gen.type_loading.class_lookup import class_of_registry

        cached = cached_registry(text)
        if cached is None:
            raise
        library, name = cached
        cls: Any = class_of_registry(library, name, path=paths)
        message: Message = (getattr(cls, _message_suffix(name)) if _message_suffix(name) else cls)()
        return message


def _message_suffix(name: RosName) -> str:
    """Return the suffix of the message to fill in; empty for a message."""
    return "" if "_" in name.name else {"msg": "", "srv": "Request", "action": "Goal"}[name.kind]


def _quoted(text: str) -> str:
    """Return one word of a shell, in double quotes unless the text contains characters that a shell expands."""
    return shlex.quote(text) if any(char in text for char in '"\\$`!') else f'"{text}"'
