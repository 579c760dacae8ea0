"""Parameter files that are small on the disk and endless when their aliases are written out."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from rclpy.parameter import parameter_dict_from_yaml_file

try:
    print(sorted(parameter_dict_from_yaml_file(sys.argv[1])))
except RuntimeError as error:
    print(error)
"""
LAUGHS = "".join(f"x{n}: &x{n} [{', '.join([f'*x{n - 1}'] * 9 if n else ['ha'] * 9)}]\n" for n in range(9))


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ("a: &a [1, 2]\nb: *a\n", "['a', 'b']"),
        (LAUGHS, "more than 1000000 values, aliases written out"),
        ("a: &a\n  b: *a\n", "more than 1000000 values, aliases written out"),
    ],
    ids=["few", "many", "endless"],
)
def test_aliases_are_written_out_up_to_a_limit(parameters: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    indented = "".join(f"    {line}\n" for line in parameters.splitlines())
    (tmp_path / "file.yaml").write_text(f"n:\n  ros__parameters:\n{indented}")
    done = subprocess.run(
        [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "program.py", "file.yaml"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
        check=False,
    )
    assert expected in done.stdout, done.stderr
