"""The rclpy code of docs/start/from-rclpy.md runs with a real rclpy, with the output on the page."""

from __future__ import annotations

import os
import subprocess
from typing import TYPE_CHECKING

from support.markdown_pages import ROOT, blocks
from support.node_fixtures import second_domain_id

if TYPE_CHECKING:
    from pathlib import Path

PAGE = ROOT / "docs" / "start" / "from-rclpy.md"
AFTER = """
import signal

spin = rclpy.spin


def interrupted_spin(node):
    # In the main thread: from another one, rclpy may find its context shut down before Python raises KeyboardInterrupt.
    node.create_timer(0.1, lambda: signal.raise_signal(signal.SIGINT))
    spin(node)


rclpy.shutdown()
rclpy.spin = interrupted_spin
main()
print("ended at Ctrl-C")
"""
PRINTED = "done with one\nended at Ctrl-C\n"


def test_the_rclpy_code_for_its_users_runs(peer_python: Path, tmp_path: Path) -> None:
    code = [block.text for block in blocks(PAGE) if block.title == "rclpy"]
    script = tmp_path / "page.py"
    script.write_text("".join([*code, AFTER]))
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith(("AMENT", "PYTHON"))},
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_DOMAIN_ID": str(second_domain_id()),  # nobody else is there
    }
    done = subprocess.run([peer_python, script], env=environment, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == (PRINTED, 0), done.stderr
