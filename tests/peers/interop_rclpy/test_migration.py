"""The rclpy code of docs/start/from-rclpy.md runs with a real rclpy, and prints what the page shows."""

from __future__ import annotations

import os
import re
import subprocess
from typing import TYPE_CHECKING

import pytest
from support.folders import ROOT
from support.local_network import second_domain_id
from support.markdown_pages import blocks

if TYPE_CHECKING:
    from pathlib import Path

PAGE = ROOT / "docs" / "start" / "from-rclpy.md"


@pytest.mark.about_dds("Zenoh may log to the standard output")
def test_rclpy_code_of_migration_page_runs_under_real_rclpy(peer_python: Path, tmp_path: Path) -> None:
    (code,) = (block.text for block in blocks(PAGE) if block.title == "counter.py")
    script = tmp_path / "counter.py"
    script.write_text(code)
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith(("AMENT", "PYTHON"))},
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_DOMAIN_ID": str(second_domain_id()),  # nobody else is there
    }
    done = subprocess.run([peer_python, script], env=environment, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("", 0), done.stderr
    assert re.fullmatch(r"\[INFO\] \[[\d.]+\] \[counter\]: counted to 3\n", done.stderr)
