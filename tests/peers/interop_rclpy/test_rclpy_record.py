"""The recorded names of rclpy agree with the rclpy of the peers."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from record_rclpy_names import RECORD, record


@pytest.mark.only_with("jazzy")
@pytest.mark.real_time("another process answers")
def test_recorded_rclpy_names_match_peer(peer_python: Path) -> None:
    program = "import sys; print(*sys.version_info[:2], sep='.')"
    version = subprocess.run(
        [str(peer_python), "-c", program], capture_output=True, text=True, check=True
    ).stdout.strip()
    if version != "3.11":
        pytest.skip(f"signatures of the standard library differ; recorded with 3.11, and this is {version}")
    assert json.loads(record(peer_python)) == json.loads(RECORD.read_text(encoding="utf-8"))
