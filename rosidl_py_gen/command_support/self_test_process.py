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


async def main(domain_id: int, discovery: str, there: str, back: str) -> None:
    """Publish each received message of the topic `there` on the topic `back`, until this process is ended."""
    async with CommandNode(NetworkOptions(domain_id=domain_id, discovery=discovery)) as command_node:
        out, messages = (
            command_node.node.create_publisher(Time, back),
            command_node.node.create_subscription(Time, there),
        )
        print("ready", flush=True)
        async for message in messages:
            out.publish(message)


def run_self_test_peer(domain_id: str, discovery: str, there: str, back: str) -> None:
    """Run the second process of the self-test with the arguments of its command line."""
    # SIGTERM ends `run` in order; peers would wait for acknowledgements of a killed process.
    run(asyncio.wait_for(main(int(domain_id), discovery, there, back), _MAX_LIFETIME_S))
