"""Print a topic of any type, installed or not, or copy it to another: python examples/echo_any.py /battery [/copy]

The type comes from whoever publishes. A copy is made of the bytes, without looking into them, and has the quality of
service that the publisher offers. Try it while strange_robot.py runs. Seen:

    strange_msgs/msg/Battery RIHS01_45fd688a...
    {"name": "main", "cells": [{"voltage": 3.5}, {"voltage": 3.4800000190734863}]}
"""

import os
import sys

from rosidl_py_gen import RosidlError, to_json, type_hash, type_name
from rosidl_py_gen.runtime import Node, run
from rosidl_py_gen.runtime.qos import BEST_AVAILABLE


async def echo(node: Node, topic: str) -> None:
    message_type = await node.resolve_type(topic, timeout_s=20)
    print(f"{type_name(message_type)} {type_hash(message_type)[:15]}...", flush=True)
    async for message in node.create_subscription(message_type, topic, qos=BEST_AVAILABLE):
        print(to_json(message), flush=True)


async def copy(node: Node, topic: str, to_topic: str) -> None:
    message_type = await node.resolve_type(topic, timeout_s=20)
    offered = node.get_publishers_info_by_topic(topic)[0].qos_profile
    publisher = node.create_publisher(message_type, to_topic, offered.keep_last(10))
    subscription = node.create_subscription(message_type, topic, qos=BEST_AVAILABLE, raw=True)
    print(f"copying {topic}, a {type_name(message_type)}, to {publisher.topic}", flush=True)
    async for data in subscription:
        publisher.publish_raw(data)


async def main() -> None:
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    async with Node(f"echo_any_{os.getpid()}") as node:  # another one may be running, and nodes need names of their own
        try:
            await (copy if len(sys.argv) > 2 else echo)(node, *sys.argv[1:])
        except RosidlError as error:
            print(error, file=sys.stderr)


run(main)
