"""Command ``rosidl-py demo``: a simulated robot that drives in a room.

It has sensors, services, an action and parameters. The package is also an example: it uses public names only.
`simulation` is the room, its physics and the time, `robot` has the nodes, and this module starts them.
"""

from __future__ import annotations

import logging
import math
import sys
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, options, verb

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractAsyncContextManager

    from rosidl_py_gen.command_support import CommandNode, NetworkOptions
    from rosidl_py_gen.ros_cli.demo.simulation import Schedule, World
    from rosidl_py_gen.runtime import Node

_MAX_ROBOTS = 20
EXAMPLES = """\
Try in another terminal:
  rosidl-py topic list -t
  rosidl-py topic echo {ns}/scan --once
  rosidl-py topic pub --rate 10 {ns}/cmd_vel geometry_msgs/msg/Twist '{{linear: {{x: 0.3}}, angular: {{z: 0.5}}}}'
  rosidl-py action send_goal {ns}/drive_spiral example_interfaces/action/Fibonacci '{{order: 6}}' --feedback
  rosidl-py param set {ns}/robot max_speed 0.8
  rosidl-py tf tree"""


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """Options of the command ``demo``."""

    namespace: str
    count: int
    seed: int
    sim_time: bool
    speed: float
    duration_s: float | None
    record: str | None


@click.command("demo")
@click.option("--namespace", default="", metavar="NAME", help="Namespace of all nodes, and prefix of their frames.")
@click.option(
    "--count",
    type=click.IntRange(1, _MAX_ROBOTS),
    default=1,
    metavar="N",
    help="Number of robots; several have the namespaces robot1, robot2 and so on.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="NUMBER",
    help="Number that selects the start, the way and the noise; with the same one the robot drives the same way.",
)
@click.option("--sim-time", is_flag=True, help="Publish /clock, and use its time, which starts at 0.")
@click.option(
    "--speed",
    type=options.FiniteRange(0, 1000, min_open=True),
    default=1.0,
    metavar="FACTOR",
    help="Simulated seconds per second, with --sim-time.",
)
@click.option(
    "--duration",
    "duration_s",
    type=options.FiniteRange(0, min_open=True),
    metavar="SECONDS",
    help="End after this time; with --sim-time in simulated seconds.",
)
@click.option(
    "--record",
    type=click.Path(),
    metavar="DIR",
    help="Record everything into this bag: a new folder, or a file that ends with .mcap.",
)
@options.node_options
@verb
def demo(network: NetworkOptions, **arguments: Any) -> AsyncCommand:
    """Run a small robot that drives in a room, until Ctrl-C.

    It publishes scan, odom, imu, battery_state, camera/image_raw, map, /tf and /tf_static. It drives autonomously. It
    follows commands on cmd_vel, stops 0.5 s after the last one, and drives autonomously again 5 s after it.

    It serves /reset, /set_motors and the action /drive_spiral, and has parameters. The camera is a lifecycle node.

    \b
    rosidl-py demo
    rosidl-py demo --count 3
    rosidl-py demo --namespace r2d2 --seed 7
    rosidl-py demo --sim-time --speed 10 --duration 60 --record drive
    """
    given = DemoOptions(**arguments)
    if given.speed != 1 and not given.sim_time:
        raise click.UsageError("--speed requires --sim-time")
    return AsyncCommand(_run(network, given), endless=True)


async def _run(network: NetworkOptions, given: DemoOptions) -> None:
    from rosidl_py_gen.command_support import CommandNode, terminal_output
    from rosidl_py_gen.ros_cli.demo.simulation import Schedule, World

    base = f"/{given.namespace.strip('/')}".rstrip("/")
    namespaces = [base] if given.count == 1 else [f"{base}/robot{number}" for number in range(1, given.count + 1)]
    settings: dict[str, Any] = {"parameter_overrides": {"use_sim_time": given.sim_time}}
    full_node = {"enable_rosout": True, "start_services": True, "parameter_events": True}
    with _only_errors_on_console():
        async with CommandNode(network, name="room", namespace=base, **full_node, **settings) as command_node:
            room, world = command_node.node, World()
            schedule = Schedule(room, world.advance, speed=given.speed if given.sim_time else None)
            _publish_map(room, schedule)
            nodes = [room]
            for number, namespace in enumerate(namespaces):
                nodes += await _start_robot(schedule, world, (given.seed, number), namespace, room, settings)
            async with await _recording(given.record, command_node, nodes, schedule):
                *others, last = [node.fully_qualified_name for node in nodes if node.name == "robot"]
                who = f"{', '.join(others)} and {last} drive" if others else f"{last} drives"
                terminal_output.line(f"{who} in a room of 8 m x 6 m; Ctrl-C ends the demo", "bold")
                if sys.stdout.isatty():
                    terminal_output.block(EXAMPLES.format(ns=namespaces[0]))
                await schedule.run(math.inf if given.duration_s is None else given.duration_s)


async def _recording(
    path: str | None, command_node: CommandNode, nodes: list[Node], schedule: Schedule
) -> AbstractAsyncContextManager[None]:
    if path is None:
        return nullcontext()
    from rosidl_py_gen.ros_cli.demo.recorder import recording

    await command_node.wait_for(command_node.node.node_names_complete)  # and which topics they have
    return recording(path, command_node.node, nodes, schedule)


def _publish_map(room: Node, schedule: Schedule) -> None:
    """Publish the map of the room once; subscribers that join later receive it as well."""
    from rosidl_py_gen import get_message
    from rosidl_py_gen.numpy import array_to_occupancygrid
    from rosidl_py_gen.ros_cli.demo.simulation import MAP_ORIGIN, RESOLUTION_M, occupancy
    from rosidl_py_gen.runtime import QoSProfile

    grid: Any = get_message("nav_msgs/msg/OccupancyGrid")
    message = array_to_occupancygrid(occupancy(), RESOLUTION_M, cls=grid)
    message.header.frame_id = "map"
    message.header.stamp = message.info.map_load_time = schedule.now.to_msg()
    message.info.origin.position.x, message.info.origin.position.y = MAP_ORIGIN.tolist()
    room.create_publisher(grid, "map", QoSProfile(depth=1).transient_local()).publish(message)


async def _start_robot(
    schedule: Schedule, world: World, seed: tuple[int, ...], namespace: str, room: Node, settings: dict[str, Any]
) -> list[Node]:
    """Start the two nodes of a robot, robot and camera; the camera becomes active."""
    from rosidl_py_gen.command_support import terminal_output
    from rosidl_py_gen.ros_cli.demo.robot import Camera, Robot, missing_pillow

    robot = Robot(schedule, world, seed, namespace, context=room.context, **settings)
    camera = Camera(
        schedule, world, robot.body, robot.frame("camera_optical"), namespace, context=room.context, **settings
    )
    await camera.configure()
    await camera.activate()
    if (missing := missing_pillow()) is not None:
        terminal_output.note_once(f"no topic camera/image_raw/compressed: {missing}")
    return [robot.node, camera]


@contextmanager
def _only_errors_on_console() -> Iterator[None]:
    """Print only error messages on the console; all log messages are published on ``/rosout``.

    The runtime prints nothing on the console while Python's root logger has a handler.
    """
    handler = logging.StreamHandler()
    handler.setLevel(logging.ERROR)
    handler.setFormatter(logging.Formatter("[%(levelname)s] [%(name)s]: %(message)s"))
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
