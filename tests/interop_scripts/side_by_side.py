"""Runs of cases, several at once, because most of their time is waiting; each has two domains of its own."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from support.concurrent_programs import at_once
from support.node_fixtures import DOMAINS
from two_rclpys import PROGRAMS, Case, Observation, Observer

Both = tuple[Observation, Observation]
Observed = Callable[[Case], Both]


@dataclass
class Setting:
    """Environment of the programs.

    Attributes:
        real_python: a Python with rclpy, in an environment of its own.
        code_cache: folder for compiled message classes of our rclpy.
    """

    real_python: Path
    code_cache: Path

    @property
    def test_msgs(self) -> Path:
        return self.real_python.parents[1] / "share" / "test_msgs"

    async def both(self, case: Case, domain: int) -> Both:
        """Return the observations under real rclpy and under ours."""
        own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        program = str(PROGRAMS / f"{case.program}.py")
        real = {**own, "ROS_DOMAIN_ID": str(domain), "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
        expected = await Observer(domain, case).run([str(self.real_python), program], real)
        domain += DOMAINS  # what was killed in the first one is missed there after a while only
        ours = {**own, "ROS_DOMAIN_ID": str(domain), "ROSIDL_PY_GEN_CACHE": str(self.code_cache)}
        command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "--path", str(self.test_msgs), program]
        return expected, await Observer(domain, case).run(command, ours, expected)


async def run_all(cases: Iterable[Case], setting: Setting) -> list[Both | BaseException]:
    """Return both observations of each case, or the exception."""
    return await at_once(partial(setting.both, case) for case in cases)
