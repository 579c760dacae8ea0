"""rosidl-py-gen that is not told what to generate shows its help; 25 folders in the current one are for who asks."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


def command(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rosidl_py_gen.generator_cli", *arguments],
        cwd=cwd,
        env={**os.environ, "AMENT_PREFIX_PATH": "", "IDL_PACKAGE_FILTER": "", **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("arguments", [(), ("--json",), ("--keep-going",)])
def test_nothing_wanted_is_answered_with_the_help(arguments: tuple[str, ...], tmp_path: Path) -> None:
    found = command(*arguments, cwd=tmp_path)
    assert (found.returncode, found.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert found.stderr == command("--help", cwd=tmp_path).stdout
    assert "--out . generates all packages" in " ".join(found.stderr.split())


@pytest.mark.parametrize("arguments", [("--out", "."), ("--filter", "")])
def test_everything_is_generated_for_who_says_so(arguments: tuple[str, ...], tmp_path: Path) -> None:
    assert command(*arguments, cwd=tmp_path).returncode == 0
    assert len([path for path in tmp_path.iterdir() if path.is_dir()]) == 25


def test_a_filter_in_the_environment_says_what_is_wanted(tmp_path: Path) -> None:
    assert command(cwd=tmp_path, IDL_PACKAGE_FILTER="builtin_interfaces").returncode == 0
    assert [path.name for path in tmp_path.iterdir()] == ["builtin_interfaces"]


def test_a_path_says_what_is_wanted(tmp_path: Path) -> None:
    folder = tmp_path / "a_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "A.msg").write_text("")
    (tmp_path / "here").mkdir()
    assert command("--path", "..", cwd=tmp_path / "here").returncode == 0
    assert (tmp_path / "here/a_msgs/msg/_a.py").exists()


def test_options_that_write_nothing_need_no_more(tmp_path: Path) -> None:
    listed = command("--list", cwd=tmp_path)
    assert (listed.returncode, len(listed.stdout.splitlines())) == (0, 25)
    assert len(json.loads(command("--list", "--json", cwd=tmp_path).stdout)) == 25
    checked = command("--check", cwd=tmp_path)
    assert (checked.returncode, "files would be written" in checked.stdout) == (1, True)
    assert list(tmp_path.iterdir()) == []
