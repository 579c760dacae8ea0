"""``bag record``: its options, which equal the options of ``ros2 bag record``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import click

from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli import AsyncCommand
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


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


def _names(of: str, *names: str, help: str) -> Any:
    """Declare an option for several ``topics``, ``services``, ``actions`` or ``types`` (`of`) of the graph."""
    metavar = f"{names[-1].rpartition('-')[2].removesuffix('s').upper()}..."
    return options.several(*names, shell_complete=options.completion(of), metavar=metavar, help=help)


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """Options of ``bag record``."""

    topics: Sequence[str]
    more_topics: Sequence[str] = _names("topics", "--topics", help="Record these topics, in addition to TOPICS.")
    services: Sequence[str] = _names(
        "services", "--services", help="Record the events of these services, if they publish any."
    )
    actions: Sequence[str] = _names("actions", "--actions", help="Record feedback, status and events of these actions.")
    topic_types: Sequence[str] = _names("types", "--topic-types", help="Record topics of these types.")
    everything: bool = options.flag("-a", "--all", help="Record all topics, services and actions that publish.")
    all_topics: bool = options.flag("--all-topics", help="Record every published topic.")
    all_services: bool = options.flag("--all-services", help="Record the events of all services that publish any.")
    all_actions: bool = options.flag("--all-actions", help="Record all actions, as with --actions.")
    regex: str | None = options.option(
        "-e", "--regex", metavar="REGEX", help="Record topics, services and actions whose name contains a match."
    )
    exclude: Sequence[str] = options.option(
        "-x",
        "--exclude",
        "--exclude-regex",
        multiple=True,
        metavar="REGEX",
        help="Skip names that contain a match. May be repeated.",
    )
    exclude_topics: Sequence[str] = _names("topics", "--exclude-topics", help="Skip these topics.")
    exclude_services: Sequence[str] = _names("services", "--exclude-services", help="Skip these services.")
    exclude_actions: Sequence[str] = _names("actions", "--exclude-actions", help="Skip these actions.")
    exclude_topic_types: Sequence[str] = _names("types", "--exclude-topic-types", help="Skip topics of these types.")
    hidden: bool = options.flag("--include-hidden-topics", help="Also record names that begin with _.")
    unpublished: bool = options.flag("--include-unpublished-topics", help="Also record topics without publishers.")
    no_leaves: bool = options.flag("--ignore-leaf-topics", help="Skip topics without subscribers.")
    no_discovery: bool = options.flag("--no-discovery", help="Record only topics that exist at the start.")
    polling_ms: int = options.option(
        "-p",
        "--polling-interval",
        type=click.IntRange(0),
        default=0,
        show_default=True,
        metavar="MILLISECONDS",
        help="Minimum interval between searches for new topics; 0 records them as soon as they appear.",
    )
    qos_file: str | None = options.option(
        "--qos-profile-overrides-path",
        type=click.Path(),
        metavar="FILE",
        help="YAML file with QoS profiles of subscriptions.",
    )
    output: str | None = options.option(
        "-o", "--output", type=click.Path(), help="Folder, or file that ends with .mcap."
    )
    storage: str = options.declared(options.output_storage)
    serialization_format: str | None = options.option(
        "-f", "--serialization-format", type=click.Choice(["cdr"]), help="Serialization of messages."
    )
    compression: str | None = options.option(
        "--compression",
        type=click.Choice(["zstd", "lz4", "none"]),
        help="Compression of chunks inside MCAP files. [default: zstd, none with --compression-mode]",
    )
    compression_mode: Literal["none", "file", "message"] = options.option(
        "--compression-mode",
        type=click.Choice(["none", "file", "message"]),
        default="none",
        help="Compress whole files, or each message.",
    )
    compression_format: str | None = options.option(
        "--compression-format", type=click.Choice(["zstd"]), help="Compression of --compression-mode."
    )
    threads: int = options.option(
        "--compression-threads",
        type=click.IntRange(0, 256),
        default=0,
        metavar="COUNT",
        help="Threads of --compression-mode; 0 uses one for each core for files, and one for messages.",
    )
    split_bytes: int | None = options.declared(options.max_bag_size)
    split_s: float | None = options.declared(options.max_bag_duration)
    cache_bytes: int | None = options.option(
        "--max-cache-size",
        type=click.IntRange(0),
        metavar="BYTES",
        help="Maximum size of waiting messages [default: 512 MiB], or of a snapshot [default: 100 MiB]; 0 writes each "
        "message at once.",
    )
    duration_s: float | None = options.option(
        "--duration",
        type=click.FloatRange(0, min_open=True),
        metavar="SECONDS",
        help="Maximum duration, including discovery.",
    )
    custom_data: Mapping[str, str] = options.several(
        "--custom-data", callback=_pairs, metavar="KEY=VALUE...", help="Texts for metadata.yaml."
    )
    snapshots: bool = options.flag("--snapshot-mode", help="Write the latest messages when ~/snapshot is called.")
    start_paused: bool = options.flag("--start-paused", help="Start paused; the space key or a service resumes.")
    no_keys: bool = options.declared(options.no_keys)
    sim_time: bool = options.flag(
        "--use-sim-time", help="Use the times of /clock, and skip messages before the first one."
    )
    node_name: str = options.option(
        "--node-name", default="rosbag2_recorder", show_default=True, metavar="NAME", help="Name of the recording node."
    )
    paths: Sequence[str] = ()
    as_json: bool = False


@click.command("record", cls=options.MultiValueCommand)
@click.argument("topics", nargs=-1, cls=options.SeveralArgument, shell_complete=options.completion("topics"))
@options.options_of(RecordOptions)
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
