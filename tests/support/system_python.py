"""Libraries of ROS that Debian packages for the system's Python: a script beside the test is asked in lines of JSON."""

from __future__ import annotations

import json
import os
import subprocess
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PYTHON = "/usr/bin/python3"


class Oracle:
    """Running script."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def ask(self, request: Any) -> Any:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


@contextmanager
def running(script: Path, modules: str, package: str) -> Iterator[Oracle]:
    """A script that imports `modules`, of a package of Debian; without that the test is skipped, or fails in CI."""
    if subprocess.run([PYTHON, "-c", f"import {modules}"], capture_output=True, check=False).returncode:
        message = f"needs {package} for the system's Python: apt-get install {package}"
        if os.environ.get("ROSIDL_TEST_REQUIRE_PEERS"):
            pytest.fail(message)
        pytest.skip(message)
    process = subprocess.Popen(
        [PYTHON, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        yield Oracle(process)
    finally:
        process.kill()
        process.communicate()
