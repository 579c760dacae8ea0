"""The hooks for pre-commit."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.interface_packages import REPOSITORY, write

from rosidl_py_gen.generator_cli import main

HOOKS = {one["id"]: one for one in yaml.safe_load((REPOSITORY / ".pre-commit-hooks.yaml").read_text())}
MANIFEST = """<package><name>team_msgs</name><version>1.0.0</version><description>d</description>
<maintainer email="a@b.c">a</maintainer><license>MIT</license></package>"""
FILES = {"src/team_msgs/package.xml": MANIFEST, "src/team_msgs/msg/Wheel.msg": "float64 speed\n"}


def run(hook: str) -> int:
    """Run the command of a hook in this process."""
    program, *words = [*HOOKS[hook]["entry"].split(), *HOOKS[hook]["args"]]
    assert program == "rosidl-py-gen"
    try:
        main(words)
    except SystemExit as end:
        assert isinstance(end.code, int)
        return end.code
    return 0


def git(*words: str) -> None:
    subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *words], check=True, capture_output=True)


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(write(tmp_path / "team", FILES))
    git("init", "-q")
    return Path.cwd()


def test_hooks_file_declares_language_and_matching_files() -> None:
    assert [*HOOKS] == ["rosidl-py-gen-check", "rosidl-py-gen-diff"]
    for hook in HOOKS.values():
        assert hook["language"] == "python" and hook["pass_filenames"] is False
        wanted = re.compile(hook["files"])
        assert all(map(wanted.search, (*FILES, "a/srv/B.srv", "x.idl", "CMakeLists.txt", "action/Go.action")))
        assert not any(map(wanted.search, ("a.py", "README.md", "msg", "msg.txt", "mypackage.xml")))


def test_hooks_pass_before_first_commit_and_fail_for_breaking_changes(repository: Path, capsys: Any) -> None:
    assert [run(one) for one in HOOKS] == [0, 0]
    assert "there is no commit yet: all definitions are new" in capsys.readouterr().err
    git("add", "-A")
    git("commit", "-q", "-m", "one")
    file = repository / "src/team_msgs/msg/Wheel.msg"
    file.write_text("float64 speed  # words\n")
    assert [run(one) for one in HOOKS] == [0, 0]
    file.write_text("float64 speed\nint8 more\n")
    assert [run(one) for one in HOOKS] == [0, 1]
    file.write_text("flaot64 speed\n")
    assert [run(one) for one in HOOKS] == [1, 1]
