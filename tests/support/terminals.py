"""Commands on a pseudo-terminal: standard output, standard error, or both are the terminal."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import re
import struct
import sys
import termios
from contextlib import suppress
from dataclasses import dataclass

from support.generated_packages import GENERATED

CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
_DEADLINE_S = 60


@dataclass(frozen=True)
class OnTerminal:
    """Exit code, what the terminal got without its control sequences, and what the pipe next to it got."""

    code: int
    screen: str
    piped: str
    raw: str

    @property
    def lines(self) -> list[str]:
        return [line.rstrip() for line in self.screen.splitlines()]


async def on_terminal(
    *arguments: str, columns: int = 80, stdout: bool = True, stderr: bool = True, setup: str = "", **environment: str
) -> OnTerminal:
    """Run ``rosidl-py`` with a terminal of a width; streams that are not the terminal are a pipe.

    `setup` is Python code that runs before the command.
    """
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    variables = {**os.environ, "PYTHONPATH": GENERATED.name, "TERM": "xterm", **environment}
    for name in ("NO_COLOR", "COLUMNS", "FORCE_COLOR", "TTY_COMPATIBLE"):
        variables.pop(name, None)
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", f"{setup}\nfrom rosidl_py_gen.ros_cli import main\nmain()", *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=theirs if stdout else asyncio.subprocess.PIPE,
        stderr=theirs if stderr else asyncio.subprocess.PIPE,
        env=variables,
    )
    os.close(theirs)
    reading = asyncio.to_thread(_read_all, ours)
    try:
        raw, (out, err) = await asyncio.wait_for(asyncio.gather(reading, process.communicate()), _DEADLINE_S)
    finally:
        if process.returncode is None:
            process.kill()
        os.close(ours)
    assert process.returncode is not None
    piped = ((out or b"") + (err or b"")).decode()
    return OnTerminal(process.returncode, CONTROL.sub("", raw).replace("\r\n", "\n"), piped, raw)


def _read_all(descriptor: int) -> str:
    data = b""
    with suppress(OSError):  # how Linux ends a terminal
        while piece := os.read(descriptor, 1 << 16):
            data += piece
    return data.decode(errors="replace")
