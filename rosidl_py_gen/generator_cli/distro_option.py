"""The option ``--distro`` of both command lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.distributions import NAMES, distribution_of_command

if TYPE_CHECKING:
    from collections.abc import Callable

DISTRIBUTION = click.Choice(NAMES, case_sensitive=False)
"""Click type of a parameter that names a ROS 2 distribution."""


def _select(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    if value is not None:
        ctx.with_resource(distribution_of_command(value))


distro: Callable[[Any], Any] = click.option(
    "--distro",
    metavar="NAME",
    type=DISTRIBUTION,
    expose_value=False,
    callback=_select,
    help="ROS 2 distribution whose definitions are used: humble, jazzy, kilted or lyrical. [default: ROS_DISTRO, else "
    "jazzy]",
)
"""Decorator that adds ``--distro``, the ROS 2 distribution whose definitions a command uses."""
