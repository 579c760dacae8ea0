"""``rosidl-py tf``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command

_times = click.option("-n", "--times", type=click.IntRange(1), metavar="COUNT", help="Stop after so many reports.")


@click.group(no_args_is_help=True)
def tf() -> None:
    """Transforms: frames as a tree, one transform, rates and delays."""


@tf.command()
@click.argument("target")
@click.argument("source")
@click.option("--once", is_flag=True, help="Print one and stop.")
@_times
@click.option(
    "-r",
    "--rate",
    "rate_hz",
    type=click.FloatRange(0, min_open=True),
    default=1.0,
    show_default=True,
    metavar="HZ",
    help="Lookups per second.",
)
@click.option(
    "-p", "--precision", type=click.IntRange(0, 17), metavar="N", default=3, show_default=True, help="Digits."
)
@options.timeout("Wait so long for the first one.", 10)
@options.as_json
@options.node_options
def echo(**arguments: Any) -> None:
    """Print where SOURCE is in TARGET, again and again: the transform from SOURCE to TARGET.

    \b
    rosidl-py tf echo map base_link
    rosidl-py tf echo odom lidar --once --json
    """
    run_command("tf.echo", **arguments)


@tf.command()
@options.drawn("png")
@click.option(
    "--wait-time",
    "wait_s",
    type=click.FloatRange(0, 3600),
    default=2.0,
    show_default=True,
    metavar="SECONDS",
    help="How long to listen.",
)
@click.option("--bag", metavar="PATH", type=click.Path(), help="The frames of a recording, nothing of the network.")
@options.node_options
def tree(bag: str | None, **arguments: Any) -> None:
    """Show which frame has which parent, how often transforms come, how late, and from which node.

    \b
    rosidl-py tf tree
    rosidl-py tf tree -o frames.png
    rosidl-py tf tree --bag drive.mcap --format mermaid
    """
    if bag is None:
        run_command("tf.tree", **arguments)
    else:
        del arguments["network"], arguments["wait_s"]
        run_command("tf.recorded", path=bag, **arguments)


@tf.command()
@click.argument("frames", nargs=-1)
@_times
@click.option(
    "-w",
    "--window",
    type=click.IntRange(2),
    default=1000,
    show_default=True,
    metavar="COUNT",
    help="How many transforms of each frame count.",
)
@options.as_json
@options.node_options
def monitor(**arguments: Any) -> None:
    """Print once a second how often the transform of each frame comes, and how old it is then.

    With two FRAMES only those between them, and how old what is known of the whole way is.

    \b
    rosidl-py tf monitor
    rosidl-py tf monitor map lidar
    """
    run_command("tf.monitor", **arguments)
