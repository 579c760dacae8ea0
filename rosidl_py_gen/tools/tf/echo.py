"""``tf echo``: one transform, again and again, in the form of tf2_echo."""

from __future__ import annotations

import asyncio

import numpy as np

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.numpy import quaternion_to_euler
from rosidl_py_gen.tf import InvalidTransformError, Transform, TransformBuffer, TransformError, TransformTimeoutError
from rosidl_py_gen.tools import Job, ToolError, printing
from rosidl_py_gen.tools.session import Network, Session


def run(
    network: Network,
    target: str,
    source: str,
    once: bool,
    times: int | None,
    rate_hz: float,
    precision: int,
    timeout_s: float,
    as_json: bool,
) -> Job:
    """What the command does."""
    wanted = 1 if once else times
    return Job(_echo(network, target, source, wanted, rate_hz, precision, timeout_s, as_json), endless=wanted is None)


async def _echo(
    network: Network,
    target: str,
    source: str,
    times: int | None,
    rate_hz: float,
    precision: int,
    timeout_s: float,
    as_json: bool,
) -> int:
    async with Session(network) as session:
        buffer = TransformBuffer(session.node)
        try:
            await buffer.wait_for(target, source, timeout_s=timeout_s)
        except (TransformTimeoutError, InvalidTransformError) as error:
            raise ToolError(f'no transform from "{source}" to "{target}": {error}') from None
        while times is None or times > 0:
            try:
                _show(buffer.lookup(target, source), precision, as_json)
                times = None if times is None else times - 1
            except TransformError as error:
                printing.note(f"warning: {error}")
            if times != 0:
                await asyncio.sleep(1 / rate_hz)
    return 0


def _show(found: Transform, precision: int, as_json: bool) -> None:
    euler = np.array(quaternion_to_euler(found.rotation))
    if as_json:
        printing.document(
            {
                "target": found.target,
                "source": found.source,
                "stamp_ns": found.stamp,
                "translation": found.translation.tolist(),
                "rotation": found.rotation.tolist(),
                "euler": euler.tolist(),
            },
            in_stream=True,
        )
        return

    def shown(numbers: np.ndarray[tuple[int, ...], np.dtype[np.float64]], between: str = ", ") -> str:
        return between.join(f"{round(number, precision) + 0.0:.{precision}f}" for number in numbers.tolist())

    seconds, rest = sec_nanosec(found.stamp)
    rows = "\n".join(f"  {shown(row, '  ')}" for row in found.matrix)
    printing.block(
        f"At time {seconds}.{rest:09}\n"
        f"- Translation: [{shown(found.translation)}]\n"
        f"- Rotation: in Quaternion (xyzw) [{shown(found.rotation)}]\n"
        f"- Rotation: in RPY (radian) [{shown(euler)}]\n"
        f"- Rotation: in RPY (degree) [{shown(np.degrees(euler))}]\n"
        f"- Matrix:\n{rows}"
    )
