"""A robot whose message types nobody else has: python examples/strange_robot.py, stop with Ctrl-C.

It drives, with a fresh battery every four seconds, until it is told to stop; echo_any.py and meet_robot.py are tried on
it. The definitions are in this file alone; a real robot has them in packages of its own. Seen:

    driving, cells at 3.50 V and 3.48 V
    driving, cells at 3.49 V and 3.47 V
    ...
    stopped by a visitor: cell 1 is at 3.39 V
"""

from rosidl_py_gen import compile_definition
from rosidl_py_gen.runtime import Node, run

Battery = compile_definition(
    "strange_msgs/msg/Battery",
    """\
string<=20 name
Cell[] cells        # in the order of their connection
================
MSG: strange_msgs/Cell
float32 voltage     # [V]
""",
)
Cell = compile_definition("strange_msgs/msg/Cell", "float32 voltage     # [V]\n")
Drive = compile_definition("strange_msgs/msg/Drive", "float32 speed       # [m/s]\nstring reason\n")


async def main() -> None:
    async with Node("strange_robot") as node:
        battery = node.create_publisher(Battery, "battery")
        commands = node.create_subscription(Drive, "drive")
        count = 0
        async for _ in node.create_timer(0.2):
            volts = 3.5 - 0.01 * (count % 20)
            count += 1
            battery.publish(Battery(name="main", cells=[Cell(voltage=volts), Cell(voltage=volts - 0.02)]))
            command = commands.latest()
            if command is not None and command.speed == 0:
                print(f"stopped by a visitor: {command.reason}", flush=True)
                return
            print(f"driving, cells at {volts:.2f} V and {volts - 0.02:.2f} V", flush=True)


run(main)
