"""Command ``tf echo``: prints one transform repeatedly, in the form of tf2_echo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.ros_cli import options, terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    import numpy as np

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.tf import Transform


@click.command("echo")
@click.argument("target")
@click.argument("source")
@click.option("--once", is_flag=True, help="Print one transform and end.")
@options.report_count
@options.rate("-r", "--rate", "rate_hz", default=1.0, help="Lookups per second.")
@click.option(
    "-p",
    "--precision",
    type=click.IntRange(0, 17),
    metavar="N",
    default=3,
    show_default=True,
    help="Number of decimals.",
)
@options.timeout("Maximum time to wait for the first transform.", 10)
@options.as_json
@options.endless_node_verb(lambda arguments: not (arguments["once"] or arguments["times"]))
async def echo(
    command_node: CommandNode,
    target: str,
    source: str,
    once: bool,
    times: int | None,
    rate_hz: float,
    precision: int,
    timeout_s: float,
    as_json: bool,
) -> None:
    """Print the transform from SOURCE to TARGET repeatedly: the pose of SOURCE in TARGET.

    \b
    rosidl-py tf echo map base_link
    rosidl-py tf echo odom lidar --once --json
    """
    import asyncio

    from rosidl_py_gen.tf import InvalidTransformError, TransformBuffer, TransformError, TransformTimeoutError

    left = 1 if once else times
    buffer = TransformBuffer(command_node.node)
    try:
        await buffer.wait_for_transform(target, source, timeout_s=timeout_s)
    except (TransformTimeoutError, InvalidTransformError) as error:
        raise CommandError(f'no transform from "{source}" to "{target}": {error}') from None
    while left is None or left > 0:
        try:
            _show(buffer.lookup_transform(target, source), precision, as_json)
            left = None if left is None else left - 1
        except TransformError as error:
            terminal_output.note(f"warning: {error}")
        if left != 0:
            await asyncio.sleep(1 / rate_hz)


def _show(transform: Transform, precision: int, as_json: bool) -> None:
    import numpy as np

    from rosidl_py_gen.numpy import quaternion_to_euler

    euler = np.array(quaternion_to_euler(transform.rotation))
    if as_json:
        terminal_output.document(
            {
                "target": transform.target,
                "source": transform.source,
                "stamp_ns": transform.stamp,
                "translation": transform.translation.tolist(),
                "rotation": transform.rotation.tolist(),
                "euler": euler.tolist(),
            },
            in_stream=True,
        )
        return

    def text(numbers: np.ndarray[tuple[int, ...], np.dtype[np.float64]], between: str = ", ") -> str:
        return between.join(f"{round(number, precision) + 0.0:.{precision}f}" for number in numbers.tolist())

    seconds, rest = sec_nanosec(transform.stamp)
    rows = "\n".join(f"  {text(row, '  ')}" for row in transform.matrix)
    terminal_output.block(
        f"At time {seconds}.{rest:09}\n"
        f"- Translation: [{text(transform.translation)}]\n"
        f"- Rotation: in Quaternion (xyzw) [{text(transform.rotation)}]\n"
        f"- Rotation: in RPY (radian) [{text(euler)}]\n"
        f"- Rotation: in RPY (degree) [{text(np.degrees(euler))}]\n"
        f"- Matrix:\n{rows}"
    )
