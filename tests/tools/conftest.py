"""Commands as users run them: processes beside the test's own nodes, on loopback in this test process's domain."""

from __future__ import annotations

import asyncio
import os
import sys
from dataclasses import dataclass

import pytest
from worlds import GENERATED, dds, memory, only_loopback, pytest_pyfunc_call

__all__ = ["dds", "memory", "only_loopback", "pytest_pyfunc_call"]

PATIENCE_S = 20


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str


class Tool:
    """Runs ``rosidl-py`` in processes of their own."""

    async def start(self, *arguments: str, **environment: str) -> asyncio.subprocess.Process:
        """Begin a command; the test ends it."""
        return await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "rosidl_py_gen.tools", *arguments),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": GENERATED.name, **environment},
            limit=1 << 24,
        )

    async def __call__(self, *arguments: str, stdin: str = "", **environment: str) -> Ended:
        """Run a command to its end."""
        return await self.end(await self.start(*arguments, **environment), stdin)

    async def end(self, process: asyncio.subprocess.Process, stdin: str = "") -> Ended:
        """What a command that was begun said until its end; it is killed when that takes too long."""
        try:
            out, err = await asyncio.wait_for(process.communicate(stdin.encode()), PATIENCE_S)
        except asyncio.TimeoutError:
            process.kill()
            raise
        assert process.returncode is not None
        return Ended(process.returncode, out.decode(), err.decode())


@pytest.fixture
def tool() -> Tool:
    """See `Tool`."""
    return Tool()
