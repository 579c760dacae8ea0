"""Fixtures that run pages in processes, on loopback, in the DDS domain of this test process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.folders import ROOT
from support.generated_packages import GENERATED
from support.local_network import domain_id

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture
def run_page(tmp_path: Path) -> Callable[[Path], subprocess.CompletedProcess[str]]:
    """Run a page's code in an empty folder, which is also its home."""

    def run(page: Path, transport: str = "") -> subprocess.CompletedProcess[str]:
        ros_prefixes = ("ROS_", "CYCLONEDDS", "AMENT")
        inherited = {name: value for name, value in os.environ.items() if not name.startswith(ros_prefixes)}
        environment = {
            **inherited,
            "HOME": str(tmp_path),
            "PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests", "generated", GENERATED.name))),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(domain_id()),
            "PAGE_TRANSPORT": transport,
        }
        command = [sys.executable, str(Path(__file__).with_name("run_page.py")), str(page)]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)

    return run
