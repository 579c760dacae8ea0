"""Common parts of the executables: running a node until it is stopped, and errors of the command line."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

from rosidl_py_gen import get_message
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime import ParameterError, RosArgumentError, get_logger, run

WARNING_INTERVAL_S = 10.0
"""Time between two warnings about the messages of a topic, which may arrive at any rate."""


class ProgramError(RosidlError, ValueError):
    """Arguments or parameters of an executable are invalid; the executable ends with exit code 1."""


def serve(name: str, create: Callable[[], Any]) -> int:
    """Run the node of an object until SIGINT or SIGTERM; return the exit code, 1 if `create` raises our error."""

    async def main() -> int:
        try:
            node = create().node
        except (ParameterError, RosArgumentError):
            raise  # `run` knows the file or argument
        except RosidlError as error:
            get_logger(name).fatal(str(error))
            return 1
        async with node:
            await asyncio.Event().wait()
        return 0

    return run(main) or 0


def transform_message(parent: str, child: str, translation: Sequence[float], rotation: Sequence[float]) -> Any:
    """Return a ``geometry_msgs/msg/TransformStamped`` without stamp."""
    message: Any = get_message("geometry_msgs/msg/TransformStamped")()
    message.header.frame_id, message.child_frame_id = parent, child
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z = translation
    turn.x, turn.y, turn.z, turn.w = rotation
    return message
