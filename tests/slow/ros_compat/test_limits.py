"""Arguments that would take memory without limit are refused."""

from __future__ import annotations

from pathlib import Path

from support.interface_packages import write
from support.program_processes import output_lines

PROGRAM = """
import resource
from rclpy.duration import Duration
from rclpy.parameter import parameter_dict_from_yaml_file

before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for text in ("1", b"1"):  # `seconds * 10**9` would repeat it
    try:
        Duration(seconds=text)
    except ValueError as error:
        print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024 < 100)
for name in ("few", "many", "endless"):
    try:
        print(sorted(parameter_dict_from_yaml_file(f"{name}.yaml")))
    except RuntimeError as error:
        print(str(error).rpartition(": ")[2])
"""
LAUGHS = "".join(f"    x{n}: &x{n} [{', '.join([f'*x{n - 1}'] * 9 if n else ['ha'] * 9)}]\n" for n in range(9))
ALIASES = {"few": "    a: &a [1, 2]\n    b: *a\n", "many": LAUGHS, "endless": "    a: &a\n      b: *a\n"}


def test_string_durations_and_recursive_yaml_aliases_are_refused(tmp_path: Path) -> None:
    write(tmp_path, {f"{name}.yaml": f"n:\n  ros__parameters:\n{text}" for name, text in ALIASES.items()})
    assert output_lines(tmp_path, PROGRAM) == [
        "seconds: expected a number, got '1'",
        "seconds: expected a number, got b'1'",
        "True",
        "['a', 'b']",
        *["more than 1000000 values, aliases written out"] * 2,
    ]
