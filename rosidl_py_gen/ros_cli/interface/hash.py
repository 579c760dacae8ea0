"""``interface hash``: type hashes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


@click.command("hash")
@options.interface_argument("names", metavar="TYPE...", nargs=-1, required=True)
@click.option("--parts", is_flag=True, help="Also print the hashes of the messages of services and actions.")
@options.paths
@options.as_json
@verb
def hash_(names: tuple[str, ...], parts: bool, paths: tuple[str, ...], as_json: bool) -> int:
    """Print the RIHS01 hash, which nodes compare to know if they use the same definition.

    \b
    rosidl-py interface hash std_msgs/msg/String
    rosidl-py interface hash --parts example_interfaces/action/Fibonacci
    """
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
    from rosidl_py_gen.ros_cli.definitions import read_definition

    search = scan_search_path(paths)
    hashes: dict[str, str] = {}
    for text in names:
        library, top = read_definition(search, text)
        for name in [str(top), *(_parts(library, top) if parts else ())]:
            hashes[name] = library.type_hash(name)
    if as_json:
        terminal_output.document(hashes)
    else:
        terminal_output.lines([f"{value}  {name}" for name, value in hashes.items()])
    return 0


def _parts(library: InterfaceRegistry, top: RosName) -> list[str]:
    from rosidl_py_gen.compiler.frontend.model import ActionDef, ServiceDef

    interface = library.interface(top)
    match interface:
        case ServiceDef():
            return [str(message.name) for message in interface.messages]
        case ActionDef():
            services = [str(service.name) for service in (interface.send_goal, interface.get_result)]
            return [*(str(message.name) for message in interface.messages), *services]
    return []
