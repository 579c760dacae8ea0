"""``rosidl-py doctor``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.command()
@click.option("--report", is_flag=True, help="Print a text for an issue: no names of hosts, nodes and home folders.")
@options.paths
@options.as_json
@options.node_options
def doctor(**arguments: Any) -> None:
    """Check this installation, the network and the settings, and tell who answers.

    Ends with 1 when something is broken; what deserves a look is a warning.

    \b
    rosidl-py doctor
    rosidl-py doctor --domain 42 --discovery localhost
    rosidl-py doctor --report > report.txt
    """
    run_command("doctor.check", **arguments)
