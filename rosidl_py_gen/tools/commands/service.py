"""``rosidl-py service``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.group(no_args_is_help=True)
def service() -> None:
    """Services: list, find, type, info, call, echo."""


_hidden = click.option(
    "-a",
    "--include-hidden-services",
    "hidden",
    is_flag=True,
    help="Show hidden ones, too: those of actions, and others that begin with _.",
)
_count = click.option("-c", "--count-services", "count", is_flag=True, help="Print only how many there are.")


@service.command("list")
@click.option("-t", "--show-types", is_flag=True, help="Show the types.")
@_count
@_hidden
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the services there are.

    \b
    rosidl-py service list -t
    rosidl-py service list --json | jq '.[].name'
    """
    run_command("service.list", **arguments)


@service.command()
@click.argument("of_type", metavar="TYPE", shell_complete=options.completion("service types"))
@_count
@_hidden
@options.as_json
@options.node_options
def find(**arguments: Any) -> None:
    """Print the services of a type.

    \b
    rosidl-py service find std_srvs/srv/Trigger
    """
    run_command("service.list", **arguments)


@service.command("type")
@options.service_argument()
@options.as_json
@options.node_options
def type_(**arguments: Any) -> None:
    """Print the type of a service.

    \b
    rosidl-py service type /add_two_ints
    """
    run_command("service.info", only_type=True, **arguments)


@service.command()
@options.service_argument()
@click.option("-v", "--verbose", is_flag=True, help="Show who they are, their GIDs and QoS, too.")
@options.as_json
@options.node_options
def info(**arguments: Any) -> None:
    """Print the type of a service, and how many clients and servers it has.

    \b
    rosidl-py service info /add_two_ints -v
    """
    run_command("service.info", **arguments)


@dataclass(frozen=True, slots=True)
class CallOptions:
    """What was asked of ``service call``."""

    service: str
    words: Sequence[str]
    stdin: bool
    rate: float | None
    full_length: bool
    timeout_s: float
    paths: Sequence[str]
    as_json: bool


@service.command()
@options.service_argument()
@click.argument("words", nargs=-1, metavar="[TYPE] [VALUES]", shell_complete=options.call_completion("service"))
@click.option("--stdin", is_flag=True, help="Read the values from standard input.")
@click.option(
    "-r", "--rate", type=click.FloatRange(0, min_open=True), metavar="HZ", help="Call again and again, so often."
)
@click.option("-f", "--full-length", is_flag=True, help="Show long arrays and texts in full.")
@options.timeout("Wait so long for the server, and for each response.", default_s=10)
@options.paths
@options.as_json
@options.node_options
def call(network: Any, **arguments: Any) -> None:
    """Call a service; VALUES are YAML or JSON, what they leave out has its default.

    The type is found out when it is not given. --json prints the response alone.

    \b
    rosidl-py service call /add_two_ints '{a: 1, b: 2}'
    rosidl-py service call /add_two_ints example_interfaces/srv/AddTwoInts '{a: 1, b: 2}'
    rosidl-py service call /status std_srvs/srv/Trigger --rate 2 --json
    """
    run_command("service.call", network=network, options=CallOptions(**arguments))


@dataclass(frozen=True, slots=True)
class EchoOptions:
    """What was asked of ``service echo``."""

    service: str
    type_name: str | None
    once: bool
    full_length: bool
    flow_style: bool
    paths: Sequence[str]
    as_json: bool


@service.command()
@options.service_argument()
@click.argument("type_name", metavar="[TYPE]", required=False, shell_complete=options.call_completion("service"))
@click.option("--once", is_flag=True, help="End after the first event.")
@click.option("-f", "--full-length", is_flag=True, help="Show long arrays and texts in full.")
@click.option("--flow-style", is_flag=True, help="Print each event on one line.")
@options.paths
@options.as_json
@options.node_options
def echo(network: Any, **arguments: Any) -> None:
    """Print requests and responses as they pass, of servers and clients whose introspection is on.

    \b
    rosidl-py service echo /add_two_ints
    """
    run_command("service.echo", network=network, options=EchoOptions(**arguments))
