"""``rosidl-py log``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.command()
@click.option(
    "-l",
    "--level",
    type=click.Choice(["debug", "info", "warn", "error", "fatal"], case_sensitive=False),
    default="debug",
    help="Only this level and above.",
)
@click.option(
    "--node",
    "nodes",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("nodes"),
    help="Only loggers of this node, /ns/name or ns.name; * stands for anything, may be given several times.",
)
@click.option("-t", "--text", "pattern", metavar="REGEX", help="Only texts in which this is found.")
@click.option("-n", "--times", type=click.IntRange(1), metavar="COUNT", help="Stop after so many.")
@click.option("--new", "only_new", is_flag=True, help="Nothing of before now, which nodes keep for ten seconds.")
@click.option("-v", "--verbose", is_flag=True, help="Show file, line and function, too.")
@click.option("--bag", metavar="PATH", type=click.Path(), help="What was logged in a recording, and then end.")
@options.as_json
@options.node_options
def log(bag: str | None, **arguments: Any) -> None:
    """Follow what all nodes log, from /rosout.

    \b
    rosidl-py log
    rosidl-py log --level warn --node '/camera*'
    rosidl-py log --bag drive.mcap --text 'lost|late'
    """
    if bag is None:
        run_command("log.follow", **arguments)
    else:
        del arguments["network"]
        run_command("log.recorded", path=bag, **arguments)
