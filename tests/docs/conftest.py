"""Pages run in processes of their own, on loopback, in a DDS domain that no other test uses."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from doc_pages import ROOT

from rosidl_py_gen.generate import generate
from rosidl_py_gen.resources import interfaces_dir
from rosidl_py_gen.spec.find import search_path

if TYPE_CHECKING:
    from collections.abc import Callable

PACKAGES = ["std_msgs", "std_srvs", "example_interfaces", "geometry_msgs", "sensor_msgs"]


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the message packages that pages use."""
    folder = tmp_path_factory.mktemp("packages")
    generate(search_path([interfaces_dir()], ament="", bundled=False), PACKAGES, folder)
    return folder


@pytest.fixture
def run_page(packages: Path, tmp_path: Path) -> Callable[[Path], subprocess.CompletedProcess[str]]:
    """Run a page's code in an empty folder, which is also its home."""

    def run(page: Path) -> subprocess.CompletedProcess[str]:
        kept = {
            name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "CYCLONEDDS", "AMENT"))
        }
        environment = {
            **kept,
            "HOME": str(tmp_path),
            "PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests", "generated", packages))),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(30 + os.getpid() % 20),
        }
        command = [
            sys.executable,
            "-W",
            "error::ResourceWarning",
            str(Path(__file__).with_name("run_page.py")),
            str(page),
        ]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)

    return run
