"""One rosidl process for all tests of this folder."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest
from rosidl_oracle import NEEDED, PYTHON, Rosidl


@pytest.fixture(scope="session")
def rosidl() -> Iterator[Rosidl]:
    found = shutil.which(PYTHON) and subprocess.run([PYTHON, "-c", NEEDED], capture_output=True).returncode == 0
    if not found:
        reason = f"the oracle needs python3-rosidl and python3-empy (Debian) under {PYTHON}"
        if os.environ.get("ROSIDL_TEST_REQUIRE_PEERS") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    process = Rosidl()
    yield process
    process.close()
