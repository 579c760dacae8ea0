"""A text as number of seconds is refused; `seconds * 10**9` would repeat it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PROGRAM = """
import resource
from rclpy.duration import Duration

before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for text in ("1", b"1"):
    try:
        Duration(seconds=text)
    except ValueError as error:
        print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024 < 100)
"""


def test_a_text_is_refused_and_not_repeated(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "program.py"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=tmp_path, check=False)
    expected = ["seconds: expected a number, got '1'", "seconds: expected a number, got b'1'", "True"]
    assert (done.stdout.splitlines(), done.stderr) == (expected, "")
