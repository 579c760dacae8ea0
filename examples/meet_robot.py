"""A script for a robot with types it never saw: first strange_robot.py, then python examples/meet_robot.py

It watches the robot's battery, and stops the robot when a cell is low. Both types come from the robot itself: it is
asked for their definitions, which are checked against the hashes it announces. Seen:

    /battery is strange_msgs/msg/Battery: {"name": "", "cells": []}
    /drive is strange_msgs/msg/Drive: {"speed": 0.0, "reason": ""}
    the lowest cell is at 3.45 V
    ...
    stop: cell 1 is at 3.39 V
"""

from typing import Any

from rosidl_py_gen import to_json, type_name
from rosidl_py_gen.runtime import Node, run

LOW_V = 3.4


async def main() -> None:
    async with Node("visitor") as node:
        types: dict[str, Any] = {}
        for topic in ("/battery", "/drive"):
            types[topic] = await node.resolve_type(topic, timeout_s=20)
            print(f"{topic} is {type_name(types[topic])}: {to_json(types[topic]())}", flush=True)

        drive = node.create_publisher(types["/drive"], "/drive")
        await drive.wait_for_subscribers(timeout_s=10)
        async for battery in node.create_subscription(types["/battery"], "/battery"):
            volts = [cell.voltage for cell in battery.cells]
            if min(volts) < LOW_V:
                reason = f"cell {volts.index(min(volts))} is at {min(volts):.2f} V"
                drive.publish(types["/drive"](speed=0.0, reason=reason))
                print(f"stop: {reason}", flush=True)
                await drive.wait_for_acknowledged(timeout_s=5)
                return
            print(f"the lowest cell is at {min(volts):.2f} V", flush=True)


run(main)
