"""``rosidl-py run`` and python itself as processes."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

RUN = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run"]
PACKAGE_XML = "<package><name>{}</name></package>"
SETUP_CFG = "[develop]\nscript_dir=$base/lib/{0}\n[install]\ninstall_scripts=$base/lib/{0}\n"


def started(*command: str | Path, cwd: Path | None = None, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run a process to its end."""
    environment = {**os.environ, **settings}
    return subprocess.run([*map(str, command)], capture_output=True, text=True, cwd=cwd, env=environment, timeout=120)


def run(*arguments: str | Path, cwd: Path | None = None, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run ``rosidl-py run`` to its end."""
    return started(*RUN, *arguments, cwd=cwd, **settings)


def run_in_domain(command: Sequence[str | Path], domain: int, middleware: str) -> subprocess.CompletedProcess[str]:
    """A process that ended, in a domain of this machine, without other settings of ROS."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_"))}
    own = {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "RMW_IMPLEMENTATION": middleware}
    return subprocess.run([*map(str, command)], capture_output=True, text=True, env={**kept, **own}, timeout=200)


def output_lines(folder: Path, program: str, **settings: str) -> list[str]:
    """Return the output of a program's text, run in a folder by ``rosidl-py run``; the program must succeed."""
    (folder / "program.py").write_text(textwrap.dedent(program), encoding="utf-8")
    done = run("program.py", cwd=folder, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()
