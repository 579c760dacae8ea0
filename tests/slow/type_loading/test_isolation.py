"""Tests see no message packages of their environment (`tests/support/without_message_packages.py`)."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
from support.without_message_packages import environment_without, installed_files

from rosidl_py_gen.base.resources import InstalledInterfaces
from rosidl_py_gen.wheels.environment import installed_packages

SEEN = """
import importlib.metadata, importlib.util, sys
names = ("process_fake_msgs", "fake_tool")
print([name for name in names if importlib.util.find_spec(name)], end=" ")
print([entry.name for entry in importlib.metadata.entry_points(group=sys.argv[1])])
"""


def test_no_message_package_of_this_environment_is_visible() -> None:
    assert installed_packages() == {}


def test_an_environment_without_message_packages_has_everything_else_in_each_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROSIDL_TEST_CACHE", str(tmp_path / "cache"))
    venv.EnvBuilder(symlinks=sys.platform != "win32").create(tmp_path / "env")
    site = Path(sysconfig.get_path("purelib", vars={"base": str(tmp_path / "env")}))
    for name, group in (("process_fake_msgs", InstalledInterfaces.ENTRY_POINTS), ("fake_tool", "other.group")):
        (site / name).mkdir()
        (site / name / "__init__.py").touch()
        info = site / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {name}\n")
        (info / "RECORD").write_text(f"{name}/__init__.py,,\n{name}-1.0.dist-info/METADATA,,\n../../../bin/{name},,\n")
    monkeypatch.syspath_prepend(str(site))
    hidden = installed_files(site)
    assert hidden == {"process_fake_msgs", "process_fake_msgs-1.0.dist-info"}
    python = environment_without(tmp_path / "env", hidden)
    assert python == environment_without(tmp_path / "env", hidden), "it is made once"

    def seen(program: Path) -> str:
        return subprocess.run(
            [program, "-c", SEEN, InstalledInterfaces.ENTRY_POINTS], capture_output=True, text=True, check=True
        ).stdout

    (original,) = [path for path in (tmp_path / "env/bin/python", tmp_path / "env/Scripts/python.exe") if path.exists()]
    assert seen(original) == "['process_fake_msgs', 'fake_tool'] ['process_fake_msgs']\n"
    assert seen(python) == "['fake_tool'] []\n"
