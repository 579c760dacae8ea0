"""Second process of the self-test of ``doctor``, which publishes the messages that it receives.

The module stands here because modules of `ros_cli` import click.
"""

from __future__ import annotations

import asyncio

from rosidl_py_gen.command_support.command_node import CommandNode, NetworkOptions
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.runtime import run

_MAX_LIFETIME_S = 60
"""Maximum lifetime of the second process in seconds, which ends it if the command ``doctor`` was killed."""


def topics(test_id: str) -> tuple[str, str]:
    """Return the names of the hidden topics to and from the second process of the self-test."""
    return f"/_rosidl_py_doctor/{test_id}/there", f"/_rosidl_py_doctor/{test_id}/back"


async def main(domain_id: int, discovery: str, test_id: str) -> None:
    """Publish each received message on the topic back to ``doctor``, until this process is ended."""
    there, back = topics(test_id)
    async with CommandNode(NetworkOptions(domain_id=domain_id, discovery=discovery)) as command_node:
        out, messages = (
            command_node.node.create_publisher(Time, back),
            command_node.node.create_subscription(Time, there),
        )
        print("ready", flush=True)
        async for message in messages:
            out.publish(message)


def start(domain_id: str, discovery: str, test_id: str) -> None:
    """Run the second process of the self-test with the arguments of its command line."""
    # SIGTERM ends `run` in order; peers would wait for acknowledgements of a killed process.
    run(asyncio.wait_for(main(int(domain_id), discovery, test_id), _MAX_LIFETIME_S))
