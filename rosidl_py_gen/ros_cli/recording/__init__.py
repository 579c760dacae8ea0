"""Command ``bag record`` and its options, which equal the options of ``ros2 bag record``.

`recorder` selects topics and receives messages, `writer` writes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import click

from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.command_support import NetworkOptions
    from rosidl_py_gen.ros_cli import AsyncCommand
    from rosidl_py_gen.ros_cli.options import F


def _pairs(ctx: click.Context, param: click.Parameter, value: Sequence[str]) -> dict[str, str]:
    pairs = {}
    for pair in value:
        key, equals, text = pair.partition("=")
        if not (key and equals):
            raise click.BadParameter(f'expected KEY=VALUE, found "{pair}"')
        pairs[key] = text
    return pairs


_SELECTING_OPTIONS = (
    *("topics", "more_topics", "services", "actions", "topic_types", "regex"),
    *("everything", "all_topics", "all_services", "all_actions"),
)
"""Options that select topics; at least one is required."""


def _names(of: str, *names: str, help: str) -> Callable[[F], F]:
    """Add an option for several ``topics``, ``services``, ``actions`` or ``types`` (`of`) of the graph."""
    metavar = f"{names[-1].rpartition('-')[2].removesuffix('s').upper()}..."
    return options.several(*names, shell_complete=options.completion(of), metavar=metavar, help=help)


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """Options of the command ``bag record``."""

    topics: Sequence[str]
    more_topics: Sequence[str]
    services: Sequence[str]
    actions: Sequence[str]
    topic_types: Sequence[str]
    everything: bool
    all_topics: bool
    all_services: bool
    all_actions: bool
    regex: str | None
    exclude: Sequence[str]
    exclude_topics: Sequence[str]
    exclude_services: Sequence[str]
    exclude_actions: Sequence[str]
    exclude_topic_types: Sequence[str]
    hidden: bool
    unpublished: bool
    no_leaves: bool
    no_discovery: bool
    polling_ms: int
    qos_file: str | None
    output: str | None
    storage: str
    serialization_format: str | None
    compression: str | None
    compression_mode: Literal["none", "file", "message"]
    compression_format: str | None
    threads: int
    split_bytes: int | None
    split_s: float | None
    cache_bytes: int | None
    duration_s: float | None
    custom_data: Mapping[str, str]
    snapshots: bool
    start_paused: bool
    no_keys: bool
    sim_time: bool
    node_name: str
    paths: Sequence[str] = ()
    as_json: bool = False


@click.command("record", cls=options.MultiValueCommand)
@click.argument("topics", nargs=-1, cls=options.SeveralArgument, shell_complete=options.completion("topics"))
@_names("topics", "more_topics", "--topics", help="Record these topics, in addition to TOPICS.")
@_names("services", "--services", help="Record the events of these services, if they publish any.")
@_names("actions", "--actions", help="Record feedback, status and events of these actions.")
@_names("types", "--topic-types", help="Record topics of these types.")
@click.option("-a", "--all", "everything", is_flag=True, help="Record all topics, services and actions that publish.")
@click.option("--all-topics", is_flag=True, help="Record every published topic.")
@click.option("--all-services", is_flag=True, help="Record the events of all services that publish any.")
@click.option("--all-actions", is_flag=True, help="Record all actions, as with --actions.")
@click.option("-e", "--regex", metavar="REGEX", help="Record topics, services and actions whose name contains a match.")
@click.option(
    "-x",
    "--exclude",
    "--exclude-regex",
    multiple=True,
    metavar="REGEX",
    help="Skip names that contain a match. May be repeated.",
)
@_names("topics", "--exclude-topics", help="Skip these topics.")
@_names("services", "--exclude-services", help="Skip these services.")
@_names("actions", "--exclude-actions", help="Skip these actions.")
@_names("types", "--exclude-topic-types", help="Skip topics of these types.")
@click.option("--include-hidden-topics", "hidden", is_flag=True, help="Also record names that begin with _.")
@click.option(
    "--include-unpublished-topics", "unpublished", is_flag=True, help="Also record topics without publishers."
)
@click.option("--ignore-leaf-topics", "no_leaves", is_flag=True, help="Skip topics without subscribers.")
@click.option("--no-discovery", is_flag=True, help="Record only topics that exist at the start.")
@click.option(
    "-p",
    "--polling-interval",
    "polling_ms",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="MILLISECONDS",
    help="Minimum interval between searches for new topics; 0 records them as soon as they appear.",
)
@click.option(
    "--qos-profile-overrides-path",
    "qos_file",
    type=click.Path(),
    metavar="FILE",
    help="YAML file with QoS profiles of subscriptions.",
)
@click.option("-o", "--output", type=click.Path(), help="Folder, or file that ends with .mcap.")
@options.output_storage
@click.option("-f", "--serialization-format", type=click.Choice(["cdr"]), help="Serialization of messages.")
@click.option(
    "--compression",
    type=click.Choice(["zstd", "lz4", "none"]),
    help="Compression of chunks inside MCAP files. [default: zstd, none with --compression-mode]",
)
@click.option(
    "--compression-mode",
    type=click.Choice(["none", "file", "message"]),
    default="none",
    show_default=True,
    help="Compress whole files, or each message.",
)
@click.option("--compression-format", type=click.Choice(["zstd"]), help="Compression of --compression-mode.")
@click.option(
    "--compression-threads",
    "threads",
    type=click.IntRange(0, 256),
    default=0,
    metavar="COUNT",
    help="Threads of --compression-mode; 0 uses one for each core for files, and one for messages.",
)
@options.split_options
@click.option(
    "--max-cache-size",
    "cache_bytes",
    type=click.IntRange(0),
    metavar="BYTES",
    help="Maximum size of waiting messages [default: 512 MiB], or of a snapshot [default: 100 MiB]; 0 writes each "
    "message at once.",
)
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(0, min_open=True),
    metavar="SECONDS",
    help="Maximum duration, including discovery.",
)
@options.several("--custom-data", callback=_pairs, metavar="KEY=VALUE...", help="Texts for metadata.yaml.")
@click.option("--snapshot-mode", "snapshots", is_flag=True, help="Write the latest messages when ~/snapshot is called.")
@click.option("--start-paused", is_flag=True, help="Start paused; the space key or a service resumes.")
@options.no_keys
@click.option(
    "--use-sim-time", "sim_time", is_flag=True, help="Use the times of /clock, and skip messages before the first one."
)
@click.option(
    "--node-name", default="rosbag2_recorder", show_default=True, metavar="NAME", help="Name of the recording node."
)
@options.paths
@options.as_json
@options.node_options
@verb
def record(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
    """Record topics until Ctrl-C or SIGTERM. Messages are stored as received; types need not be installed.

    On a terminal, space pauses and resumes. The services of rosbag2's recorder, such as /rosbag2_recorder/pause, do the
    same.

    \b
    rosidl-py bag record -a -o my_bag
    rosidl-py bag record /imu /scan -o short.mcap --compression lz4
    rosidl-py bag record --services /add_two_ints --actions /fibonacci
    rosidl-py bag record --regex '^/camera' --exclude depth --max-bag-size 1000000000
    """
    given = RecordOptions(**arguments)
    if not any(arguments[name] for name in _SELECTING_OPTIONS):
        raise click.UsageError("expected topics, --services, --actions, --topic-types, --regex, or --all")
    if given.compression_format and given.compression_mode == "none":
        raise click.UsageError("--compression-format requires --compression-mode file or message")
    if given.compression not in (None, "none") and given.storage == "sqlite3":
        raise click.UsageError("--compression applies to chunks of MCAP files; use --compression-mode for SQLite bags")
    if given.sim_time is True and given.no_discovery is True:
        raise click.UsageError("--use-sim-time waits for /clock, which --no-discovery prevents")
    if given.snapshots and given.cache_bytes == 0:
        raise click.UsageError("--snapshot-mode requires a --max-cache-size above 0")
    from rosidl_py_gen.ros_cli.recording.recorder import record_bag

    return record_bag(network, given)
