"""``rosidl-py zenoh-router``."""

from typing import Any

import click

from rosidl_py_gen.tools import run_command


@click.command("zenoh-router")
@click.option(
    "--listen",
    multiple=True,
    metavar="ENDPOINT",
    help="Where to listen instead of tcp/[::]:7447, which is every interface; may be given several times.",
)
@click.option(
    "--connect",
    multiple=True,
    metavar="ENDPOINT",
    help="Another router to connect with, as tcp/192.168.1.5:7447; may be given several times.",
)
def zenoh_router(**arguments: Any) -> None:
    """Run a Zenoh router, through which nodes on rmw_zenoh find each other, until Ctrl-C.

    One is needed on each machine; its settings are those of rmw_zenohd. ZENOH_ROUTER_CONFIG_URI and
    ZENOH_CONFIG_OVERRIDE count. Whoever reaches it can join: see the guide for TLS and passwords.

    \b
    rosidl-py zenoh-router
    rosidl-py zenoh-router --listen tcp/127.0.0.1:7447
    rosidl-py zenoh-router --connect tcp/192.168.1.5:7447
    """
    run_command("zenoh_router", **arguments)
