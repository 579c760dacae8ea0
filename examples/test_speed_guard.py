"""Tests of a node as a user writes them: cd examples && python -m pytest test_speed_guard.py

The fixture `ros_node` comes with the package. Its nodes meet in memory, without DDS and network, and time is simulated:
what takes minutes on a robot takes no time here. Seen: 5 passed, within a second.
"""

import asyncio
from collections.abc import Callable

import pytest
from geometry_msgs.msg import Twist, Vector3
from speed_guard import SpeedGuard

from rosidl_py_gen.runtime import Node, WaitTimeoutError

MakeNode = Callable[..., Node]


class World:
    """The guard, and a node that drives it."""

    def __init__(self, ros_node: MakeNode, *arguments: str) -> None:
        self.tester = ros_node("tester")
        self.clock = self.tester.create_sim_time_publisher(rate=0.0)  # stands still unless it is moved
        SpeedGuard(ros_node("speed_guard", args=("--ros-args", "-p", "use_sim_time:=true", *arguments)))
        self.safe = self.tester.create_subscription(Twist, "cmd_vel_safe")
        self.commands = self.tester.create_publisher(Twist, "cmd_vel")

    async def command(self, speed: float) -> float:
        """What becomes of a command, in m/s."""
        self.commands.publish(Twist(linear=Vector3(x=speed), angular=Vector3(z=0.3)))
        return (await self.safe.receive(timeout_s=5)).linear.x


@pytest.mark.parametrize(("speed", "safe"), [(0.7, 0.7), (5.0, 1.0), (-5.0, -1.0)])
def test_speeds_are_limited(ros_node: MakeNode, speed: float, safe: float) -> None:
    world = World(ros_node)

    async def main() -> None:
        assert await world.command(speed) == safe

    asyncio.run(main())


def test_the_limit_follows_its_parameter(ros_node: MakeNode) -> None:
    world = World(ros_node, "-p", "max_speed:=2.0")

    async def main() -> None:
        assert await world.command(5.0) == 2.0
        parameters = world.tester.create_parameter_client("speed_guard")
        refused, agreed = await parameters.set({"max_speed": 9.0}) + await parameters.set({"max_speed": 0.2})
        assert (refused.successful, agreed.successful) == (False, True)
        assert await world.command(5.0) == 0.2

    asyncio.run(main())


def test_it_stops_when_commands_stay_away(ros_node: MakeNode, caplog: pytest.LogCaptureFixture) -> None:
    world = World(ros_node)

    async def main() -> None:
        world.clock.advance(100.0)
        await world.command(0.7)
        world.clock.advance(0.4)
        with pytest.raises(WaitTimeoutError):
            await world.safe.receive(timeout_s=0.05)
        world.clock.advance(0.2)
        assert (await world.safe.receive(timeout_s=5)).linear.x == 0.0
        assert "no command for 0.5 s: stop" in caplog.text

    asyncio.run(main())
