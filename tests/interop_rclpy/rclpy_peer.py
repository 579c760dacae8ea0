"""A rclpy peer as tests see it: a process that is asked by lines of JSON, any number of questions at a time.

Peers run the scripts in `peers` with a Python that has rclpy. What Fast DDS leaves in shared memory when its process is
killed is removed here, because nobody else would before the next start of the machine.
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
"""How long a peer may take to answer unless the test says otherwise."""


REQUIREMENTS = {
    "jazzy": (
        *("ros-jazzy-rclpy==7.1.6", "ros-jazzy-rmw-fastrtps-cpp==8.4.3", "ros-jazzy-std-msgs==5.3.6"),
        *("ros-jazzy-std-srvs==5.3.6", "ros-jazzy-test-msgs==2.0.3", "ros-jazzy-sensor-msgs==5.3.6"),
        "ros-jazzy-nav-msgs==5.3.6",
    ),
    "kilted": (
        *("ros-kilted-rclpy==9.1.2", "ros-kilted-rmw-fastrtps-cpp==9.3.3", "ros-kilted-test-msgs==2.3.0"),
        *("ros-std-msgs==5.5.1", "ros-std-srvs==5.5.1"),
    ),
}
"""What an environment with rclpy of each distribution has."""


class PeerError(Exception):
    """The peer's own traceback, or that it is gone."""


class Peer:
    """A running peer with one node, ready for commands when made.

    Args:
        python: one that can import rclpy.
        name: of its node.
        distro: jazzy or kilted.
        arguments: behind the name, such as ``--ros-args``.
    """

    def __init__(self, python: Path, name: str, distro: str, *arguments: str, domain_id: int, **settings: str) -> None:
        self.name, self.distro = name, distro
        self.python = python
        environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "CYCLONEDDS", "PYTHON"))},
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
        """The folder of its packages, with their definitions."""
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

    def tell(self, do: str, **arguments: Any) -> Future[Any]:
        """Give a command; the answer comes later."""
        number = next(self._numbers)
        future = self._waiting[number] = Future()
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"id": number, "do": do, **arguments}) + "\n")
        self._process.stdin.flush()
        return future

    async def ask(self, do: str, *, within_s: float = ANSWER_S, **arguments: Any) -> Any:
        """Give a command and wait for its answer; raises `PeerError` or TimeoutError."""
        return await asyncio.wait_for(asyncio.wrap_future(self.tell(do, **arguments)), within_s)

    def kill(self) -> None:
        """End it without giving it a chance to say goodbye."""
        _abandoned.update(_shared_memory_of(self._process.pid))
        self._process.kill()
        self._process.wait()
        _remove_abandoned()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def close(self) -> None:
        """Let it end in an orderly way; kill it when it does not. Without effect when it has ended."""
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
    """Peers that live on may have the rest of one that was killed in use; that goes when the last of them has ended."""
    in_use = set().union(*(_shared_memory_of(int(one.name)) for one in Path("/proc").glob("[0-9]*")))
    for path in _abandoned - in_use:
        path.unlink(missing_ok=True)
        _abandoned.remove(path)


def _shared_memory_of(process: int) -> set[Path]:
    """The files of Fast DDS that a process has mapped, and those that belong to them."""
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
