"""Arguments that would take memory without limit are refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.program_processes import run

DURATION = """
import resource
from rclpy.duration import Duration

before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for text in ("1", b"1"):  # `seconds * 10**9` would repeat it
    try:
        Duration(seconds=text)
    except ValueError as error:
        print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024 < 100)
"""
PARAMETERS = """
import sys
from rclpy.parameter import parameter_dict_from_yaml_file

try:
    print(sorted(parameter_dict_from_yaml_file(sys.argv[1])))
except RuntimeError as error:
    print(error)
"""
LAUGHS = "".join(f"x{n}: &x{n} [{', '.join([f'*x{n - 1}'] * 9 if n else ['ha'] * 9)}]\n" for n in range(9))


def test_a_text_is_no_duration(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(DURATION)
    done = run("program.py", cwd=tmp_path)
    expected = ["seconds: expected a number, got '1'", "seconds: expected a number, got b'1'", "True"]
    assert (done.stdout.splitlines(), done.stderr) == (expected, "")


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ("a: &a [1, 2]\nb: *a\n", "['a', 'b']"),
        (LAUGHS, "more than 1000000 values, aliases written out"),
        ("a: &a\n  b: *a\n", "more than 1000000 values, aliases written out"),
    ],
    ids=["few", "many", "endless"],
)
def test_aliases_in_parameter_files_are_expanded_up_to_a_limit(parameters: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PARAMETERS)
    indented = "".join(f"    {line}\n" for line in parameters.splitlines())
    (tmp_path / "file.yaml").write_text(f"n:\n  ros__parameters:\n{indented}")
    done = run("program.py", "file.yaml", cwd=tmp_path)
    assert expected in done.stdout, done.stderr
