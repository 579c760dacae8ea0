"""Running the setup.py of a package in a separate process, to get the arguments of `setup` exactly.

Only commands that run code of the workspace anyway run setup.py: ``run``, ``launch`` and ``test``. The result is cached
until a file that setup.py has read changes.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import IO, Any

from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.compiler.frontend import PackageFiles, ReadPaths
from rosidl_py_gen.errors import RosidlError, display_path, printable
from rosidl_py_gen.type_loading import cached

TIMEOUT_S = 10.0
"""Maximum run time of a setup.py in seconds, after which its process group is killed."""
_MAX_RESULT_BYTES = 4 << 20
_MAX_ERROR_BYTES = 64 << 10
_READ_GRACE_S = 1.0
"""Time in seconds to read remaining output after setup.py has ended; a child process may keep the output open."""
_OF_SHELLS = {"_", "OLDPWD", "PWD", "SHLVL"}
"""Environment variables that shells change with each command, so that a cached result of setup.py does not depend on
them."""


_results: dict[tuple[Path, str, object], Any] = {}
"""Results or error texts of setup.py files, by package folder, digest of the environment, and stamp of setup.py."""


class SetupRunError(RosidlError):
    """Raised if a setup.py has failed, or did not end in time."""


def run_setup_py(folder: Path, why: str) -> list[dict[str, object]]:
    """Return the arguments of all calls of `setup` in the setup.py of a package, which runs unless a result is cached.

    Args:
        folder: folder of the package.
        why: reason for running setup.py, which is printed on standard error.

    Raises:
        SetupRunError: setup.py failed, or did not end within 10 s.
    """

    def run() -> Any:
        terminal_output.note(f"note: running {display_path(folder / 'setup.py')}, because {printable(why, 200)}")
        PackageFiles(folder).note_folders()
        result = _record(folder)
        for path in result["read"]:
            ReadPaths.note(path)
        return result

    variables = sorted(item for item in os.environ.items() if item[0] not in _OF_SHELLS)
    # The values may be secret, so only a digest is stored.
    digest = hashlib.sha256(repr(variables).encode(errors="surrogateescape")).hexdigest()
    settings = ("setup", sys.executable, str(folder), digest)
    key = folder, digest, ReadPaths.stamp(str(folder / "setup.py"))
    if key not in _results:
        try:
            _results[key] = cached(settings, run)
        except SetupRunError as error:
            _results[key] = str(error)
    result = _results[key]
    if isinstance(result, str):
        raise SetupRunError(result)
    # The caller may be a cached search itself.
    PackageFiles(folder).note_folders()
    for path in result["read"]:
        ReadPaths.note(path)
    calls: list[dict[str, object]] = result["calls"]
    return calls


def _record(folder: Path) -> Any:
    command = [sys.executable, "-W", "ignore", str(Path(__file__).with_name("setup_recorder.py"))]
    place = display_path(folder / "setup.py")
    has_groups = os.name != "nt"
    pipe = subprocess.PIPE
    try:
        process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, start_new_session=has_groups
        )
    except OSError as error:
        raise SetupRunError(f"{place} cannot be run: {error.strerror or error}") from error
    output, errors = _Tail(process.stdout, _MAX_RESULT_BYTES), _Tail(process.stderr, _MAX_ERROR_BYTES)
    try:
        process.wait(TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise SetupRunError(f"{place} did not end within {TIMEOUT_S:g} s") from None
    finally:
        with suppress(OSError):  # it has ended
            if has_groups:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()
        process.wait()
        text, error_text = output.read(), errors.read()
    if process.returncode == 0 and len(text) < _MAX_RESULT_BYTES:
        with suppress(ValueError, RecursionError):
            found = json.loads(text)
            if isinstance(found, dict) and found.keys() >= {"calls", "read"}:
                return found
    lines = error_text.decode(errors="replace").strip().splitlines() or [f"it ended with status {process.returncode}"]
    raise SetupRunError(f"{place} cannot be run: {printable(lines[-1], 300)}")


class _Tail:
    """Thread that reads a stream and retains its last bytes."""

    def __init__(self, stream: IO[bytes] | None, max_bytes: int) -> None:
        assert stream is not None
        self._stream, self._max_bytes = stream, max_bytes
        self._data = b""
        self._thread = Thread(target=self._read_all, daemon=True)
        self._thread.start()

    def _read_all(self) -> None:
        with suppress(OSError, ValueError):
            while part := os.read(self._stream.fileno(), 1 << 16):
                self._data = (self._data + part)[-self._max_bytes :]

    def read(self) -> bytes:
        self._thread.join(_READ_GRACE_S)
        if not self._thread.is_alive():
            self._stream.close()
        return self._data
