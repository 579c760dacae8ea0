"""``rosidl-py bag play``: its options, which are those of ``ros2 bag play``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen.ros_cli import options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli import AsyncCommand
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions

F = TypeVar("F", bound=Callable[..., Any])


class _Finite(click.FloatRange):
    """A number within a range, which infinity and NaN are not."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        found = super().convert(value, param, ctx)
        if not isfinite(found):
            self.fail(f"{value} is no finite number", param, ctx)
        return found


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """What was asked of ``bag play``; times in seconds, None where nothing was said."""

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
    duration_s: float | None
    playback_duration_s: float | None
    until_s: float | None
    until_nanoseconds: int | None
    delay_s: float
    remaps: Sequence[str]
    qos_file: str | None
    clock_hz: float | None
    clock_topics: Sequence[str]
    clock_topics_all: bool
    no_keys: bool
    start_paused: bool
    acked_ms: int | None
    publish_requests: bool
    actions_as_client: bool
    requests_source: str
    order: str
    read_ahead: int
    progress_hz: float
    no_loans: bool
    paths: Sequence[str]

    @property
    def bags(self) -> Sequence[str]:
        """What is played."""
        return [self.path] if self.path else self.inputs

    @property
    def playback_s(self) -> float | None:
        """How much of it; below zero is how rosbag2 says that there is no limit."""
        return None if self.playback_duration_s is None or self.playback_duration_s < 0 else self.playback_duration_s

    @property
    def until_ns(self) -> int | None:
        """Until when, nanoseconds since 1970."""
        found = self.until_nanoseconds if self.until_s is None else round(self.until_s * 1_000_000_000)
        return None if found is None or found < 0 else found

    @property
    def has_clock(self) -> bool:
        """Whether ``/clock`` is published."""
        return self.clock_hz is not None or bool(self.clock_topics) or self.clock_topics_all


def _several(*names: str, of: str = "", **settings: Any) -> Callable[[F], F]:
    """Of `of`: ``topic``, ``service`` or ``action``, which are completed from the bag."""
    if of:
        settings["shell_complete"] = options.bag_completion(of)
        settings["metavar"] = f"{of.upper()}..."
    return click.option(*names, cls=options.MultiValueOption, **settings)


class _Play(options.MultiValueCommand):
    """Refuses options that do not go together."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        rest = super().parse_args(ctx, args)
        if not ctx.resilient_parsing:
            if bool(ctx.params["path"]) == bool(ctx.params["inputs"]):
                raise click.UsageError("say which bag to play: BAG, or --input BAG for each of several", ctx)
            for names in _ALTERNATIVES:
                given = [text for name, text in names.items() if ctx.params[name] not in (None, (), False)]
                if len(given) > 1:
                    raise click.UsageError(f"give only one of {', '.join(given)}", ctx)
        return rest


_ALTERNATIVES = (
    {"clock_hz": "--clock", "clock_topics": "--clock-topics", "clock_topics_all": "--clock-topics-all"},
    {"until_s": "--playback-until-sec", "until_nanoseconds": "--playback-until-nsec"},
)


@click.command("play", cls=_Play)
@click.argument("path", type=click.Path(), required=False, metavar="BAG")
@_several("-i", "--input", "inputs", metavar="BAG", help="A bag; several are played together, by their times.")
@click.option("-s", "--storage", type=click.Choice(["mcap", "sqlite3"]), help="Refuse others. Files say what they are.")
@click.option(
    "-r",
    "--rate",
    type=_Finite(0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="FACTOR",
    help="Speed relative to the recording; 2 is twice as fast.",
)
@click.option("-l", "--loop", is_flag=True, help="Begin again at the end.")
@_several("--topics", of="topic", help="Only these, and what --services, --actions and --regex name.")
@_several("--services", of="service", help="Only the events of these services, or requests to them.")
@_several("--actions", of="action", help="Only the topics and events of these actions.")
@click.option("-e", "--regex", metavar="REGEX", help="Only those whose whole name this matches.")
@_several("--exclude-topics", of="topic", help="Not these.")
@_several("--exclude-services", of="service", help="Not these.")
@_several("--exclude-actions", of="action", help="Not these.")
@click.option("-x", "--exclude-regex", "--exclude", metavar="REGEX", help="Not those whose whole name this matches.")
@click.option(
    "--start-offset",
    "offset_s",
    type=_Finite(0),
    default=0.0,
    metavar="SECONDS",
    help="Leave out the beginning.",
)
@click.option("--playback-duration", "playback_duration_s", type=_Finite(), metavar="SECONDS", help="Only so long.")
@click.option("--playback-until-sec", "until_s", type=_Finite(), metavar="SECONDS", help="Only until then, since 1970.")
@click.option(
    "--playback-until-nsec",
    "until_nanoseconds",
    type=int,
    metavar="NANOSECONDS",
    help="The same. With --playback-duration, the later end counts.",
)
@click.option(
    "--duration",
    "duration_s",
    type=_Finite(0),
    metavar="SECONDS",
    help="Only so long, without a message at its very end.",
)
@click.option(
    "-d", "--delay", "delay_s", type=_Finite(0), default=0.0, metavar="SECONDS", help="Wait before the first."
)
@_several("-m", "--remap", "remaps", metavar="FROM:=TO...", help="Other names.")
@click.option(
    "--qos-profile-overrides-path",
    "qos_file",
    type=click.Path(),
    metavar="FILE",
    help="YAML: the quality of service of topics.",
)
@click.option(
    "--clock",
    "clock_hz",
    type=_Finite(0, 10_000, min_open=True),
    is_flag=False,
    flag_value=40.0,
    metavar="[HZ]",
    help="Publish the time of the bag on /clock, for nodes with use_sim_time; 40 times a second if nothing is said.",
)
@_several("--clock-topics", of="topic", help="Publish /clock before each message of these.")
@click.option("--clock-topics-all", is_flag=True, help="Publish /clock before each message.")
@click.option("-p", "--start-paused", is_flag=True, help="Wait until a key or a service lets it go on.")
@click.option("--disable-keyboard-controls", "no_keys", is_flag=True, help="Leave the keyboard alone.")
@click.option(
    "--wait-for-all-acked",
    "acked_ms",
    type=click.IntRange(0),
    metavar="MILLISECONDS",
    help="At the end, wait until all is acknowledged; 0 is for ever. Else for 5 s at most.",
)
@click.option("--publish-service-requests", "publish_requests", is_flag=True, help="Send requests instead of events.")
@click.option("--send-actions-as-client", "actions_as_client", is_flag=True, help="The same for actions.")
@click.option(
    "--service-requests-source",
    "requests_source",
    type=click.Choice(["service_introspection", "client_introspection"]),
    default="service_introspection",
    show_default=True,
    help="Whose events are sent as requests.",
)
@click.option(
    "--message-order",
    "order",
    type=click.Choice(["received", "sent"]),
    default="received",
    show_default=True,
    help="By log time, or by publish time.",
)
@click.option(
    "--read-ahead-queue-size",
    "read_ahead",
    type=click.IntRange(1),
    default=1000,
    show_default=True,
    metavar="MESSAGES",
    help="By how many a message may be late in --message-order sent.",
)
@click.option(
    "--progress-bar-update-rate",
    "progress_hz",
    type=_Finite(),
    default=3.0,
    show_default=True,
    metavar="HZ",
    help="Of the line on a terminal that says how far it is; 0 for none, below for each message.",
)
@click.option("--disable-loan-message", "no_loans", is_flag=True, hidden=True)
@options.paths
@options.node_options
@verb
def play(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
    """Publish what a bag holds, as far apart as it was recorded, with the quality of service of then.

    On a terminal, space pauses and goes on, the right arrow plays the next message while it is paused, up and down
    change the rate. The services of rosbag2's player, as /rosbag2_player/pause, do the same.

    \b
    rosidl-py bag play my_bag --rate 2 --clock 100
    rosidl-py bag play my_bag --topics /scan /odom --remap /scan:=/old_scan --loop
    rosidl-py bag play my_bag --publish-service-requests --start-paused
    """
    from rosidl_py_gen.ros_cli.playback.play import play_bag

    return play_bag(network, PlayOptions(**arguments))
