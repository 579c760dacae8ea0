"""The reference compilers, started once for all tests of this folder."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.rosidl_oracle import Rosidl


@pytest.fixture(scope="session")
def rosidl() -> Iterator[Rosidl]:
    processes = Rosidl()
    yield processes
    processes.close()
