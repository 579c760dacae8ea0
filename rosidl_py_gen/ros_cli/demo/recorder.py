"""Recorder of the demo, which writes a bag with everything that the demo's nodes publish, and the commands that they
receive.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagError, BagWriter
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.runtime import Durability, Node, QoSProfile, Subscription

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.demo.simulation import Schedule

_DEPTH = 1000
_LAST_MESSAGES_S = 0.1
"""Time in seconds to wait at the end of a recorded drive for its last messages to arrive."""


@asynccontextmanager
async def recording(path: str, node: Node, nodes: Sequence[Node], schedule: Schedule) -> AsyncIterator[None]:
    """Record the messages of some nodes in the block; `node` owns the subscriptions.

    Raises:
        BagError: `path` exists already.
        OSError: a message could not be written; the recording ended there, while the robot drove on.
    """
    count = 0
    failure: Exception | None = None

    def subscribe(topic: str, type_name: str) -> Subscription[bytes]:
        def write(data: bytes) -> None:
            nonlocal count, failure
            if failure is not None:
                return
            try:
                bag.write(topic, data, schedule.now.nanoseconds)
                count += 1
            except (BagError, OSError) as error:
                failure = error
                terminal_output.note(f"the recording ends here: {error}")

        message = get_message(type_name)
        offered = [one.qos_profile for one in node.get_publishers_info_by_topic(topic)]
        is_latched = bool(offered) and all(one.durability is Durability.TRANSIENT_LOCAL for one in offered)
        requested = QoSProfile(depth=_DEPTH).transient_local() if is_latched else QoSProfile(depth=_DEPTH)
        bag.add_topic(topic, message, qos=offered)
        return node.create_subscription(message, topic, write, requested, raw=True)

    published: dict[str, list[str]] = {}
    subscribed: dict[str, list[str]] = {}
    for one in nodes:
        published.update(node.get_publisher_names_and_types_by_node(one.name, one.namespace))
        subscribed.update(node.get_subscriber_names_and_types_by_node(one.name, one.namespace))
    with BagWriter(path) as bag:
        for topic, types in published.items():
            if "/_action/" not in topic:
                await subscribe(topic, types[0]).wait_for_publishers()
        for topic, types in subscribed.items():
            if topic.endswith("/cmd_vel"):
                subscribe(topic, types[0])
        try:
            yield
            await asyncio.sleep(_LAST_MESSAGES_S)
        finally:
            terminal_output.note(f"recorded {pluralize(count, 'message')} in {path}")
    if failure is not None:
        raise failure
