"""A node worth testing: it limits speed, and stops the robot when commands stay away: python examples/speed_guard.py

`cmd_vel` comes in, `cmd_vel_safe` goes out; the parameters are `max_speed` in m/s and `timeout` in s. Its tests are in
test_speed_guard.py. Messages: rosidl-py-gen --install. Seen: nothing, until somebody commands:

    ros2 topic pub --once /cmd_vel geometry_msgs/msg/Twist "{linear: {x: 5.0}}"
    [WARN] [...] [speed_guard]: 5.0 m/s is more than 1.0 m/s
    [WARN] [...] [speed_guard]: no command for 0.5 s: stop
"""

from dataclasses import dataclass
from typing import Annotated

from geometry_msgs.msg import Twist, Vector3

from rosidl_py_gen.runtime import Node, Range, spin


@dataclass
class Limits:
    max_speed: Annotated[float, Range(0.0, 3.0), "in m/s"] = 1.0
    timeout: Annotated[float, Range(0.1, 10.0), "in s"] = 0.5


class SpeedGuard:
    """Everything it does, on any node that it is given."""

    def __init__(self, node: Node) -> None:
        self.logger = node.logger
        self.limits = node.declare_parameters(Limits)
        self.out = node.create_publisher(Twist, "cmd_vel_safe")
        self.watchdog = node.create_timer(self.limits.timeout, self.stop)
        self.watchdog.cancel()  # until the first command
        node.create_subscription(Twist, "cmd_vel", self.on_command)

    def on_command(self, command: Twist) -> None:
        fastest = self.limits.max_speed
        speed = command.linear.x
        if abs(speed) > fastest:
            self.logger.warning("%.1f m/s is more than %.1f m/s", speed, fastest)
            speed = max(-fastest, min(fastest, speed))
        self.out.publish(Twist(linear=Vector3(x=speed), angular=command.angular))
        self.watchdog.change_period(self.limits.timeout)
        self.watchdog.reset()

    def stop(self) -> None:
        self.logger.warning("no command for %.1f s: stop", self.limits.timeout)
        self.out.publish(Twist())
        self.watchdog.cancel()


if __name__ == "__main__":
    node = Node("speed_guard")
    SpeedGuard(node)
    spin(node)
