"""Commands of ``rosidl-py interface``: definitions of messages, services and actions, without a network."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.compiler.frontend import SearchPath

_KINDS = {"msg": "Messages", "srv": "Services", "action": "Actions"}
_kind_options = options.all_of(
    click.option("-m", "--only-msgs", "msgs", is_flag=True, help="Show the messages."),
    click.option("-s", "--only-srvs", "srvs", is_flag=True, help="Show the services."),
    click.option("-a", "--only-actions", "actions", is_flag=True, help="Show the actions."),
)


def _find_names(
    paths: tuple[str, ...], package: str, msgs: bool, srvs: bool, actions: bool
) -> tuple[SearchPath, list[str], list[RosName]]:
    """Return the search path, the selected kinds of interfaces (all if none is given), and the interfaces of these
    kinds.
    """
    from rosidl_py_gen.compiler.frontend import SearchPath
    from rosidl_py_gen.ros_cli.definitions import names_of

    selected = {"msg": msgs, "srv": srvs, "action": actions}
    kinds = [kind for kind, is_selected in selected.items() if is_selected] or list(selected)
    search = SearchPath.scan(paths)
    return search, kinds, names_of(search, package, kinds)


@click.command("list")
@click.argument("package", required=False, shell_complete=options.completion("packages"))
@_kind_options
@options.paths
@options.as_json
@verb
def list_(package: str | None, paths: tuple[str, ...], as_json: bool, msgs: bool, srvs: bool, actions: bool) -> None:
    """Print the available interfaces, of all packages or of one.

    \b
    rosidl-py interface list -s
    rosidl-py interface list --path ~/robot_ws/src my_msgs
    """
    _, kinds, names = _find_names(paths, package or "", msgs, srvs, actions)
    if as_json:
        terminal_output.document([str(name) for name in names])
    for kind in () if as_json else kinds:
        terminal_output.line(f"{_KINDS[kind]}:", "bold")
        terminal_output.lines(f"    {name}" for name in names if name.kind == kind)


@click.command("package")
@click.argument("package", shell_complete=options.completion("packages"))
@_kind_options
@options.paths
@options.as_json
@verb
def package(package: str, paths: tuple[str, ...], as_json: bool, msgs: bool, srvs: bool, actions: bool) -> None:
    """Print the interfaces of a package, one per line.

    \b
    rosidl-py interface package std_srvs
    """
    terminal_output.result(map(str, _find_names(paths, package, msgs, srvs, actions)[2]), as_json)


@click.command("packages")
@_kind_options
@options.paths
@options.as_json
@verb
def packages(paths: tuple[str, ...], as_json: bool, msgs: bool, srvs: bool, actions: bool) -> None:
    """Print the packages that have interfaces.

    \b
    rosidl-py interface packages -a
    """
    search, _, names = _find_names(paths, "", msgs, srvs, actions)
    packages = sorted({name.package for name in names})
    origins = {name: package.origin for name, package in search.packages.items()}
    rows = [{"name": name, "origin": origins.get(name, "generated")} for name in packages]
    terminal_output.result(packages, as_json, rows)


@click.command("show")
@options.interface_argument("name", metavar="TYPE")
@click.option("--no-comments", is_flag=True, help="Omit comments and empty lines.")
@click.option("--all-comments", is_flag=True, help="Also show the comments of nested types.")
@options.paths
@options.as_json
@verb
def show(name: str, no_comments: bool, all_comments: bool, paths: tuple[str, ...], as_json: bool) -> None:
    """Print a definition, and below its fields the definitions of their types.

    TYPE is package/msg/Name, package/Name, a name that is unique among packages, or - for standard input.

    \b
    rosidl-py interface show geometry_msgs/msg/PoseStamped
    rosidl-py topic type /scan | rosidl-py interface show -

    --json prints the type description and the hash.
    """
    from rosidl_py_gen.compiler.frontend import DefinitionText, SearchPath
    from rosidl_py_gen.ros_cli.definitions import read_definition

    library, top = read_definition(SearchPath.scan(paths), name)
    if as_json:
        description = library.type_description(str(top))
        terminal_output.document({"hash": library.type_hash(str(top)), **description})
        return
    text = DefinitionText(library, top)
    lines = text.expanded_lines(comments=not no_comments, nested_comments=all_comments and not no_comments)
    for line in lines if terminal_output.is_terminal() else ["\n".join(lines)]:
        terminal_output.block(line, "dim" if line.lstrip().startswith("#") else "")


@click.command("hash")
@options.interface_argument("names", metavar="TYPE...", nargs=-1, required=True)
@click.option("--parts", is_flag=True, help="Also print the hashes of the messages of services and actions.")
@options.paths
@options.as_json
@verb
def hash_(names: tuple[str, ...], parts: bool, paths: tuple[str, ...], as_json: bool) -> None:
    """Print the RIHS01 hash, which nodes compare to know if they use the same definition.

    \b
    rosidl-py interface hash std_msgs/msg/String
    rosidl-py interface hash --parts example_interfaces/action/Fibonacci
    """
    from rosidl_py_gen.compiler.frontend import SearchPath
    from rosidl_py_gen.ros_cli.definitions import read_definition

    search = SearchPath.scan(paths)
    hashes: dict[str, str] = {}
    for text in names:
        library, top = read_definition(search, text)
        for name in [str(top), *(library.parts(top) if parts else ())]:
            hashes[name] = library.type_hash(name)
    terminal_output.result((f"{value}  {name}" for name, value in hashes.items()), as_json, hashes)


@click.command("proto")
@options.interface_argument("name", metavar="TYPE")
@click.option("--no-quotes", is_flag=True, help="Print YAML without shell quotes.")
@options.paths
@options.as_json
@verb
def proto(name: str, no_quotes: bool, paths: tuple[str, ...], as_json: bool) -> None:
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
        return
    from rosidl_py_gen.ros_cli.message_text import to_yaml

    text = to_yaml(values, flow=None).rstrip("\n")
    terminal_output.block(text if no_quotes else _quoted(text))


def _example(text: str, paths: tuple[str, ...]) -> Message:
    """Return an example message of a type with default values; for a service its request, for an action its goal."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.compiler.frontend import SearchPath

    name = SearchPath.scan(paths).resolve(text)
    try:
        suffix = _message_suffix(name)
        return get_message(f"{name}_{suffix}" if suffix else str(name), path=paths)()
    except TypeNotFoundError:
        from rosidl_py_gen.ros_cli.definitions import find_cached

        cached = find_cached(text)
        if cached is None:
            raise
        cls, suffix = cached.load(paths), _message_suffix(cached.name)
        message: Message = (getattr(cls, suffix) if suffix else cls)()
        return message


def _message_suffix(name: RosName) -> str:
    """Return the name of the part of a type that users fill in: Request or Goal; "" for a message."""
    return "" if "_" in name.name else {"msg": "", "srv": "Request", "action": "Goal"}[name.kind]


def _quoted(text: str) -> str:
    """Return a text as one word of a shell, in double quotes unless it has characters that a shell would expand."""
    return shlex.quote(text) if any(char in text for char in '"\\$`!') else f'"{text}"'
