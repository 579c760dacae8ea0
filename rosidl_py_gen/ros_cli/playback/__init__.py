"""Command ``rosidl-py bag play`` and its options, which equal the options of ``ros2 bag play``.

`senders` has publishers and clients, and `player` reads bags and sends each message when it is due.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.command_support import NetworkOptions
    from rosidl_py_gen.ros_cli import AsyncCommand
    from rosidl_py_gen.ros_cli.options import F


def _names(of: str, *names: str, help: str) -> Callable[[F], F]:
    """Add an option for several names of topics, services or actions (`of`), completed from the bag."""
    return options.several(*names, shell_complete=options.bag_completion(of), metavar=f"{of.upper()}...", help=help)


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """Options of ``bag play``; times in seconds, None if not given."""

    path: str | None
    inputs: Sequence[str]
    storage: str | None
    rate: float
    loop: bool
    topics: Sequence[str]
    services: Sequence[str]
    actions: Sequence[str]
    regex: str | None
    exclude_topics: Sequence[str]
    exclude_services: Sequence[str]
    exclude_actions: Sequence[str]
    exclude_regex: str | None
    offset_s: float
    playback_duration_s: float | None
    until_s: float | None
    until_nanoseconds: int | None
    duration_s: float | None
    delay_s: float
    remaps: Sequence[str]
    qos_file: str | None
    clock_hz: float | None
    clock_topics: Sequence[str]
    clock_topics_all: bool
    start_paused: bool
    no_keys: bool
    acked_ms: int | None
    publish_requests: bool
    actions_as_client: bool
    requests_source: str
    order: str
    read_ahead: int
    progress_hz: float
    no_loans: bool
    paths: Sequence[str] = ()

    @property
    def bags(self) -> Sequence[str]:
        """Paths of the bags that are played."""
        return [self.path] if self.path else self.inputs

    @property
    def playback_s(self) -> float | None:
        """Maximum duration of playback in seconds; None for negative values, as in rosbag2."""
        return None if self.playback_duration_s is None or self.playback_duration_s < 0 else self.playback_duration_s

    @property
    def until_ns(self) -> int | None:
        """End of playback, in nanoseconds since 1970."""
        end_ns = self.until_nanoseconds if self.until_s is None else round(self.until_s * 1_000_000_000)
        return None if end_ns is None or end_ns < 0 else end_ns

    @property
    def has_clock(self) -> bool:
        """True if the options request to publish ``/clock``."""
        return self.clock_hz is not None or bool(self.clock_topics) or self.clock_topics_all


_ALTERNATIVES = (
    {"clock_hz": "--clock", "clock_topics": "--clock-topics", "clock_topics_all": "--clock-topics-all"},
    {"until_s": "--playback-until-sec", "until_nanoseconds": "--playback-until-nsec"},
)


@click.command("play", cls=options.MultiValueCommand)
@click.argument("path", type=click.Path(), required=False, metavar="BAG")
@options.several("-i", "--input", "inputs", metavar="BAG", help="Bag; several are played together by their times.")
@click.option("-s", "--storage", type=click.Choice(["mcap", "sqlite3"]), help="Required storage format of all files.")
@click.option(
    "-r",
    "--rate",
    type=options.FiniteRange(0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="Speed relative to the recording; 2 is twice as fast.",
)
@click.option("-l", "--loop", is_flag=True, help="Repeat at the end.")
@_names(
    "topic", "--topics", help="Play only these topics, and the topics that --services, --actions and --regex select."
)
@_names("service", "--services", help="Play only the events of these services, or send requests to them.")
@_names("action", "--actions", help="Play only the topics and events of these actions.")
@click.option("-e", "--regex", metavar="REGEX", help="Play only names that match completely.")
@_names("topic", "--exclude-topics", help="Skip these topics.")
@_names("service", "--exclude-services", help="Skip these services.")
@_names("action", "--exclude-actions", help="Skip these actions.")
@click.option("-x", "--exclude-regex", "--exclude", metavar="REGEX", help="Skip names that match completely.")
@click.option(
    "--start-offset",
    "offset_s",
    type=options.FiniteRange(0),
    default=0.0,
    metavar="SECONDS",
    help="Time to skip at the beginning.",
)
@click.option(
    "--playback-duration",
    "playback_duration_s",
    type=options.FiniteRange(),
    metavar="SECONDS",
    help="Maximum duration.",
)
@click.option(
    "--playback-until-sec",
    "until_s",
    type=options.FiniteRange(),
    metavar="SECONDS",
    help="End time, in seconds since 1970.",
)
@click.option(
    "--playback-until-nsec",
    "until_nanoseconds",
    type=int,
    metavar="NANOSECONDS",
    help="End time, in nanoseconds since 1970. With --playback-duration, the later end counts.",
)
@click.option(
    "--duration", "duration_s", type=options.FiniteRange(0), metavar="SECONDS", help="Maximum duration, exclusive."
)
@click.option(
    "-d",
    "--delay",
    "delay_s",
    type=options.FiniteRange(0),
    default=0.0,
    metavar="SECONDS",
    help="Time to wait before the first message.",
)
@options.several("-m", "--remap", "remaps", metavar="FROM:=TO...", help="Rename topics or services.")
@click.option(
    "--qos-profile-overrides-path",
    "qos_file",
    type=click.Path(),
    metavar="FILE",
    help="YAML file with QoS profiles of topics.",
)
@click.option(
    "--clock",
    "clock_hz",
    type=options.FiniteRange(0, 10_000, min_open=True),
    is_flag=False,
    flag_value=40.0,
    metavar="[HZ]",
    help="Publish the time of the bag on /clock, for nodes with use_sim_time. [default rate: 40]",
)
@_names("topic", "--clock-topics", help="Publish /clock before each message of these.")
@click.option("--clock-topics-all", is_flag=True, help="Publish /clock before each message.")
@click.option("-p", "--start-paused", is_flag=True, help="Start paused; a key or a service resumes.")
@options.no_keys
@click.option(
    "--wait-for-all-acked",
    "acked_ms",
    type=click.IntRange(0),
    metavar="MILLISECONDS",
    help="Maximum time to wait at the end for acknowledgements; 0 waits without limit. [default: 5000]",
)
@click.option(
    "--publish-service-requests", "publish_requests", is_flag=True, help="Send service requests instead of events."
)
@click.option(
    "--send-actions-as-client",
    "actions_as_client",
    is_flag=True,
    help="Send the requests of actions instead of events.",
)
@click.option(
    "--service-requests-source",
    "requests_source",
    type=click.Choice(["service_introspection", "client_introspection"]),
    default="service_introspection",
    show_default=True,
    help="Side whose events are sent as requests.",
)
@click.option(
    "--message-order",
    "order",
    type=click.Choice(["received", "sent"]),
    default="received",
    show_default=True,
    help="Order by log time, or by publish time.",
)
@click.option(
    "--read-ahead-queue-size",
    "read_ahead",
    type=click.IntRange(1),
    default=1000,
    show_default=True,
    metavar="MESSAGES",
    help="Number of messages to sort with --message-order sent.",
)
@click.option(
    "--progress-bar-update-rate",
    "progress_hz",
    type=options.FiniteRange(),
    default=3.0,
    show_default=True,
    metavar="HZ",
    help="Update rate of the status line on a terminal; 0 disables it, below 0 updates it for each message.",
)
@click.option("--disable-loan-message", "no_loans", is_flag=True, hidden=True)
@options.paths
@options.node_options
@verb
def play(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
    """Publish the messages of a bag with the recorded timing and QoS.

    On a terminal, space pauses and resumes, the right arrow plays the next message while paused, up and down change the
    rate. The services of rosbag2's player, such as /rosbag2_player/pause, do the same.

    \b
    rosidl-py bag play my_bag --rate 2 --clock 100
    rosidl-py bag play my_bag --topics /scan /odom --remap /scan:=/old_scan --loop
    rosidl-py bag play my_bag --publish-service-requests --start-paused
    """
    if bool(arguments["path"]) == bool(arguments["inputs"]):
        raise click.UsageError("expected BAG, or --input BAG for each of several")
    for names in _ALTERNATIVES:
        used = [text for name, text in names.items() if arguments[name] not in (None, (), False)]
        if len(used) > 1:
            raise click.UsageError(f"expected only one of {', '.join(used)}")
    from rosidl_py_gen.ros_cli.playback.player import play_bag

    return play_bag(network, PlayOptions(**arguments))
