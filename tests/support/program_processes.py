"""``rosidl-py run`` and python itself as processes."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

RUN = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run"]
PACKAGE_XML = "<package><name>{}</name></package>"


def started(*command: str | Path, cwd: Path | None = None, **settings: str) -> subprocess.CompletedProcess[str]:
    """A process that ended."""
    environment = {**os.environ, **settings}
    return subprocess.run([*map(str, command)], capture_output=True, text=True, cwd=cwd, env=environment, timeout=120)


def run(*arguments: str | Path, cwd: Path | None = None, **settings: str) -> subprocess.CompletedProcess[str]:
    """A ``rosidl-py run`` that ended."""
    return started(*RUN, *arguments, cwd=cwd, **settings)


def output_lines(folder: Path, program: str, **settings: str) -> list[str]:
    """Return the output of a program's text, run in a folder by ``rosidl-py run``; the program must succeed."""
    (folder / "program.py").write_text(textwrap.dedent(program), encoding="utf-8")
    done = run("program.py", cwd=folder, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()
