"""``bag record``: its options, which are those of ``ros2 bag record``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import click

from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli import AsyncCommand
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """What was asked of ``bag record``."""

    topics: Sequence[str]
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
    compression: str | None
    compression_mode: Literal["none", "file", "message"]
    threads: int
    cache_bytes: int | None
    split_bytes: int | None
    split_s: float | None
    duration_s: float | None
    custom_data: Mapping[str, str]
    snapshots: bool
    start_paused: bool
    no_keys: bool
    sim_time: bool
    node_name: str
    paths: Sequence[str]
    as_json: bool


_WHAT = (
    *("topics", "services", "actions", "topic_types", "regex"),
    *("everything", "all_topics", "all_services", "all_actions"),
)
"""What says what is recorded; one of them has to be given."""


def _several(*names: str, of: str = "", **settings: Any) -> Callable[[F], F]:
    """Of `of`: ``topics``, ``services`` or ``actions`` of the live graph, or ``types``, which are completed."""
    if of:
        settings["shell_complete"] = options.completion(of)
    return click.option(*names, cls=options.MultiValueOption, **settings)


def _pairs(ctx: click.Context, param: click.Parameter, value: Sequence[str]) -> dict[str, str]:
    """KEY=VALUE of each; the last one of a key counts."""
    found = {}
    for one in value:
        key, equals, text = one.partition("=")
        if not (key and equals):
            raise click.BadParameter(f'expected KEY=VALUE, found "{one}"')
        found[key] = text
    return found


@click.command("record", cls=options.MultiValueCommand)
@click.argument("topics", nargs=-1, cls=options.SeveralArgument, shell_complete=options.completion("topics"))
@_several("--topics", "more_topics", of="topics", metavar="TOPIC...", help="The same as TOPICS.")
@_several("--services", of="services", metavar="SERVICE...", help="The events of these, if they publish any.")
@_several("--actions", of="actions", metavar="ACTION...", help="Feedback and status of these, and events.")
@_several("--topic-types", of="types", metavar="TYPE...", help="Topics of these types.")
@click.option("-a", "--all", "everything", is_flag=True, help="All topics, services and actions that publish.")
@click.option("--all-topics", is_flag=True, help="Every topic that is published.")
@click.option("--all-services", is_flag=True, help="The events of all services that publish any.")
@click.option("--all-actions", is_flag=True, help="What belongs to actions, as --actions.")
@click.option("-e", "--regex", metavar="REGEX", help="Topics, services and actions whose name has a match.")
@click.option(
    "-x",
    "--exclude",
    "--exclude-regex",
    multiple=True,
    metavar="REGEX",
    help="Leave out those whose name has a match; may be given several times.",
)
@_several("--exclude-topics", of="topics", metavar="TOPIC...", help="Leave these out.")
@_several("--exclude-services", of="services", metavar="SERVICE...", help="Leave these out.")
@_several("--exclude-actions", of="actions", metavar="ACTION...", help="Leave these out.")
@_several("--exclude-topic-types", of="types", metavar="TYPE...", help="Leave topics of these types out.")
@click.option("--include-hidden-topics", "hidden", is_flag=True, help="Also those that begin with _.")
@click.option("--include-unpublished-topics", "unpublished", is_flag=True, help="Also those nobody publishes yet.")
@click.option("--ignore-leaf-topics", "no_leaves", is_flag=True, help="Not those nobody subscribes to.")
@click.option("--no-discovery", is_flag=True, help="Only the topics that are there at the beginning.")
@click.option(
    "-p",
    "--polling-interval",
    "polling_ms",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="MILLISECONDS",
    help="Look for new topics at most so often; 0 is as soon as they appear.",
)
@click.option(
    "--qos-profile-overrides-path",
    "qos_file",
    type=click.Path(),
    metavar="FILE",
    help="YAML: the quality of service to receive topics with.",
)
@click.option("-o", "--output", type=click.Path(), help="A folder, or a file that ends with .mcap.")
@click.option(
    "-s", "--storage", type=click.Choice(["mcap", "sqlite3"]), default="mcap", show_default=True, help="Of the output."
)
@click.option(
    "-f",
    "--serialization-format",
    type=click.Choice(["cdr"]),
    help="Of messages; there is no other.",
)
@click.option(
    "--compression",
    type=click.Choice(["zstd", "lz4", "none"]),
    help="Of chunks inside MCAP files: zstd, or none with --compression-mode.",
)
@click.option(
    "--compression-mode",
    type=click.Choice(["none", "file", "message"]),
    default="none",
    show_default=True,
    help="Compress whole files, or each message.",
)
@click.option("--compression-format", type=click.Choice(["zstd"]), help="Of --compression-mode.")
@click.option(
    "--compression-threads",
    "threads",
    type=click.IntRange(0, 256),
    default=0,
    metavar="COUNT",
    help="Of --compression-mode; 0 is one for each core for files, and one for messages.",
)
@options.split_options
@click.option(
    "--max-cache-size",
    "cache_bytes",
    type=click.IntRange(0),
    metavar="BYTES",
    help="Messages that may wait to be written, 512 MiB if nothing is said, or that a snapshot has, 100 MiB; "
    "0 writes each at once.",
)
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(0, min_open=True),
    metavar="SECONDS",
    help="End after so long, discovery included, instead of on Ctrl-C.",
)
@_several("--custom-data", callback=_pairs, metavar="KEY=VALUE...", help="Texts for metadata.yaml.")
@click.option("--snapshot-mode", "snapshots", is_flag=True, help="Write what came last when ~/snapshot is called.")
@click.option("--start-paused", is_flag=True, help="Record nothing until the space key or a service says so.")
@click.option("--disable-keyboard-controls", "no_keys", is_flag=True, help="Leave the keyboard alone.")
@click.option("--use-sim-time", "sim_time", is_flag=True, help="Times of /clock, and nothing before the first one.")
@click.option(
    "--node-name", default="rosbag2_recorder", show_default=True, metavar="NAME", help="Of the node that records."
)
@options.paths
@options.as_json
@options.node_options
@verb
def record(
    network: NetworkOptions,
    more_topics: Sequence[str],
    serialization_format: str | None,
    compression_format: str | None,
    **arguments: Any,
) -> AsyncCommand:
    """Record topics until Ctrl-C or SIGTERM. Messages stay as they are; types need not be installed.

    On a terminal, space pauses and goes on. The services of rosbag2's recorder, as /rosbag2_recorder/pause, do the
    same.

    \b
    rosidl-py bag record -a -o my_bag
    rosidl-py bag record /imu /scan -o short.mcap --compression lz4
    rosidl-py bag record --services /add_two_ints --actions /fibonacci
    rosidl-py bag record --regex '^/camera' --exclude depth --max-bag-size 1000000000
    """
    arguments["topics"] = [*arguments["topics"], *more_topics]
    if not any(arguments[name] for name in _WHAT):
        raise click.UsageError("say what to record: topics, --services, --actions, --topic-types, --regex, or --all")
    if compression_format and arguments["compression_mode"] == "none":
        raise click.UsageError("--compression-format is for --compression-mode file or message")
    if arguments["compression"] not in (None, "none") and arguments["storage"] == "sqlite3":
        raise click.UsageError("--compression is of chunks in MCAP files; SQLite bags have --compression-mode")
    if arguments["sim_time"] is True and arguments["no_discovery"] is True:
        raise click.UsageError("--use-sim-time waits for /clock, and --no-discovery waits for nobody")
    if arguments["snapshots"] and arguments["cache_bytes"] == 0:
        raise click.UsageError("--snapshot-mode has nothing to write with --max-cache-size 0")
    from rosidl_py_gen.ros_cli.recording.record import record_bag

    return record_bag(network, RecordOptions(**arguments))
