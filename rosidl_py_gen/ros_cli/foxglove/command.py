"""``rosidl-py foxglove``: its options, with which `serve` is called."""

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
    """What was asked of ``foxglove``."""

    host: str
    port: int
    is_read_only: bool
    origins: Sequence[str]
    token: str
    most_mib: int
    per_s: int
    use_sim_time: bool
    queue: int
    hidden: bool
    paths: Sequence[str]
    as_json: bool


@click.command("foxglove")
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Where to listen; 0.0.0.0 lets other machines connect."
)
@click.option(
    "--port", type=click.IntRange(0, 65535), metavar="PORT", default=8765, show_default=True, help="0 takes a free one."
)
@click.option("--read-only", "is_read_only", is_flag=True, help="No publishing, calling and setting by viewers.")
@click.option(
    "--allow-origin",
    "origins",
    multiple=True,
    metavar="ORIGIN",
    help="Also let web pages of ORIGIN connect, such as https://example.org; * lets every page. May be repeated.",
)
@click.option(
    "--token",
    default="",
    envvar="ROSIDL_PY_FOXGLOVE_TOKEN",
    show_envvar=True,
    help="Viewers have to give ?token=TOKEN.",
)
@click.option(
    "--max-message",
    "most_mib",
    type=click.IntRange(1, 64),
    default=16,
    show_default=True,
    metavar="MIB",
    help="The largest message of a viewer.",
)
@click.option(
    "--max-rate",
    "per_s",
    type=click.IntRange(1, 1_000_000),
    default=1000,
    show_default=True,
    metavar="PER_SECOND",
    help="Messages of a viewer; one that sends more is read more slowly.",
)
@click.option("--use-sim-time", is_flag=True, help="Tell viewers the time of /clock, also if it appears later.")
@click.option(
    "--queue",
    type=click.IntRange(16, 1 << 16),
    default=256,
    show_default=True,
    metavar="MESSAGES",
    help="How many may wait for a slow viewer; then the oldest are left out.",
)
@click.option("--include-hidden-topics", "hidden", is_flag=True, help="Also topics and services that begin with _.")
@options.paths
@options.as_json
@options.node_options
@verb
def foxglove(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
    """Show topics, parameters, services and the graph live in Foxglove or Lichtblick.

    Prints the address and serves it until Ctrl-C. A topic is subscribed to while somebody watches it.

    \b
    rosidl-py foxglove
    rosidl-py foxglove --host 0.0.0.0 --read-only
    """
    from rosidl_py_gen.ros_cli.foxglove.serve import serve

    return AsyncCommand(serve(network, FoxgloveOptions(**arguments)), endless=True)
