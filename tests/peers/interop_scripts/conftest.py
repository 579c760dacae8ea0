"""Observations of programs under real rclpy, in an environment of its own, and under ours; DDS on loopback."""

from __future__ import annotations

import asyncio
import sys
from functools import partial
from pathlib import Path

import pytest
from support.concurrent_programs import at_once
from support.environments import rclpy_python
from support.local_network import DOMAINS

sys.path.insert(0, str(Path(__file__).parent))

from observed_programs import PROGRAMS, Both, Case, Observed, Observer

_observations: dict[Path, dict[int, Both | BaseException]] = {}


@pytest.fixture
def observed(request: pytest.FixtureRequest, only_loopback: None, tmp_path_factory: pytest.TempPathFactory) -> Observed:
    """Return a function for the observations of a case. The first use in a file runs all of its selected cases."""
    if request.path not in _observations:
        python, cache = rclpy_python(), tmp_path_factory.mktemp("cache")
        items = [item for item in request.session.items if item.path == request.path and hasattr(item, "callspec")]
        given = [item.callspec.params.get("case") for item in items]
        cases = [case for case in given if isinstance(case, Case)]
        results = asyncio.run(at_once(partial(run_both, python, cache, case) for case in cases))
        _observations[request.path] = dict(zip(map(id, cases), results, strict=True))

    def find(case: Case) -> Both:
        result = _observations[request.path][id(case)]
        if isinstance(result, BaseException):
            raise result
        return result

    return find


async def run_both(python: Path, cache: Path, case: Case, domain: int) -> Both:
    """Return the observations under real rclpy and under ours."""
    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    program = str(PROGRAMS / f"{case.program}.py")
    real = {**own, "ROS_DOMAIN_ID": str(domain), "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    expected = await Observer(domain, case).run([str(python), program], real)
    domain += DOMAINS  # a killed process remains visible in its domain for a while
    ours = {**own, "ROS_DOMAIN_ID": str(domain), "ROSIDL_PY_GEN_CACHE": str(cache)}
    test_msgs = str(python.parents[1] / "share" / "test_msgs")
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "--path", test_msgs, program]
    return expected, await Observer(domain, case).run(command, ours, expected)
