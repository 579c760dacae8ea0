"""Peer processes with rclpy, which execute commands in lines of JSON, any number at a time.

Peers run the scripts in `peers` with a Python that has rclpy. Shared memory of Fast DDS that a killed process leaves is
removed here, because otherwise it would stay until the machine restarts.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import subprocess
import threading
from concurrent.futures import Future
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parent / "peers" / "peer.py"
SHARED_MEMORY = Path("/dev/shm")
ANSWER_S = 25
"""Default timeout for a result."""


_OF_OURS = ("ROS_", "CYCLONEDDS", "ZENOH_", "PYTHON")
"""Prefixes of environment variables that are not passed to peers."""


class PeerError(Exception):
    """Traceback of the peer, or its end."""


class Peer:
    """Running peer with one node, ready for commands."""

    def __init__(
        self,
        python: Path,
        name: str,
        *arguments: str,
        middleware: str,
        distro: str,
        domain_id: int,
        **settings: str,
    ) -> None:
        self.name, self.middleware, self.distro = name, middleware, distro
        self.python = python
        environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith(_OF_OURS)},
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
            "ROS_DOMAIN_ID": str(domain_id),
            **settings,
        }
        environment.pop("AMENT_PREFIX_PATH", None)
        self.stays_local = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST"
        self._process = subprocess.Popen(
            [str(python), str(SCRIPT), name, *arguments],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._numbers = itertools.count()
        self._waiting: dict[int, Future[Any]] = {}
        assert self._process.stdout is not None
        try:
            line = self._process.stdout.readline()
            assert line == "READY\n", line
        except BaseException:
            self.kill()
            raise
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def share(self) -> Path:
        return self.python.parent.parent / "share"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            answer = json.loads(line)
            future = self._waiting.pop(answer["id"])
            error = PeerError(answer["error"]) if "error" in answer else None
            self._settle(future, answer.get("result"), error)
        while self._waiting:
            self._settle(self._waiting.popitem()[1], error=PeerError("the peer is gone"))

    @staticmethod
    def _settle(future: Future[Any], result: Any = None, error: PeerError | None = None) -> None:
        if not future.set_running_or_notify_cancel():
            return  # the test has stopped waiting
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)

    def start(self, do: str, **arguments: Any) -> Future[Any]:
        """Send a command; the future has the result."""
        number = next(self._numbers)
        future = self._waiting[number] = Future()
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"id": number, "do": do, **arguments}) + "\n")
        self._process.stdin.flush()
        return future

    async def do(self, do: str, *, within_s: float = ANSWER_S, **arguments: Any) -> Any:
        """Send a command and wait for the result; raise `PeerError` or TimeoutError."""
        return await asyncio.wait_for(asyncio.wrap_future(self.start(do, **arguments)), within_s)

    def kill(self) -> None:
        """Kill the process."""
        _abandoned.update(_shared_memory_of(self._process.pid))
        self._process.kill()
        self._process.wait()
        _remove_abandoned()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def close(self) -> None:
        """End the process in an orderly way, and kill it if it does not end."""
        if self._process.poll() is not None:
            return
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            assert self._process.wait(90) == 0, f"peer {self.name} did not end well"
        finally:
            self.kill()


_abandoned: set[Path] = set()


def _remove_abandoned() -> None:
    """Remove the shared memory of killed peers that no process uses any more."""
    in_use = set().union(*(_shared_memory_of(int(one.name)) for one in Path("/proc").glob("[0-9]*")))
    for path in _abandoned - in_use:
        path.unlink(missing_ok=True)
        _abandoned.remove(path)


def _shared_memory_of(process: int) -> set[Path]:
    """Return the files of Fast DDS that a process has mapped, and their companions."""
    try:
        text = Path(f"/proc/{process}/maps").read_text()
    except OSError:
        return set()
    mapped = {Path(line.split()[5]) for line in text.splitlines() if f"{SHARED_MEMORY}/" in line}
    names = {path.name.removeprefix("sem.").removesuffix("_mutex").removesuffix("_el") for path in mapped}
    spellings = ("{}", "{}_el", "sem.{}_mutex")
    return {
        SHARED_MEMORY / spelling.format(name)
        for name in names
        for spelling in spellings
        if name.startswith(("fastrtps_", "fastdds_"))
    }
