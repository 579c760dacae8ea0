"""Processes that end with the test, and the settings of nodes in them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from support.folders import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

WAITS = re.compile(
    r"topic \S+ does not appear to be published yet; waiting for it\n|"
    r"Waiting for at least \d+ matching subscription\(s\) on \S+\.\.\.\n"
)
"""Notes that commands print on a busy machine while they wait."""
_SHORT_LEASE = "<Domain><Discovery><LeaseDuration>6s</LeaseDuration></Discovery></Domain>"
SHORT_LEASE = {"CYCLONEDDS_URI": f"<CycloneDDS>{_SHORT_LEASE}</CycloneDDS>"}
"""For processes that are killed: they are missed after 6 s, not 10."""
_SOON_MISSED = "<LeaseDuration>5s</LeaseDuration><SPDPInterval>1s</SPDPInterval>"
SOON_MISSED = "CYCLONEDDS_URI", f"<CycloneDDS><Domain><Discovery>{_SOON_MISSED}</Discovery></Domain></CycloneDDS>"
"""For contexts that Fast DDS shall miss when they are closed: after 5 s, not 10. Five announcements in that time are
enough where a machine is held up."""
_guards: set[asyncio.Task[None]] = set()


async def start_process(*command: str | Path, **options: Any) -> asyncio.subprocess.Process:
    """`asyncio.create_subprocess_exec`, but the process ends with the loop, also when the test fails.

    A subprocess transport collected after its loop closed prints a ResourceWarning.
    """
    process = await asyncio.create_subprocess_exec(*command, **options)

    async def guard() -> None:
        try:
            await process.wait()
        except asyncio.CancelledError:  # by `asyncio.run`, at its end
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.communicate()  # closes its pipes
            raise

    task = asyncio.ensure_future(guard())
    _guards.add(task)
    task.add_done_callback(_guards.discard)
    return process


@contextlib.contextmanager
def running_process(
    *command: str | Path, cwd: Path | None = None, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """Run a program with pipes for its input, output and errors; kill it at the end of the block."""
    pipe, changed = subprocess.PIPE, {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    process = subprocess.Popen(command, cwd=cwd, env=changed, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def python_process(
    program: str, *arguments: str, **environment: str
) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    """Run the text of a Python program as `running_process`."""
    return running_process(sys.executable, "-W", "default", "-c", program, *arguments, **environment)
