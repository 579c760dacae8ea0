"""The recorded names of rclpy are those of the rclpy of the peers."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from support.record_rclpy_names import RECORD, record


@pytest.mark.only_with("jazzy")
@pytest.mark.real_time("another process answers")
def test_the_record_is_that_of_this_rclpy(peer_python: Path) -> None:
    ask = "import sys; print(*sys.version_info[:2], sep='.')"
    version = subprocess.run([str(peer_python), "-c", ask], capture_output=True, text=True, check=True).stdout.strip()
    if version != "3.11":
        pytest.skip(f"signatures of the standard library differ; recorded with 3.11, and this is {version}")
    assert json.loads(record(peer_python)) == json.loads(RECORD.read_text(encoding="utf-8"))


def test_programs_find_what_they_use_in_the_record() -> None:
    modules = json.loads(RECORD.read_text(encoding="utf-8"))
    node = modules["rclpy.node"]["Node"]["members"]
    assert node["create_timer"]["parameters"] == (
        "self, timer_period_sec, callback, callback_group=None, clock=None, autostart=True"
    )
    assert node["default_callback_group"] == {"kind": "property"}
    assert modules["rclpy"]["Parameter"] == {"kind": "class", "from": "rclpy.parameter"}
    assert modules["rclpy.node"]["HIDDEN_NODE_PREFIX"] == {"kind": "constant", "value": "_"}
    assert modules["rclpy.qos"]["ReliabilityPolicy"]["members"]["BEST_EFFORT"] == {"kind": "constant", "value": 2}
    assert modules["rclpy"]["spin_once"]["parameters"] == "node, *, executor=None, timeout_sec=None"
    assert modules["rclpy"]["SignalHandlerOptions"]["members"]["ALL"] == {"kind": "constant", "value": 3}
    assert len(modules) == 61 and sum(map(len, modules.values())) > 750
