"""Fixtures that run commands of ``rosidl-py``, in this process or in others, next to the nodes of a test."""

from __future__ import annotations

import asyncio
import io
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rosidl_py_gen import ros_cli
from support import in_process_commands
from support.generated_packages import GENERATED
from support.local_network import second_domain_id
from support.processes import WAITS, start_process

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.worlds import World


COMMAND_TIMEOUT_S = 60


@dataclass(frozen=True)
class Ended:
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


class Tool:
    """Runs ``rosidl-py``: in processes of their own, or on the test's event loop beside a `world` in memory."""

    def __init__(self, world: World | None, patch: pytest.MonkeyPatch) -> None:
        self._world, self._patch = world, patch

    async def start(self, *arguments: str, within: tuple[str, ...] = (), stdin: str = "", **environment: str) -> Any:
        """Begin a command; the test ends it, or its failure does. `within` is a command that takes it as its last
        arguments.
        """
        if self._world is not None:
            assert not within
            for name, value in environment.items():
                self._patch.setenv(name, value)
            return in_process_commands.start(self._world, self._patch, arguments, stdin)
        return await start_process(
            *(*within, sys.executable, "-m", "rosidl_py_gen.ros_cli", *arguments),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": GENERATED.name, **environment},
            limit=1 << 24,
        )

    async def __call__(self, *arguments: str, stdin: str = "", **environment: str) -> Ended:
        """Run a command and return its exit code and output."""
        return await self.end(await self.start(*arguments, stdin=stdin, **environment), stdin)

    async def interrupt(self, process: Any, number: int = signal.SIGINT) -> Ended:
        process.send_signal(number)
        return await self.end(process)

    async def end(self, process: Any, stdin: str = "") -> Ended:
        try:
            out, err = await asyncio.wait_for(process.communicate(stdin.encode()), COMMAND_TIMEOUT_S)
        except asyncio.TimeoutError:
            process.kill()
            raise
        assert process.returncode is not None
        errors = err.decode() if self._world is not None else WAITS.sub("", err.decode())  # in memory time is virtual
        return Ended(process.returncode, out.decode(), errors)


@pytest.fixture
def tool(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Tool:
    return Tool(request.getfixturevalue("memory") if "memory" in request.fixturenames else None, monkeypatch)


@pytest.fixture(scope="module")
def topic_peer() -> Iterator[tuple[str, str]]:
    """Run `topic_peer.py` alone in a domain; yields the options that select this domain."""
    domain = str(second_domain_id())
    environment = {"ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "PYTHONPATH": GENERATED.name}
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("topic_peer.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **environment},
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        yield "--domain", domain


@pytest.fixture
def run_here(capsys: Any, monkeypatch: Any, only_loopback: None) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs a command in this process and returns exit code, output and errors."""

    def run(*arguments: str, stdin: str = "") -> tuple[int, str, str]:
        with tempfile.TemporaryFile() as file, monkeypatch.context() as patched:
            file.write(stdin.encode(errors="surrogateescape"))
            file.seek(0)
            patched.setattr(sys, "stdin", io.TextIOWrapper(file))
            code: object = 0
            try:
                ros_cli.main([*arguments])
            except SystemExit as end:
                code = end.code
        assert isinstance(code, int)
        return (code, *capsys.readouterr())

    return run
