"""Command ``rosidl-py foxglove`` and its options; the package `rosidl_py_gen.foxglove` does the work."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.command_support import NetworkOptions


@click.command("foxglove")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on; 0.0.0.0 permits other machines to connect.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    default=8765,
    show_default=True,
    help="Port to listen on; 0 selects a free one.",
)
@click.option(
    "--read-only", "is_read_only", is_flag=True, help="Do not let viewers publish, call services and set parameters."
)
@click.option(
    "--allow-origin",
    "origins",
    multiple=True,
    metavar="ORIGIN",
    help="Permit web pages of ORIGIN, such as https://example.org; * permits all. May be repeated.",
)
@click.option(
    "--token", default="", envvar="ROSIDL_PY_FOXGLOVE_TOKEN", show_envvar=True, help="Require ?token=TOKEN of viewers."
)
@click.option(
    "--max-message",
    "max_mib",
    type=click.IntRange(1, 64),
    default=16,
    show_default=True,
    metavar="MIB",
    help="Maximum size of a message of a viewer.",
)
@click.option(
    "--max-rate",
    "per_s",
    type=click.IntRange(1, 1_000_000),
    default=1000,
    show_default=True,
    metavar="PER_SECOND",
    help="Maximum rate of messages of a viewer; a faster viewer is read more slowly.",
)
@click.option("--use-sim-time", is_flag=True, help="Send viewers the time of /clock, also if it appears later.")
@click.option(
    "--queue",
    type=click.IntRange(16, 1 << 16),
    default=256,
    show_default=True,
    metavar="MESSAGES",
    help="Maximum number of messages that wait for a slow viewer; the oldest are dropped.",
)
@click.option(
    "--include-hidden-topics", "hidden", is_flag=True, help="Also show topics and services that begin with _."
)
@options.paths
@options.as_json
@options.node_options
@verb
def foxglove(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
    """Show topics, parameters, services and the graph live in Foxglove or Lichtblick.

    Prints the address and serves it until Ctrl-C. A topic is subscribed to while a viewer watches it.

    \b
    rosidl-py foxglove
    rosidl-py foxglove --host 0.0.0.0 --read-only
    """
    from rosidl_py_gen.foxglove.serve import serve
    from rosidl_py_gen.foxglove.server import FoxgloveOptions

    return AsyncCommand(serve(network, FoxgloveOptions(**arguments)), endless=True)
