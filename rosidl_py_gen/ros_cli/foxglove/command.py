"""``rosidl-py foxglove``: its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@dataclass(frozen=True, slots=True)
class FoxgloveOptions:
    """Options of ``foxglove``."""

    host: str = options.option(
        "--host", default="127.0.0.1", help="Address to listen on; 0.0.0.0 permits other machines to connect."
    )
    port: int = options.option(
        "--port",
        type=click.IntRange(0, 65535),
        metavar="PORT",
        default=8765,
        help="Port to listen on; 0 selects a free one.",
    )
    is_read_only: bool = options.flag(
        "--read-only", help="Do not let viewers publish, call services and set parameters."
    )
    origins: Sequence[str] = options.option(
        "--allow-origin",
        multiple=True,
        metavar="ORIGIN",
        help="Permit web pages of ORIGIN, such as https://example.org; * permits all. May be repeated.",
    )
    token: str = options.option(
        "--token",
        default="",
        envvar="ROSIDL_PY_FOXGLOVE_TOKEN",
        show_envvar=True,
        help="Require ?token=TOKEN of viewers.",
    )
    max_mib: int = options.option(
        "--max-message",
        type=click.IntRange(1, 64),
        default=16,
        metavar="MIB",
        help="Maximum size of a message of a viewer.",
    )
    per_s: int = options.option(
        "--max-rate",
        type=click.IntRange(1, 1_000_000),
        default=1000,
        metavar="PER_SECOND",
        help="Maximum rate of messages of a viewer; a faster viewer is read more slowly.",
    )
    use_sim_time: bool = options.flag(
        "--use-sim-time", help="Send viewers the time of /clock, also if it appears later."
    )
    queue: int = options.option(
        "--queue",
        type=click.IntRange(16, 1 << 16),
        default=256,
        metavar="MESSAGES",
        help="Maximum number of messages that wait for a slow viewer; the oldest are dropped.",
    )
    hidden: bool = options.flag("--include-hidden-topics", help="Also show topics and services that begin with _.")
    paths: Sequence[str] = ()
    as_json: bool = False


@click.command("foxglove")
@options.options_of(FoxgloveOptions)
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
    from rosidl_py_gen.ros_cli.foxglove.serve import serve

    return AsyncCommand(serve(network, FoxgloveOptions(**arguments)), endless=True)
