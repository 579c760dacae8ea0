"""Virtual environments for peers that tests talk to and must not import: other ROS tools and nodes from PyPI. And
programs that tests compile.

An environment is made once and kept between runs in ``$ROSIDL_TEST_CACHE`` (by default a folder in the user's cache),
below a name made of what is in it: another list of requirements or another Python is another environment, so checkouts
with different lists get along. It is built beside its place and moved there when whole. Of two processes that want the
same one the second waits for the first. Because it is moved, only its Python may be run (``python -m tool``): the
programs in its bin folder remember where they were built. The whole cache may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import pytest

from support.machine_locks import lock

SHARED_MEMORY_LOST = re.compile(r"\S+ [^\n]*RTPS_TRANSPORT_SHM[^\n]* Error\] [^\n]*open_and_lock_file failed[^\n]*\n")
"""Output of Fast DDS if another program on this machine has taken its shared memory; it continues with UDP."""

_PYTHON = Path("Scripts", "python.exe") if os.name == "nt" else Path("bin", "python")


def missing_peer(reason: str) -> NoReturn:
    """Skip the test, or fail it where ROSIDL_TEST_REQUIRE_PEERS promises that peers are there."""
    if "ROSIDL_TEST_REQUIRE_PEERS" in os.environ:
        pytest.fail(f"{reason}; ROSIDL_TEST_REQUIRE_PEERS makes this a failure", pytrace=False)
    pytest.skip(f"{reason}; ROSIDL_TEST_REQUIRE_PEERS makes this a failure")


def require(module: str) -> None:
    """Skip or fail the test if a module that only the extra `test-all` installs is missing."""
    if find_spec(module) is None:
        missing_peer(f"needs {module}, which pip install -e '.[test-all]' brings")


def environment(name: str, requirements: Sequence[str]) -> Path:
    """Return the Python of a virtual environment with `requirements`; create it if it does not exist.

    Call it from a session fixture: pytest then remembers that it skipped, and an index out of reach is asked once.

    Args:
        name: part of a folder's name, for people.
        requirements: as pip takes them; pin them, because an environment is never updated.
    """
    wanted = "\n".join([sys.implementation.cache_tag, *requirements]) + "\n"

    def is_whole(folder: Path) -> bool:  # false also if the Python it was made with was removed: its own is a link
        return (folder / _PYTHON).exists()

    return _folder(name, wanted.encode(), is_whole, partial(_build, requirements)) / _PYTHON


def built_peers() -> dict[str, Path]:
    """Return the Python of each peer in $ROSIDL_PEERS, by the name of its folder.

    A name is a distribution, or a middleware and a distribution: ``humble``, ``cyclone_jazzy``, ``zenoh_kilted``.
    """
    folder = os.environ.get("ROSIDL_PEERS")
    return {one.parts[-3]: one for one in sorted(Path(folder).absolute().glob("*/bin/python"))} if folder else {}


def rclpy_python(name: str = "jazzy") -> Path:
    """Return the Python of a built peer with this name, or of an `environment` with rclpy of this distribution."""
    if (built := built_peers().get(name)) is not None:
        return built
    packages = Path(__file__).parent / "rclpy_packages" / f"{name}.txt"
    return environment(f"rclpy-{name}", packages.read_text(encoding="utf-8").split())


def kept(name: str, sources: Sequence[Path], make: Callable[[Path], None]) -> Path:
    """Return a folder that `make` filled, now or in an earlier run with equal sources, compiler and headers."""
    compiler = subprocess.run(["g++", "--version"], capture_output=True).stdout
    headers = [Path("/usr/include", one) for one in ("dds", "fastcdr", "fastrtps")]
    stamps = [(one.name, one.stat().st_mtime_ns if one.exists() else 0) for one in headers]
    content = b"".join(one.read_bytes() for one in sources) + compiler + repr(stamps).encode()
    return _folder(name, content, Path.exists, make)


def _folder(name: str, content: bytes, is_whole: Callable[[Path], bool], make: Callable[[Path], None]) -> Path:
    """Return the folder of some content, made beside its place and moved there unless it is whole."""
    folder = cache_folder() / f"{name}-{hashlib.sha256(content).hexdigest()[:12]}"
    held = lock(folder.name, wait=True)
    try:
        if not is_whole(folder):
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(
                prefix=f".{name}-", dir=folder.parent, ignore_cleanup_errors=True
            ) as beside:
                make(made := Path(beside) / "new")
                if not is_whole(folder):  # where there are no locks, another process may have made it
                    shutil.rmtree(folder, ignore_errors=True)
                    made.rename(folder)
    finally:
        if held is not None:
            os.close(held)
    return folder


def cache_folder() -> Path:
    if chosen := os.environ.get("ROSIDL_TEST_CACHE"):
        return Path(chosen).expanduser().absolute()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rosidl-py-gen-tests"


def _build(requirements: Sequence[str], folder: Path) -> None:
    _run(requirements, sys.executable, "-m", "venv", "--without-pip", str(folder))
    pip = [sys.executable, "-m", "pip", "--python", str(folder / _PYTHON), "install"]
    _run(requirements, *pip, "--no-input", "--disable-pip-version-check", "--retries", "2", *requirements)


def _run(requirements: Sequence[str], *command: str) -> None:
    # A PYTHONPATH that points at some ROS installation must not decide what is there already.
    quiet = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        command, env=quiet, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )
    if done.returncode:
        print(" ".join(command), done.stdout, sep="\n")  # all of it, for pytest's captured output
        missing_peer(f"no environment with {', '.join(requirements)}: {done.stdout.strip()[-2000:]}")
