"""Where peers are required, examples are the same every time, but for those of a seed, which gives the same again."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parent
PROPERTY = """\
from hypothesis import given
from hypothesis import strategies as st


@given(st.integers())
def test_any(number):
    print("tried", number)
"""


def tried(folder: Path, *arguments: str, seed: str = "") -> list[str]:
    command = [sys.executable, "-m", "pytest", "-s", "-p", "_hypothesis_pytestplugin", *arguments, "test_property.py"]
    without = {"PYTEST_ADDOPTS": "", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}  # others take a second to load
    environment = {**os.environ, "ROSIDL_TEST_REQUIRE_PEERS": "1", "ROSIDL_TEST_SEED": seed, **without}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return re.findall(r"tried (-?\d+)", done.stdout)


def test_a_seed_gives_new_examples_that_can_be_had_again(tmp_path: Path) -> None:
    shutil.copy(TESTS / "conftest.py", tmp_path)
    shutil.copytree(TESTS / "support", tmp_path / "support")
    (tmp_path / "test_property.py").write_text(PROPERTY)
    usual, seeded = tried(tmp_path), tried(tmp_path, "-m", "hypothesis", "--hypothesis-seed=5")
    assert len(usual) > 50 and usual == tried(tmp_path)
    assert len(seeded) > 50 and seeded == tried(tmp_path, "--hypothesis-seed=5")
    assert seeded == tried(tmp_path, seed="5") != tried(tmp_path, seed="6")
    assert seeded != usual != tried(tmp_path, "--hypothesis-seed=6") != seeded
