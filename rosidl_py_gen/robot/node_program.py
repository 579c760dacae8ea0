"""Common functions of the robot executables: run a node until it is stopped, and report errors of the command line."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime import Durability, ParameterError, QoSProfile, RosArgumentError, get_logger, run

LATCHED = QoSProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
"""QoS profile of the topic ``robot_description``: a subscriber that joins later receives the last message."""
WARNING_INTERVAL_S = 10.0
"""Minimum time in seconds between two warnings about the messages of a topic, which may arrive at any rate."""


class ProgramError(RosidlError, ValueError):
    """Error of an executable's arguments or parameters; the executable ends with exit code 1."""


def serve(name: str, create: Callable[[], Any]) -> int:
    """Run the node of the object that `create` returns until SIGINT or SIGTERM; return the exit code.

    The exit code is 1 if `create` raises an error of this package, which is logged.
    """

    async def main() -> int:
        try:
            node = create().node
        except RosidlError as error:
            if isinstance(error, RosArgumentError) or (isinstance(error, ParameterError) and error.source):
                raise  # `run` prints the file or argument
            get_logger(name).fatal(str(error))
            return 1
        async with node:
            await asyncio.Event().wait()
        return 0

    return run(main) or 0
