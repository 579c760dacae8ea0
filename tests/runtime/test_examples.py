"""The examples as a user runs them: two processes, Ctrl-C at the end, no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

EXAMPLES = Path(__file__).parents[2] / "examples"
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def no_survivors() -> Iterator[None]:
    """Kill what a failed test left running, so that it cannot disturb the next one."""
    yield
    while _started:
        process = _started.pop()
        if process.poll() is None:
            process.kill()
            process.communicate()


_started: list[subprocess.Popen[str]] = []


def start(name: str, *arguments: str) -> subprocess.Popen[str]:
    """Run an example; what this test process may import, it may import too."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    command = [sys.executable, "-W", "default", str(EXAMPLES / name), *arguments]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    _started.append(process)
    return process


def stop(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> None:
    """Press Ctrl-C and expect a clean end within two seconds."""
    process.send_signal(number)
    _, errors = process.communicate(timeout=2)
    assert errors == ""
    assert process.returncode == 0


@pytest.mark.parametrize("listener", ["listener.py", "listener_callbacks.py"])
@pytest.mark.parametrize("talker", ["talker.py", "talker_callbacks.py"])
def test_talker_and_listener(talker: str, listener: str) -> None:
    hearing, talking = start(listener), start(talker)
    assert hearing.stdout is not None
    heard = [hearing.stdout.readline() for _ in range(2)]
    assert all(line.startswith("I heard: Hello World: ") for line in heard)
    stop(hearing)
    stop(talking, signal.SIGTERM)


@pytest.mark.parametrize("service", ["service.py", "service_callbacks.py"])
def test_service_and_client(service: str) -> None:
    serving = start(service)
    output, errors = start("client.py", "40").communicate(timeout=20)
    assert (output.splitlines(), errors) == (["40 + 1 = 41", "40 + 2 = 42", "40 + 3 = 43"], "")
    assert start("client_sync.py").communicate(timeout=20) == ("40 + 2 = 42\n", "")
    stop(serving)


def test_ctrl_c_ends_asyncio_run_at_once_although_the_loop_waits_in_dds() -> None:
    program = (
        "import asyncio\nfrom rosidl_py_gen.runtime import Node\n"
        "async def main():\n    async with Node('n') as node:\n        print('up', flush=True)\n"
        "        await asyncio.Event().wait()\n"
        "try:\n    asyncio.run(main())\nexcept KeyboardInterrupt:\n    print('interrupted')\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "up\n"
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=2)
    assert (output, errors) == ("interrupted\n", "")
