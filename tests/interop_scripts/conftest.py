"""Real rclpy in an environment of its own, and DDS on loopback."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest
from support.environments import environment
from support.node_fixtures import dds, only_loopback, pytest_pyfunc_call

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(1, str(Path(__file__).parents[1] / "interop_rclpy"))

from rclpy_peer import REQUIREMENTS
from side_by_side import Both, Observed, Setting, run_all
from two_rclpys import Case

__all__ = ["dds", "only_loopback", "pytest_pyfunc_call"]


@pytest.fixture(scope="session")
def real_python() -> Path:
    return environment("rclpy-jazzy", REQUIREMENTS["jazzy"])


_seen: dict[Path, dict[int, Both | BaseException]] = {}


@pytest.fixture
def observed(request: pytest.FixtureRequest, only_loopback: None, real_python: Path, code_cache: Path) -> Observed:
    """Return a function for the observations of a case. The first use in a file runs all of its selected cases."""
    if request.path not in _seen:
        here = [item for item in request.session.items if item.path == request.path]
        given = [item.callspec.params.get("case") for item in here if hasattr(item, "callspec")]
        cases = [case for case in given if isinstance(case, Case)]
        found = asyncio.run(run_all(cases, Setting(real_python, code_cache)))
        _seen[request.path] = dict(zip(map(id, cases), found, strict=True))

    def look(case: Case) -> Both:
        seen = _seen[request.path][id(case)]
        if isinstance(seen, BaseException):
            raise seen
        return seen

    return look


@pytest.fixture(scope="session")
def code_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")
