"""``rosidl-py zenoh-router``: a router in this process until a signal ends it."""

from __future__ import annotations

import asyncio
import os
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime import ZenohRouter
from rosidl_py_gen.tools import Job

if TYPE_CHECKING:
    from collections.abc import Sequence


def run(listen: Sequence[str], connect: Sequence[str]) -> Job:
    """The command; ends with 0 when it is interrupted."""
    return Job(_serve(listen, connect), endless=True)


async def _serve(listen: Sequence[str], connect: Sequence[str]) -> int:
    with ZenohRouter(os.environ, _warn, listen=listen, connect=connect, log="error") as router:
        click.echo(printable(f"Zenoh router {router.zid} listens on {', '.join(router.endpoints)}"))
        await asyncio.Event().wait()
    return 0


def _warn(sentence: str) -> None:
    click.secho(f"warning: {printable(sentence)}", fg="yellow", err=True)
