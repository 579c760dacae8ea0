"""Peers on Zenoh: a handwritten one on Zenoh 1.7.2, and nodes of two other projects.

No package index has binaries of rmw_zenoh_cpp. `peers/raw.py` replaces it, with its configuration and formats, on an
older Zenoh.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING

import pytest
from support.environments import environment
from support.folders import ROOT
from support.local_network import domain_id, zenoh_router
from support.processes import start_process
from support.waiting import until
from support.worlds import World, world_on_zenoh

from rosidl_py_gen import type_hash

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator
    from contextlib import AbstractAsyncContextManager
    from pathlib import Path

from std_srvs.srv import SetBool  # of support.generated_packages

SCRIPTS = ROOT / "tests/peers/interop_zenoh/peers"
REQUIREMENTS = {
    "raw": ["eclipse-zenoh==1.7.2", "xxhash==4.1.0"],
    "sdk": ["zenoh-ros2-sdk==0.1.8", "eclipse-zenoh==1.10.2"],
    "zeros": ["pyzeros==0.1.0", "eclipse-zenoh==1.10.2"],
}


class Peer:
    """Running peer; `lines` are those that it printed."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.lines: list[str] = []
        self._reading = asyncio.ensure_future(self._read())

    async def _read(self) -> None:
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.lines.append(line.decode().rstrip("\n"))

    def printed(self, start: str) -> list[str]:
        """Return the rest of each line that begins with `start`."""
        return [line.removeprefix(start).strip() for line in self.lines if line.startswith(start)]

    async def wait_for(self, start: str, count: int = 1) -> list[str]:
        """Wait for `count` lines that begin with `start`, and return them as `printed` does."""
        try:
            await until(lambda: len(self.printed(start)) >= count, 15)
        except AssertionError:
            raise AssertionError(f"the peer printed {self.lines[-20:]}, not {start!r}") from None
        return self.printed(start)

    def tell(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n".encode())


@pytest.fixture(scope="session")
def pythons() -> dict[str, Path]:
    """Python interpreter of each peer."""
    made = {name: environment(f"zenoh-{name}", requirements) for name, requirements in REQUIREMENTS.items()}
    # At its first use pyzeros compiles the attachment with Cython for half a minute; the result is cached.
    warm = "from pyzeros.builtin_msgs import Attachment; Attachment().serialize()"
    subprocess.run([made["zeros"], "-c", warm], env={**os.environ, **compiled(made["zeros"])}, check=True)
    return made


def compiled(python: Path) -> dict[str, str]:
    """Return the variable with the compilation cache of pyzeros."""
    return {"CYDR_CACHE_DIR": str(python.parent.parent / "cydr")}


@pytest.fixture
def running(pythons: dict[str, Path]) -> Callable[..., AbstractAsyncContextManager[Peer]]:
    """Function that runs a peer by name until the end of the block."""

    @asynccontextmanager
    async def running(name: str, *arguments: str) -> AsyncIterator[Peer]:
        clean = {key: value for key, value in os.environ.items() if not key.startswith(("ZENOH", "ROS_", "PYTHON"))}
        process = await start_process(
            *(str(pythons[name]), "-u", str(SCRIPTS / f"{name}.py")),
            *(zenoh_router(), str(domain_id()), type_hash(SetBool), *arguments),
            env={**clean, "ROS_DOMAIN_ID": str(domain_id()), **compiled(pythons[name])},
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
        )
        peer = Peer(process)
        await peer.wait_for("ready")
        try:
            yield peer
        finally:
            assert process.stdin is not None
            process.stdin.close()  # which ends the peer
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(process.wait(), 5)

    return running


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    """World on Zenoh whose sessions and the peers use the router of this test process."""
    yield from world_on_zenoh(monkeypatch)
