"""``rosidl-py topic``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import click

from rosidl_py_gen.tools import options, run_command

F = TypeVar("F", bound=Callable[..., Any])

_timeout = click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0),
    metavar="SECONDS",
    help="How long to wait for a topic that is not there yet.  [default: 5]",
)
_hidden = click.option(
    "-a",
    "--include-hidden-topics",
    "--include-hidden",
    "hidden",
    is_flag=True,
    help="Show hidden ones, which begin with _, too.",
)
_count = click.option("-c", "--count-topics", "count", is_flag=True, help="Print only how many there are.")


@click.group(no_args_is_help=True)
def topic() -> None:
    """Topics: list, info, echo, pub, hz, bw, delay, type, find."""


@topic.command("list")
@click.option("-t", "--show-types", is_flag=True, help="Show the types.")
@click.option("-v", "--verbose", is_flag=True, help="Show what is published and subscribed, and by how many.")
@_count
@_hidden
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the topics there are.

    \b
    rosidl-py topic list -t
    rosidl-py topic list --json | jq '.[].name'
    """
    run_command("topic.list", **arguments)


@topic.command()
@click.argument("type_name", metavar="TYPE", shell_complete=options.completion("types"))
@_count
@_hidden
@options.as_json
@options.node_options
def find(**arguments: Any) -> None:
    """Print the topics of a type.

    \b
    rosidl-py topic find sensor_msgs/msg/LaserScan
    """
    run_command("topic.list", show_types=False, verbose=False, **arguments)


@topic.command()
@options.topic_argument()
@click.option("-v", "--verbose", is_flag=True, help="Show every publisher and subscription: node, type, GID, QoS.")
@_timeout
@options.as_json
@options.node_options
def info(**arguments: Any) -> None:
    """Print the type of a topic, and who publishes and subscribes.

    \b
    rosidl-py topic info /scan -v
    """
    run_command("topic.info", **arguments)


@topic.command("type")
@options.topic_argument()
@_timeout
@options.as_json
@options.node_options
def type_(**arguments: Any) -> None:
    """Print the type of a topic.

    \b
    rosidl-py interface show $(rosidl-py topic type /scan)
    """
    run_command("topic.info", only_type=True, **arguments)


# ----------------------------------------------------------------------------------------------------- echo and pub


def _qos_options(command: F) -> F:
    """Handed on as `qos`: what the user said, None for the rest."""
    for option in reversed(_QOS_OPTIONS):
        command = option(command)
    return command


def _qos_option(name: str, into: str, **settings: Any) -> Callable[[F], F]:
    def put(ctx: click.Context, param: click.Parameter, value: Any) -> None:
        ctx.params.setdefault("qos", {})[into] = value

    return click.option(name, into, expose_value=False, callback=put, **settings)


_QOS_OPTIONS = (
    _qos_option(
        "--qos-profile",
        "preset",
        type=click.Choice(
            [
                *("default", "sensor_data", "system_default", "services_default", "parameters", "parameter_events"),
                *("action_status_default", "rosout_default", "best_available"),
            ]
        ),
        help="A preset; the other options change it.",
    ),
    _qos_option("--qos-depth", "depth", type=click.IntRange(0), metavar="N", help="Queue length."),
    _qos_option("--qos-history", "history", type=click.Choice(["system_default", "keep_last", "keep_all"])),
    _qos_option(
        "--qos-reliability",
        "reliability",
        type=click.Choice(["system_default", "reliable", "best_effort", "best_available"]),
    ),
    _qos_option(
        "--qos-durability",
        "durability",
        type=click.Choice(["system_default", "transient_local", "volatile", "best_available"]),
    ),
    _qos_option(
        "--qos-liveliness",
        "liveliness",
        type=click.Choice(["system_default", "automatic", "manual_by_topic", "best_available"]),
    ),
    _qos_option(
        "--qos-liveliness-lease-duration-seconds", "liveliness_lease_s", type=click.FloatRange(0), metavar="SECONDS"
    ),
)


@dataclass(frozen=True, slots=True)
class EchoOptions:
    """What was asked of ``topic echo``; `truncate_length` and `max_rate_hz` are None when the user did not say."""

    topic: str
    type_name: str | None
    once: bool
    fields: Sequence[str]
    filter_text: str | None
    max_rate_hz: float | None
    style: Literal["yaml", "flow", "csv", "json"]
    raw: bool
    full_length: bool
    truncate_length: int | None
    arrays: bool
    strings: bool
    lost_messages: bool
    timeout_s: float | None
    qos: dict[str, Any]
    paths: Sequence[str]


@topic.command(cls=options.SeveralCommand)
@options.topic_argument()
@click.argument("type_name", metavar="[TYPE]", required=False, shell_complete=options.call_completion("topic"))
@click.option("--once", is_flag=True, help="Print one message.")
@click.option(
    "--field",
    "fields",
    multiple=True,
    metavar="PATH",
    shell_complete=options.field_completion,
    help="Print only a field: pose.position, poses[0].x, ranges[0:5]. May be repeated.",
)
@click.option("--filter", "filter_text", metavar="EXPR", help="Print only messages m for which this holds.")
@click.option(
    "--max-rate",
    "max_rate_hz",
    type=click.FloatRange(0, min_open=True),
    metavar="HZ",
    help="Print at most so many messages a second, drop the others, and say at the end how many.",
)
@click.option("--csv", "style", flag_value="csv", help="Print all values of a message on a line.")
@click.option("--json", "style", flag_value="json", help="Print a line of JSON for each message, nothing cut.")
@click.option("--flow-style", "style", flag_value="flow", help="Print a line of YAML for each message.")
@click.option("--raw", is_flag=True, help="Print the bytes of messages; needs no definition.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@click.option(
    "-l", "--truncate-length", type=click.IntRange(0), metavar="N", help="Cut arrays and strings here.  [default: 128]"
)
@click.option("--no-arr", "arrays", is_flag=True, flag_value=False, default=True, help="Print no elements of arrays.")
@click.option("--no-str", "strings", is_flag=True, flag_value=False, default=True, help="Print no strings.")
@click.option(
    "--no-lost-messages",
    "lost_messages",
    is_flag=True,
    flag_value=False,
    default=True,
    help="Do not tell when messages come faster than they are printed.",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0),
    metavar="SECONDS",
    help="How long to wait for the topic, 5 if not given, and for a message, without end if not given.",
)
@_qos_options
@options.paths
@options.node_options
def echo(network: Any, style: Any, **arguments: Any) -> None:
    """Print the messages of a topic.

    \b
    rosidl-py topic echo /chatter
    rosidl-py topic echo /odom --field pose.pose.position --csv
    rosidl-py topic echo /rosout --filter 'm.level >= 30 and "lidar" in m.name'

    Without --qos-... options, it asks for what all publishers offer. In --filter there are comparisons, arithmetic, and
    or not in, abs all any bool float int isfinite isinf isnan len max min round sqrt sum, and
    any(x < 1 for x in m.ranges).
    """
    run_command("topic.echo", network=network, options=EchoOptions(style=style or "yaml", **arguments))


@dataclass(frozen=True, slots=True)
class PubOptions:
    """What was asked of ``topic pub``; `rate`, `times` and `wait` are None when the user did not say."""

    topic: str
    words: Sequence[str]
    rate: float | None
    once: bool
    times: int | None
    wait: int | None
    timeout_s: float | None
    print_every: int
    keep_alive_s: float
    qos: dict[str, Any]
    paths: Sequence[str]
    as_json: bool


@topic.command()
@options.topic_argument()
@click.argument("words", metavar="[TYPE] [VALUES]", nargs=-1, shell_complete=options.call_completion("topic"))
@click.option(
    "-r", "--rate", type=click.FloatRange(0, min_open=True), metavar="HZ", help="Messages a second.  [default: 1]"
)
@click.option("-1", "--once", is_flag=True, help="Publish one message and end.")
@click.option("-t", "--times", type=click.IntRange(1), metavar="N", help="Publish N messages and end.")
@click.option(
    "-w",
    "--wait-matching-subscriptions",
    "wait",
    type=click.IntRange(0),
    metavar="N",
    help="Wait for so many subscriptions first.  [default: 1 with --once, --times or -, else 0]",
)
@click.option(
    "--timeout",
    "--max-wait-time-secs",
    "timeout_s",
    type=click.FloatRange(0),
    metavar="SECONDS",
    help="How long to wait for the topic, 5 if not given, and for subscriptions, without end if not given.",
)
@click.option(
    "-p",
    "--print",
    "print_every",
    type=click.IntRange(0),
    default=1,
    metavar="N",
    help="Print every N-th message only; 0 prints none.",
)
@click.option(
    "--keep-alive",
    "keep_alive_s",
    type=click.FloatRange(0),
    default=0.1,
    show_default=True,
    metavar="SECONDS",
    help="Stay this long after the last message.",
)
@_qos_options
@options.paths
@options.as_json
@options.node_options
def pub(network: Any, **arguments: Any) -> None:
    """Publish messages.

    \b
    rosidl-py topic pub /chatter std_msgs/msg/String 'data: hello' --rate 10
    rosidl-py topic pub --once /goal geometry_msgs/msg/PoseStamped '{header: auto, pose: {position: {x: 1}}}'
    rosidl-py topic echo --json /a | rosidl-py topic pub /b -

    VALUES is YAML or JSON; what it leaves out has its default. "header: auto" and "stamp: now" are set for each
    message. With - each document of standard input is published once. TYPE may be left out for a topic that is there.
    """
    run_command("topic.pub", network=network, options=PubOptions(**arguments))


# ------------------------------------------------------------------------------------------------------------- figures


@dataclass(frozen=True, slots=True)
class MeterOptions:
    """What was asked of a command that measures."""

    topics: Sequence[str]
    window: int
    times: int | None
    timeout_s: float | None
    paths: Sequence[str]
    as_json: bool
    filter_text: str | None = None


def _figures(window: int) -> Callable[[F], F]:
    """Arguments and options of the commands that measure."""

    def add(command: F) -> F:
        for option in reversed(
            (
                options.topic_argument("topics", nargs=-1, required=True),
                click.option(
                    "-w",
                    "--window",
                    type=click.IntRange(2),
                    default=window,
                    show_default=True,
                    metavar="N",
                    help="How many messages count.",
                ),
                click.option("-n", "--times", type=click.IntRange(1), metavar="N", help="End after N reports."),
                _timeout,
                options.paths,
                options.as_json,
                options.node_options,
            )
        ):
            command = option(command)
        return command

    return add


@topic.command()
@_figures(10000)
@click.option("--filter", "filter_text", metavar="EXPR", help="Count only messages m for which this holds.")
def hz(network: Any, **arguments: Any) -> None:
    """Print how often messages arrive.

    \b
    rosidl-py topic hz /scan
    rosidl-py topic hz /scan /odom --json
    """
    run_command("topic.meter", network=network, kind="hz", options=MeterOptions(**arguments))


@topic.command()
@_figures(100)
def bw(network: Any, **arguments: Any) -> None:
    """Print how many bytes per second arrive.

    \b
    rosidl-py topic bw /camera/image_raw
    """
    run_command("topic.meter", network=network, kind="bw", options=MeterOptions(**arguments))


@topic.command()
@_figures(10000)
def delay(network: Any, **arguments: Any) -> None:
    """Print how old messages are when they arrive, by the stamp in their headers.

    \b
    rosidl-py topic delay /scan
    """
    run_command("topic.meter", network=network, kind="delay", options=MeterOptions(**arguments))
