"""Parameters as a dataclass: python examples/parameters.py --ros-args --params-file examples/parameters.yaml

Change them with `ros2 param set /drive max_speed 1.5`, or from Python with `create_parameter_client`. Seen:
``manual, 1.2 m/s, left 120, tags ['indoor', 'slow']``, then ``max_speed = 1.5; the maximum speed is 1.5 m/s``.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from rosidl_py_gen.runtime import Node, Range, ReadOnly, run


@dataclass
class Motor:
    pwm: Annotated[int, Range(0, 255)] = 100


@dataclass
class Drive:
    max_speed: Annotated[float, Range(0.0, 2.5), "maximum speed in m/s"] = 0.8
    mode: Literal["auto", "manual"] = "auto"
    left: Motor = field(default_factory=Motor)  # nested: the parameter left.pwm
    tags: list[str] = field(default_factory=list)
    frame: Annotated[str, ReadOnly] = "base_link"
    limit: float | None = None  # may be unset


async def main() -> None:
    async with Node("drive") as node:
        changes = node.parameter_changes()
        drive = node.declare_parameters(Drive)
        print(f"{drive.mode}, {drive.max_speed} m/s, left {drive.left.pwm}, tags {drive.tags}", flush=True)
        async for name, value in changes:
            print(f"{name} = {value!r}; the maximum speed is {drive.max_speed} m/s", flush=True)


run(main)
