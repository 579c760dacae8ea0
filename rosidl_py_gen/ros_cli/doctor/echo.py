"""The other process of the doctor's self-test: sends back what it gets. Run with ``python -m``."""

from __future__ import annotations

import asyncio
import sys

from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
from rosidl_py_gen.runtime import run

LIFE_S = 60
"""Nobody needs it longer, should the doctor be killed."""


def topics(mark: str) -> tuple[str, str]:
    """There and back. Hidden, as the nodes are."""
    return f"/_rosidl_py_doctor/{mark}/there", f"/_rosidl_py_doctor/{mark}/back"


async def main(domain_id: int, discovery: str, mark: str) -> None:
    """Answer until somebody ends this process."""
    there, back = topics(mark)
    async with CommandNode(NetworkOptions(domain_id=domain_id, discovery=discovery)) as session:
        out, messages = session.node.create_publisher(Time, back), session.node.create_subscription(Time, there)
        print("ready", flush=True)
        async for message in messages:
            out.publish(message)


if __name__ == "__main__":
    # SIGTERM ends it in an orderly way: peers wait for what a killed process has not acknowledged.
    run(asyncio.wait_for(main(int(sys.argv[1]), sys.argv[2], sys.argv[3]), LIFE_S))
