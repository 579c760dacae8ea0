"""Command ``rosidl-py zenoh-router``: runs a Zenoh router in this process until a signal ends it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.errors import printable
from rosidl_py_gen.ros_cli import AsyncCommand, verb

if TYPE_CHECKING:
    from collections.abc import Sequence


@click.command("zenoh-router")
@click.option(
    "--listen",
    multiple=True,
    metavar="ENDPOINT",
    help="Endpoint to listen on. May be repeated.  [default: tcp/[::]:7447, all interfaces]",
)
@click.option(
    "--connect",
    multiple=True,
    metavar="ENDPOINT",
    help="Endpoint of another router to connect to, such as tcp/192.168.1.5:7447. May be repeated.",
)
@verb
def zenoh_router(listen: Sequence[str], connect: Sequence[str]) -> AsyncCommand:
    """Run a Zenoh router until Ctrl-C. Nodes on rmw_zenoh discover each other through it.

    Each machine needs one. Settings are as for rmw_zenohd: ZENOH_ROUTER_CONFIG_URI and ZENOH_CONFIG_OVERRIDE.
    Every host that reaches it can join: see the guide for TLS and passwords.

    \b
    rosidl-py zenoh-router
    rosidl-py zenoh-router --listen tcp/127.0.0.1:7447
    rosidl-py zenoh-router --connect tcp/192.168.1.5:7447
    """
    return AsyncCommand(_serve(listen, connect), endless=True)


async def _serve(listen: Sequence[str], connect: Sequence[str]) -> None:
    import asyncio

    from rosidl_py_gen.runtime import ZenohRouter

    with ZenohRouter(os.environ, _warn, listen=listen, connect=connect, log="error") as router:
        click.echo(printable(f"Zenoh router {router.zid} listens on {', '.join(router.endpoints)}"))
        await asyncio.Event().wait()


def _warn(sentence: str) -> None:
    click.secho(f"warning: {printable(sentence)}", fg="yellow", err=True)
