"""``rosidl-py param``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.group(no_args_is_help=True)
def param() -> None:
    """Parameters: list, get, set, describe, dump, load, delete."""


_timeout = options.timeout("Wait so long for the node, and for its answers.")
_name = click.argument("name", shell_complete=options.completion("parameters"))


@param.command("list")
@options.node_argument(required=False)
@click.option("--filter", "pattern", metavar="REGEX", help="Only those whose name begins with what REGEX matches.")
@click.option(
    "--param-prefixes",
    "prefixes",
    multiple=True,
    metavar="PREFIX",
    help="Only those below; may be given several times.",
)
@click.option("--param-type", "show_types", is_flag=True, help="Show the types.")
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Ask hidden nodes, too.")
@_timeout
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the parameters of a node, or of all nodes, which are asked at once.

    \b
    rosidl-py param list
    rosidl-py param list /talker --param-type
    rosidl-py param list --filter '.*rate'
    """
    run_command("param.list", **arguments)


@param.command()
@options.node_argument()
@_name
@click.option("--hide-type", is_flag=True, help="Print the value alone.")
@_timeout
@options.as_json
@options.node_options
def get(**arguments: Any) -> None:
    """Print the value of a parameter.

    \b
    rosidl-py param get /talker use_sim_time
    rosidl-py param get /talker rate --hide-type
    """
    run_command("param.get", **arguments)


@param.command("set", context_settings={"ignore_unknown_options": True})
@options.node_argument()
@_name
@click.argument("value")
@_timeout
@options.as_json
@options.node_options
def set_(**arguments: Any) -> None:
    """Set a parameter; VALUE is read as in a parameter file: 1 is an integer, 1.0 a double, on is true, '"1"' a text.

    \b
    rosidl-py param set /talker rate 2.5
    rosidl-py param set /talker names '[left, right]'
    """
    run_command("param.set", **arguments)


@param.command()
@options.node_argument()
@_name
@_timeout
@options.as_json
@options.node_options
def delete(**arguments: Any) -> None:
    """Delete a parameter, if the node lets us.

    \b
    rosidl-py param delete /talker label
    """
    run_command("param.set", value=None, **arguments)


@param.command()
@options.node_argument()
@click.argument("names", nargs=-1, required=True, metavar="NAME...", shell_complete=options.completion("parameters"))
@_timeout
@options.as_json
@options.node_options
def describe(**arguments: Any) -> None:
    """Print type, description and limits of parameters.

    \b
    rosidl-py param describe /talker rate use_sim_time
    """
    run_command("param.describe", **arguments)


@param.command()
@options.node_argument()
@click.option("-o", "--output", type=click.Path(dir_okay=False, writable=True), metavar="FILE", help="Write it there.")
@_timeout
@options.as_json
@options.node_options
def dump(**arguments: Any) -> None:
    """Print all parameters of a node as a parameter file.

    \b
    rosidl-py param dump /talker -o talker.yaml
    """
    run_command("param.dump", **arguments)


@param.command()
@options.node_argument()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, readable=True))
@_timeout
@options.as_json
@options.node_options
def load(**arguments: Any) -> None:
    """Set what a parameter file says for a node.

    \b
    rosidl-py param load /talker talker.yaml
    """
    run_command("param.load", **arguments)
