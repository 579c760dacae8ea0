"""Fixture that does what a page shows, on loopback, in the DDS domain of this test process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.folders import ROOT
from support.generated_packages import GENERATED
from support.local_network import domain_id

if TYPE_CHECKING:
    from collections.abc import Callable

_PROGRAMS = {
    "python": "",
    "rosidl-py": "-m rosidl_py_gen.ros_cli",
    "rosidl-py-gen": "-m rosidl_py_gen.generator_cli",
}


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the commands of the checkout, as programs."""
    folder = tmp_path_factory.mktemp("programs")
    for name, arguments in _PROGRAMS.items():
        (folder / name).write_text(
            f'#!/bin/sh\nPYTHONPATH="{ROOT}:$PYTHONPATH" exec {sys.executable} {arguments} "$@"\n'
        )
        (folder / name).chmod(0o755)
    return folder


@pytest.fixture
def run_page(tmp_path: Path, programs: Path) -> Callable[[Path], subprocess.CompletedProcess[str]]:
    """Do what a page shows in an empty folder, which is also its home, with a link to the examples of the checkout."""

    def run(page: Path) -> subprocess.CompletedProcess[str]:
        folder = tmp_path / "home"
        folder.mkdir()
        (folder / "examples").symlink_to(ROOT / "examples")
        ros_prefixes = ("ROS_", "CYCLONEDDS", "AMENT")
        inherited = {name: value for name, value in os.environ.items() if not name.startswith(ros_prefixes)}
        paths = [str(ROOT), str(folder / "installed"), GENERATED.name]
        environment = {
            **inherited,
            "HOME": str(folder),
            **{f"GIT_{who}_{what}": "reader" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")},
            "PATH": os.pathsep.join([str(programs), inherited["PATH"]]),
            "PYTHONPATH": os.pathsep.join(paths),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(domain_id()),
        }
        command = [sys.executable, str(Path(__file__).with_name("run_page.py")), str(page)]
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=240)

    return run
