"""The rclpy code of docs/migration.md runs with a real rclpy, with the output on the page."""

from __future__ import annotations

import os
import subprocess
from typing import TYPE_CHECKING

import pytest
from support.markdown_pages import ROOT, blocks
from support.node_fixtures import second_domain_id

if TYPE_CHECKING:
    from pathlib import Path

PAGE = ROOT / "docs" / "migration.md"
# There are no wheels of example_interfaces; this action is the same in test_msgs.
BEFORE = """
import sys
import types

import test_msgs.action

sys.modules["example_interfaces"] = types.ModuleType("example_interfaces")
sys.modules["example_interfaces.action"] = test_msgs.action
"""
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
PRINTED = """\
hello
tick
was asked for True
array('i', [0, 1, 1])
array('i', [0, 1, 1, 2])
4 array('i', [0, 1, 1, 2])
set
too fast
Parameter max_speed out of range Min: 0.0, Max: 2.5, value: 9.0
True True
done with one
[1.0, 2.5] 0
1.5
['std_msgs/msg/String']
1
[('mine', '/')]
RELIABLE
TransitionCallbackReturnType.SUCCESS
ended at Ctrl-C
"""


@pytest.mark.only_with("jazzy")  # the peers of Kilted have no geometry_msgs
def test_the_rclpy_code_of_the_migration_page_runs(peer_python: Path, tmp_path: Path) -> None:
    code = [block.text for block in blocks(PAGE) if block.title == "rclpy"]
    script = tmp_path / "page.py"
    script.write_text("".join([BEFORE, *code, AFTER]))
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith(("AMENT", "PYTHON"))},
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_DOMAIN_ID": str(second_domain_id()),  # nobody else is there
    }
    done = subprocess.run([peer_python, script], env=environment, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == (PRINTED, 0), done.stderr
