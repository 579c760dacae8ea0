"""``rosidl-py topic``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.group(no_args_is_help=True)
def topic() -> None:
    """Topics: list, info, echo, pub, hz, bw, delay, type, find."""


@topic.command("list")
@click.option("-t", "--show-types", is_flag=True, help="Show the types.")
@click.option("-v", "--verbose", is_flag=True, help="Show how many publish and subscribe, too.")
@click.option("-c", "--count-topics", "count", is_flag=True, help="Print only how many there are.")
@click.option("-a", "--include-hidden", "hidden", is_flag=True, help="Show hidden ones, which begin with _, too.")
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the topics there are.

    \b
    rosidl-py topic list -t
    rosidl-py topic list --json | jq '.[].name'
    """
    run_command("topic_list", **arguments)
